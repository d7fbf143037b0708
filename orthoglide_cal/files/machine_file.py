"""Machine files (`orthocal guide machine`) to a `Model` and back, edited in place; the package's.

Here are what stands around a machine in its file, and what depends on which causes there are.
"""

import functools
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path, PurePath
from textwrap import indent
from typing import Annotated, cast

import numpy as np
import yaml
from pydantic import BeforeValidator, ValidationError, ValidationInfo, create_model, field_validator

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError, UsageError, visible
from orthoglide_cal.files.text import FileText, document_from_bytes, free_path, read_document
from orthoglide_cal.files.tree import WORDS, Content, Steps, dotted, load_tree, nearest, yaml_text
from orthoglide_cal.model.kinds import MACHINES
from orthoglide_cal.model.machine import Entered, Machine
from orthoglide_cal.model.model import Effect, Estimate, Model
from orthoglide_cal.schema import (
    Day,
    Digest,
    Number,
    Schema,
    Version,
    Word,
    text_that,
    yaml_number,
)

# A section that only a Klipper configuration has, or a part of one.
PRINTER_SECTION = re.compile(
    r"^(#\*# )?\[\s*(printer|stepper_\w+|mcu|bed_mesh|delta_calibrate|gcode_macro|include"
    r"|probe|bltouch|extruder\d*|\w*heater_\w+|\w*fan|tmc\d+|temperature_\w+|input_shaper)\b",
    re.MULTILINE | re.IGNORECASE,
)
# Tolerances: the smallest, and the largest in usual sizes.
_SMALLEST_TOLERANCE = 1e-9
_LARGEST_TOLERANCE = 1000.0

# The first line of a file that the program wrote: without the last line it was cut off.
WRITTEN = "# Written by orthocal. The last line, `complete: true`, shows that nothing is missing.\n"
_ACTIVE = "offsets_mm"
_NOWHERE = text_that("".__eq__, "An accepted cause acts on the whole machine.", 'Write where: "".')
_TRUE = text_that("true".__eq__, "Only `true` is possible here.", "Write complete: true.")
_MADE = "# Made by `orthocal apply` for "
_Estimates = Mapping[Word, Estimate]
_Matrix = tuple[tuple[Number, ...], ...]
_HEAD = "# Change what you know better; `orthocal validate` checks it. Lengths are mm.\n"


class Identified(Schema):
    """An accepted cause as the file holds it; the context is the class of the machine."""

    cause: str
    where: Annotated[str, _NOWHERE] | None = ""  # always the whole machine
    # By their names on this kind of machine.
    parameters: _Estimates
    date: Day  # of its acceptance
    data_sha256: Digest  # of the readings that it was accepted from
    correlation: _Matrix = ()  # of the parameters; () for independent ones

    @field_validator("cause")
    @classmethod
    def _lasting(cls, id: str, info: ValidationInfo) -> str:
        known = _causes_of(cast(type[Machine], info.context))
        if id not in known:
            raise InputError(*_unknown_cause(id, known))
        if not CAUSES[id].lasting:
            lasting = ", ".join(id for id in known if CAUSES[id].lasting)
            raise InputError("This cause cannot be part of a machine.", f"Use one of {lasting}.")
        return id

    @field_validator("parameters")
    @classmethod
    def _of_the_cause(cls, given: _Estimates, info: ValidationInfo) -> _Estimates:
        id = info.data.get("cause")
        if id is None:
            return given
        machine, cause = cast(type[Machine], info.context), CAUSES[id]
        names = machine.named(cause.names).values()
        # A shape that was found with fewer terms is still one.
        fewer = cause.shares and given.keys() < set(names)
        if given.keys() != set(names) and not (given and fewer):
            fault = f"{id} has the parameters {', '.join(names)}."
            raise InputError(fault, "Give each of them once.")
        faults, convert = [], f"Convert the value and its std, and write unit: {cause.unit!r}."
        for name, one in given.items():
            other_unit = f"{id} is measured in {cause.unit or 'no unit'}, not {one.unit!r}."
            checks = {
                "name": (one.name, "The key is not known.", "Leave it out."),  # its key is its name
                "unit": (one.unit != cause.unit, other_unit, convert),
                "value": (cause.positive and one.value < 0.0, *WORDS["not_negative"]),
            }
            for key, (wrong, fault, remedy) in checks.items():
                if wrong:
                    faults.append(InputError(fault, remedy, column=f"{name}.{key}"))
        if faults:
            raise InputError.of(faults)
        return given

    @field_validator("correlation")
    @classmethod
    def _correlations(cls, rows: _Matrix, info: ValidationInfo) -> _Matrix:
        size = len(info.data.get("parameters", rows))
        if rows and {len(rows), *map(len, rows)} != {size}:
            fault = f"The correlations are not {size} rows of {size} numbers."
            remedy = "Give one row for each parameter, in their order, or remove them."
            raise InputError(fault, remedy)
        matrix = np.array(rows or np.eye(1))
        asymmetry = np.abs(matrix - matrix.T).max()
        off_one = np.abs(np.diag(matrix) - 1.0).max()
        if max(asymmetry, off_one, -np.linalg.eigvalsh(matrix)[0]) > 1e-5:
            remedy = "They are symmetric, with ones on the diagonal, and of no negative variance."
            raise InputError("These numbers are not correlations.", remedy)
        return rows

    def effect(self, machine: type[Machine]) -> Effect:
        """The cause with these parameters, as part of a machine of this kind."""
        cause = CAUSES[self.cause]
        names = {called: name for name, called in machine.named(cause.names).items()}
        estimates = {names[name]: estimate for name, estimate in self.parameters.items()}
        matrix = np.array(self.correlation) if self.correlation else np.eye(len(estimates))
        return cause.estimated(estimates, matrix).accepted(self.date, self.data_sha256)


class _Around(Schema):
    """Keys of a machine file besides the machine; the context is the class of the machine."""

    schema_version: Version
    identified: Annotated[tuple[Identified, ...], BeforeValidator(lambda given: given or ())] = ()
    complete: Annotated[str, _TRUE] | None = None


@functools.cache
def _file_schema(machine: type[Machine]) -> type[_Around]:
    """The whole file of a kind of machine."""
    bases: tuple[type[Schema], ...] = _Around, machine
    return cast(type[_Around], create_model(f"{machine.__name__}File", __base__=bases))


@dataclass(frozen=True)
class StoredMachine:
    """A machine file as read."""

    model: Model
    document: FileText


def read_machine_file(path: Path | str) -> StoredMachine:
    """The machine file at a path ("-": standard input).

    Raises InputError: everything in it that breaks the schema, each with line and path; or not
    readable, not YAML, or not a machine file.
    """
    file = read_document(str(path))
    if PRINTER_SECTION.search(file.text):
        fault = "This is a printer's configuration, not a machine file."
        remedy = "Give it to solve, diagnose or plan as input: it describes its machine itself."
        raise InputError(fault, remedy, file=file.path)
    return machine_file_in(load_tree(file))


def machine_file_in(tree: Content) -> StoredMachine:
    """The machine file that a parsed document is. Raises as `read_machine_file` does."""
    value, file = tree.value, tree.document
    if not isinstance(value, dict):
        remedy = "Make one: orthocal machine new --output FILE"
        raise InputError("This is not a machine file.", remedy, file=file.path, line=1)
    if "readings" in value and "machine" in value:
        remedy = "Give it as the input; the machine that it was measured on is inside."
        raise InputError("This is a session, not a machine file.", remedy, file=file.path)
    model = machine_in(tree, ())
    if file.text.startswith(WRITTEN) and "complete" not in value:
        fault = "The last line, `complete: true`, is missing: the file was cut off."
        remedy = "Take it from a copy; add the line only if you know that nothing is missing."
        tree.add(fault, remedy, line=file.text.count("\n"), column="complete")
    if model is None or tree.problems:
        raise tree.error()
    return StoredMachine(model, file)


def stored_machine(content: str, path: str, sha256: str = "") -> StoredMachine:
    """The machine file that a text makes, with this digest or its own; raises likewise."""
    file = document_from_bytes(content.encode(), path)
    return machine_file_in(load_tree(replace(file, sha256=sha256 or file.sha256)))


@functools.cache
def default_machine() -> Model:
    """The paper's prototype, from the file that comes with the package."""
    return read_machine_file(shipped_machine("")).model


def shipped_machine(kind: str) -> Path:
    """The machine file that comes with the program for a kind; the prototype's for others."""
    path = shipped_folder() / f"{kind}.yaml"
    return path if path.is_file() else path.with_name("orthoglide_prototype.yaml")


def shipped_folder() -> Path:
    """Folder of the machine files that come with the program; they are never changed."""
    package = Path(str(files("orthoglide_cal")))
    # In a wheel the folder lies inside the package, in a source checkout beside it.
    inside = package / "configs"
    return inside if inside.is_dir() else package.parent / "configs"


def machine_in(tree: Content, path: Steps) -> Model | None:
    """The machine that a group of keys describes; None after noting what is wrong with it."""
    value, before = tree.at(path), len(tree.problems)
    if not isinstance(value, dict):
        missing = "The key is missing.", "Add a line `machine: …`."
        tree.note(path, *(WORDS["model_type"] if path[-1] in tree.value else missing))
        return None
    # Without its kind a file is of that of most keys; an Orthoglide may go without.
    unnamed, *_ = MACHINES
    keys = {kind: value.keys() & made.model_fields.keys() for kind, made in MACHINES.items()}
    kind = value.get("kind", max(keys, key=lambda kind: len(keys[kind])))
    if not isinstance(kind, str) or kind not in MACHINES:
        remedy = f"{nearest(str(kind), MACHINES)}Known: {', '.join(MACHINES)}."
        tree.note((*path, "kind"), "This kind of machine is not known.", remedy)
        return None
    if "kind" not in value and kind != unnamed:
        tree.add("The key is missing.", f"Add a line `kind: {kind}`.", line=1, column="kind")
    machine = MACHINES[kind]
    schema = _file_schema(machine)
    try:
        file = schema.model_validate(value, context=machine)
    except ValidationError as error:
        tree.take(error, schema, path)
    sizes, corrected, causes = value.get("tolerances"), value.get("corrected"), _causes_of(machine)
    by_joint = {id: machine.named(CAUSES[id].names) for id in causes if CAUSES[id].by_joint}
    for id, values in corrected.items() if isinstance(corrected, dict) else ():
        place = (*path, "corrected", id)
        if id not in by_joint:
            tree.note(place, "No controller corrects this.", f"Known: {', '.join(by_joint)}.", id)
            continue
        names = by_joint[id].values()
        for name in values if isinstance(values, dict) else ():
            if name not in names:
                fault, remedy = "This is no parameter of it.", f"Known: {', '.join(names)}."
                tree.note((*place, name), fault, remedy, name)
    noted = {problem.column for problem in tree.problems}
    for id, text in sizes.items() if isinstance(sizes, dict) else ():
        place = (*path, "tolerances", id)
        if id not in causes:
            tree.note(place, *_unknown_cause(id, causes), id)
        elif dotted(place) not in noted:
            size, usual = yaml_number(text), CAUSES[id].usual(machine) or 0.0
            if size > _LARGEST_TOLERANCE * usual:
                times = f"more than {_LARGEST_TOLERANCE:g} times the usual size of {id}, {usual:g}."
                tree.note(place, f"That is {times}", f"Give it in {CAUSES[id].unit or 'its unit'}.")
            elif 0.0 < size < _SMALLEST_TOLERANCE:
                fault = f"The number must be 0, or from {_SMALLEST_TOLERANCE:g}."
                tree.note(place, fault, "Give 0 to rule it out.")
    if len(tree.problems) > before:
        return None
    effects = tuple(entry.effect(machine) for entry in file.identified)
    made = machine.model_construct(**{name: getattr(file, name) for name in machine.model_fields})
    return Model(made, effects).correcting(made.corrected)


def _causes_of(machine: type[Machine]) -> list[str]:
    """Ids of the causes that a machine of this kind can have."""
    return [id for id, cause in CAUSES.items() if cause.usual(machine) is not None]


def _unknown_cause(id: str, known: list[str]) -> tuple[str, str]:
    fault = "This is not a cause id of this kind of machine."
    return fault, f"{nearest(id, known)}Known: {', '.join(known)}."


def is_machine_file(tree: Content) -> bool:
    """True for a file without readings that has a key of a machine file."""
    keys = set(tree.value) if isinstance(tree.value, dict) else set()
    known = machine_values(default_machine()).keys() - {"name"}
    return "readings" not in keys and not known.isdisjoint(keys)


def machine_values(model: Model) -> dict[str, object]:
    """Plain values of the machine file, in the file's order; what nobody stated is left out."""

    def digits(value: float) -> float:  # a file read and written again says the same in its units
        return float(f"{value:.12g}")

    machine = model.machine
    stated = machine.model_dump(mode="json", exclude_none=True)
    common = Machine.model_fields.keys() - {"kind", "name"}
    last = {key: stated.pop(key) for key in list(stated) if key in common}
    return {
        "schema_version": 1,
        **stated,
        **{key: value for key, value in last.items() if value or key == "tolerances"},
        "history": last.pop("history"),
        "identified": [
            {
                "cause": effect.cause.id,
                "where": "",
                "parameters": {
                    one.name: {"value": digits(one.value), "std": digits(one.std), "unit": one.unit}
                    for one in model.called(effect)
                },
                "date": effect.date,
                "data_sha256": effect.data_sha256,
                "correlation": effect.correlation.round(6).tolist(),
            }
            for effect in model.accepted
            if effect.date  # what is fitted to each file anew is no part of the machine
        ],
    }


def differing(one: Model, other: Model) -> list[str]:
    """Keys in which two machines differ so that they read differently."""
    first, second = machine_values(one), machine_values(other)
    names = ("kind", *one.machine.geometry_keys, "identified")
    return [name for name in names if first[name] != second.get(name)]


def machine_text(model: Model) -> str:
    """The machine file's text; its last line shows that nothing was cut off."""
    return WRITTEN + yaml_text({**machine_values(model), "complete": True})


def new_machine_file(model: Model, controller: str) -> StoredMachine:
    """A file, not written yet, in this folder for a machine that has none.

    It is named after its controller's file or server: printer.yaml, or printer-2.yaml.
    """
    name = re.sub(r"[^\w.-]+", "-", PurePath(controller).name.removesuffix(".cfg"))
    text = f"{WRITTEN}{_MADE}{visible(controller)}\n{machine_text(model).removeprefix(WRITTEN)}"
    return stored_machine(text, str(free_path(Path(), name, ".yaml")))


def made_for(file: StoredMachine) -> str | None:
    """The controller's file or server for which `new_machine_file` made a file, made harmless."""
    line = file.document.text.removeprefix(WRITTEN).partition("\n")[0]
    return line.removeprefix(_MADE) if line.startswith(_MADE) else None


def with_entry(file: StoredMachine, entry: Entered) -> StoredMachine:
    """The file with what was entered, not written; its digest and every other byte stay.

    The entry keeps the lines that it replaces. Raises InputError: it could not be read again.
    """
    document, model, past = file.document, file.model, file.model.machine.history
    text, line_end = _unified(document)
    model = model if entry.after is None else model.holding([*entry.after.values()])
    model = model if entry.corrected is None else model.correcting(entry.corrected)

    def recorded(replaced: Mapping[str, str]) -> Model:
        history = *past, entry.changed(replaced=replaced)
        return replace(model, machine=model.machine.changed(history=history))

    before, after = machine_values(file.model), machine_values(model)
    replaced: dict[str, str] = {}
    for key in (_ACTIVE, "corrected"):
        if after.get(key) != before.get(key):
            group = cast(Mapping[str, object], after[key])
            lines = _numbered(text[slice(*_span(text, key))], key, group)
            text, replaced[key] = _put(text, key, lines)
    block = text[slice(*_span(text, "history"))]
    listed = re.search("^( *)- ", block, re.MULTILINE)
    if not listed:
        replaced["history"] = block
    made = recorded(replaced)
    entries = cast(list[object], machine_values(made)["history"])
    lines = yaml_text({"history": entries})
    if listed:
        item = indent(yaml_text(entries[-1:]), listed[1])
        lines = block + item if block.endswith("\n") else f"{block}\n{item[:-1]}"
    text, _ = _put(text, "history", lines)
    then = None
    with suppress(InputError):
        then = stored_machine(text.replace("\n", line_end), document.path, document.sha256)
    if then is None or machine_values(then.model) != machine_values(made):  # a rare form of YAML
        text = machine_text(recorded({"": document.data.decode()}))
        then = stored_machine(text, document.path, document.sha256)
    return then


def without_entry(file: StoredMachine) -> StoredMachine:
    """The file without its last entry, not written, with what that replaced; its digest stays.

    Raises UsageError: these lines were changed since.
    """
    document, last = file.document, file.model.machine.history[-1]
    text, line_end = _unified(document)
    block = text[slice(*_span(text, "history"))]
    replaced = dict(last.replaced or {})
    if others := re.match(r"(.*?\n( *)- .*)\n\2- ", block, re.DOTALL):
        replaced.setdefault("history", others[1] + "\n" * block.endswith("\n"))
    for key, lines in replaced.items():
        text, _ = _put(text, key, lines)
    text = replaced.get("", text.replace("\n", line_end))
    with suppress(InputError):
        then = stored_machine(text, document.path, document.sha256)
        again = with_entry(then, last.changed(replaced=None))
        if last.replaced is not None and again.document.data == document.data:
            return then
    stood = {_ACTIVE: last.before, "corrected": last.corrected_before}
    groups = (yaml_text({key: dict(one)}) for key, one in stood.items() if one is not None)
    fault = f"{document.path} does not hold what the entry of {last.date} left in it."
    remedy = "Restore it by hand: remove that entry, and write what stood before it."
    raise UsageError(fault, "\n".join((remedy, *groups)))


def new_machine(values: Mapping[str, object], path: str) -> StoredMachine:
    """A machine file with these values, not written yet; the others are the shipped one's.

    Dotted key → plain value; without a kind it is an Orthoglide. Raises InputError: they make no
    machine; each with its key and no line.
    """
    prototype = read_document(str(shipped_machine(str(values.get("kind"))))).text
    text = WRITTEN + _HEAD + prototype[prototype.index("schema_version:") :]
    values = {**values, "history": [], "complete": True}
    for key, value in values.items():
        text = _with_value(text, key, value)
    try:
        return stored_machine(text, path)
    except InputError as error:
        faults = [replace(fault, file=None, line=None, problems=()) for fault in error.problems]
        raise InputError.of(faults) from error


# --- the text of a file that people keep: comments, order and blanks stay as they are -------------
# Whoever edits one reads the result back: YAML has forms that nobody writes.


def _unified(document: FileText) -> tuple[str, str]:
    """The text of a file with "\n" as line ends, and its own; a file that mixes them keeps them."""
    text = document.data.decode()
    line_end = "\r\n" if text.count("\r\n") == text.count("\n") > 0 else "\n"
    return text.replace(line_end, "\n"), line_end


def _span(text: str, key: str) -> tuple[int, int]:
    """Span of the lines of a key at the top, or its place; a new one comes last but `complete`."""
    lines = rf"^{key}:.*\n?(?:(?:[ \t]*\n)*[ \t-].*\n?)*|^(?=complete:)|\Z"
    return next(re.finditer(lines, text, re.MULTILINE)).span()


def _put(text: str, key: str, lines: str) -> tuple[str, str]:
    """The text with other lines of a key at its top, and those that stood there; "" for none.

    A text without a last line end keeps none: to put back what stood there restores it.
    """
    start, end = _span(text, key)
    before, stood = text[:start], text[start:end]
    if before and not before.endswith("\n"):
        lines = f"\n{lines[:-1]}"
    elif not lines and not stood.endswith("\n"):
        before = before[:-1]
    return before + lines + text[end:], stood


def _numbered(lines: str, key: str, group: Mapping[str, object]) -> str:
    """The lines of a key with other numbers, in their places if they stand there as usual."""
    for name, number in group.items():
        lines = re.sub(rf"(\b{name}[\"']?:\s*)[^\s,}}#]+", rf"\g<1>{number}", lines, count=1)
    with suppress(yaml.YAMLError):
        if yaml.safe_load(lines) == {key: group}:
            return lines
    return yaml_text({key: group})


def _with_value(text: str, path: str, value: object) -> str:
    """The text of a shipped file with one value, of a key or of one in a group."""
    group, _, key = path.rpartition(".")
    start, end = _span(text, group or key)
    line = yaml_text({key: value}).strip("{}\n")
    line = line if isinstance(value, str) else re.sub(r"\.0\b", "", line)
    standing = rf"\b{key}: (\[.*?\]|[^,}}#\n]*?)(?= *[,}}#\n])"
    if stands := re.compile(standing).search(text, start, end):
        return text[: stands.start()] + line + text[stands.end() :]
    return f"{text[:end]}{'  ' if group else ''}{line}\n{text[end:]}"
