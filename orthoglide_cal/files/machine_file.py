"""Machine files (`orthocal guide machine`) to a `Model` and back, edited in place; the package's.

What a machine is made of its class says; here is what stands around it in the file, and what
depends on which causes there are.
"""

import functools
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path, PurePath
from typing import Annotated, cast

import numpy as np
import yaml
from pydantic import BeforeValidator, ValidationError, ValidationInfo, create_model, field_validator

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError, visible
from orthoglide_cal.files.text import FileText, document_from_bytes, free_path, read_document
from orthoglide_cal.files.tree import WORDS, Content, Steps, dotted, load_tree, nearest, yaml_text
from orthoglide_cal.model.kinds import MACHINES
from orthoglide_cal.model.machine import Active, Corrections, Entered, Machine
from orthoglide_cal.model.model import Effect, Estimate, Model
from orthoglide_cal.schema import (
    Day,
    Digest,
    Number,
    Reason,
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
_HEAD = "# Change what you know better; `orthocal validate` checks it. Lengths are mm.\n"


class Identified(Schema):
    """An accepted cause as the file holds it; the context is the class of the machine."""

    cause: str
    where: Annotated[str, _NOWHERE] | None = ""  # always the whole machine
    # By their names on this kind of machine.
    parameters: Mapping[Word, Estimate]
    date: Day  # of its acceptance
    data_sha256: Digest  # of the readings that it was accepted from
    correlation: tuple[tuple[Number, ...], ...] = ()  # of the parameters; () for independent ones

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
    def _of_the_cause(
        cls, given: Mapping[str, Estimate], info: ValidationInfo
    ) -> Mapping[str, Estimate]:
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
        faults = []
        for name, estimate in given.items():
            if estimate.name:  # its key is its name
                fault, remedy = "The key is not known.", "Leave it out."
                faults.append(InputError(fault, remedy, column=f"{name}.name"))
            if estimate.unit != cause.unit:
                fault = f"{id} is measured in {cause.unit or 'no unit'}, not {estimate.unit!r}."
                remedy = f"Convert the value and its std, and write unit: {cause.unit!r}."
                faults.append(InputError(fault, remedy, column=f"{name}.unit"))
            if cause.positive and estimate.value < 0.0:
                fault, remedy = "The number must not be negative.", "Give zero or more."
                faults.append(InputError(fault, remedy, column=f"{name}.value"))
        if faults:
            raise InputError.of(faults)
        return given

    @field_validator("correlation")
    @classmethod
    def _correlations(
        cls, rows: tuple[tuple[float, ...], ...], info: ValidationInfo
    ) -> tuple[tuple[float, ...], ...]:
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
    remarks: tuple[Reason, ...]  # to know although nothing is wrong


def read_machine_file(path: Path | str) -> StoredMachine:
    """The machine file at a path ("-": standard input).

    Raises InputError: everything in it that breaks the schema, each with line and path; or not
    readable, not YAML, or not a machine file.
    """
    file = read_document(str(path))
    if PRINTER_SECTION.search(file.text):
        fault = "This is a printer's configuration, not a machine file."
        remedy = (
            "Give it to solve, diagnose or plan as their input: it describes its machine itself."
        )
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
    missing = () if "identified" in value else (Reason.of("no_identified"),)
    return StoredMachine(model, file, (*missing, *model.machine.instrument.implausible().values()))


def machine_from_text(content: str, path: str) -> Model:
    """The machine that a text describes; `path` is its name. Raises as `read_machine_file`."""
    return _stored(content, path).model


def _stored(content: str, path: str) -> StoredMachine:
    return machine_file_in(load_tree(document_from_bytes(content.encode(), path)))


@functools.cache
def default_machine() -> Model:
    """The paper's prototype, from the file that comes with the package."""
    return read_machine_file(shipped_machine("")).model


def shipped_machine(kind: str) -> Path:
    """The machine file that comes with the program for a kind; the prototype's for others."""
    path = shipped_folder() / f"{kind}.yaml"
    return path if path.is_file() else path.with_name("orthoglide_prototype.yaml")


def shipped_folder() -> Path:
    """Where the machine files are that come with the program; they are never changed."""
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
    fields = {name: getattr(file, name) for name in machine.model_fields}
    effects = tuple(entry.effect(machine) for entry in file.identified)
    made = machine.model_construct(**fields)
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

    def digits(value: float) -> float:
        """Twelve of them: a file read and written again says the same in its units."""
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
    """The machine file's text; `read_machine_file` gives back the same machine and causes.

    Its last line shows that nothing was cut off.
    """
    return WRITTEN + yaml_text({**machine_values(model), "complete": True})


def new_machine_file(model: Model, controller: str) -> StoredMachine:
    """A file for a machine that has none, not written yet, in this folder.

    Its name is that of its controller's file or server: printer.yaml, or printer-2.yaml where that
    is another machine's.
    """
    name = re.sub(r"[^\w.-]+", "-", PurePath(controller).name.removesuffix(".cfg"))
    text = f"{WRITTEN}{_MADE}{visible(controller)}\n{machine_text(model).removeprefix(WRITTEN)}"
    return _stored(text, str(free_path(Path(), name, ".yaml")))


def made_for(file: StoredMachine) -> str | None:
    """The controller's file or server for which `new_machine_file` made a file, made harmless."""
    line = file.document.text.removeprefix(WRITTEN).partition("\n")[0]
    return line.removeprefix(_MADE) if line.startswith(_MADE) else None


def with_history(
    file: StoredMachine, active: Active | None, corrected: Corrections | None, *history: Entered
) -> StoredMachine:
    """The file with other active values and corrections (None: the same), and one entry of the
    history more or less, not written; the digest is still that of the file.

    Every other byte stays, and a number moves as it is written: to take an entry back leaves what
    was there before it. Raises InputError: it could not be read again.
    """
    model, document, past = file.model, file.document, file.model.machine.history
    model = model if active is None else model.holding([*active.values()])
    model = model if corrected is None else model.correcting(corrected)
    model = replace(model, machine=model.machine.changed(history=history))
    values, before = machine_values(model), machine_values(file.model)
    content, text = load_tree(document), document.data.decode()
    others = (key for key in values if values[key] != before.get(key))
    new = {key: values[key] for key in others if key not in content.value}
    changes: dict[Steps, object] = {(key,): value for key, value in new.items()}
    for path, to in _differences(before, values):
        if path[0] not in new:  # a key of the file's own becomes empty, and stays
            changes[path] = to if path[1:] else to or {}
    enters, both = len(history) > len(past), max(past, history, key=len)
    remark = f"  # added by `orthocal apply`, {both[-1].date}"
    for name, value in (both[-1].before or {}).items():
        places: list[Steps] = [(_ACTIVE, name), ("history", len(both) - 1, "before", name)]
        source, to = places if enters else places[::-1]
        written = content.at(source)
        if (enters or to in changes) and written and yaml_number(written) == value:
            changes[to] = Verbatim(written)
    if not enters:
        added = re.findall(rf"^(\w+):.*{re.escape(remark)}\r?$", text, re.MULTILINE)
        changes |= {(key,): None for key in added}
    then = None
    with suppress(InputError, yaml.YAMLError):
        then = _stored(edited(text, changes, remark), document.path)
    if then is None or machine_values(then.model) != values:  # a rare form of YAML
        then = _stored(machine_text(model), document.path)
    return replace(then, document=replace(then.document, sha256=document.sha256))


def _differences(old: object, new: object, path: Steps = ()) -> Iterator[tuple[Steps, object]]:
    """Where two trees of plain values differ, and what the new one has there; None for nothing."""
    before, after = (dict(enumerate(v)) if isinstance(v, list) else v for v in (old, new))
    if isinstance(before, dict) and isinstance(after, dict):
        for step in {**before, **after}:
            yield from _differences(before.get(step), after.get(step), (*path, step))
    elif old != new:
        yield path, new


def new_machine(values: Mapping[str, object], path: str) -> StoredMachine:
    """A machine file with these values, not written yet; the others are the shipped one's.

    Dotted key → plain value, None to state nothing; without a kind it is an Orthoglide. Raises
    InputError: they do not make a machine; each with its key, and no line: the file is not there
    yet.
    """
    prototype = read_document(str(shipped_machine(str(values.get("kind"))))).text
    shipped = WRITTEN + _HEAD + prototype[prototype.index("schema_version:") :]
    values = {**values, "history": [], "complete": True}
    text = edited(shipped, {tuple(key.split(".")): value for key, value in values.items()})
    try:
        return _stored(text, path)
    except InputError as error:
        faults = [replace(fault, file=None, line=None, problems=()) for fault in error.problems]
        raise InputError.of(faults) from error


# --- the text of a file that people keep: comments, order and blanks stay as they are -------------
# Whoever edits one reads the result back, because YAML has forms that nobody writes.


class Verbatim(str):
    """A value as it stands in a file, where 0 and 0.0 are not the same."""


def edited(text: str, changes: Mapping[Steps, object], remark: str = "") -> str:
    """The text of a YAML file with other values at some paths; every other byte stays.

    `edited("a: 1  # one\\n", {("a",): 2, ("b",): []})` is `"a: 2  # one\\nb: []\\n"`.

    Args:
        text: of a file that `load_tree` reads, with a group at its top.
        changes: path → plain value, or `Verbatim`; None takes an entry out. A value takes the place
            of the old one as a whole. A new entry comes last, but for `complete`.
        remark: behind the first line of a new entry.
    """
    # In its own line ends; those of a file that mixes them stay.
    end = "\r\n" if text.count("\r\n") == text.count("\n") > 0 else "\n"
    text = text.replace(end, "\n")
    for path, value in changes.items():
        text = _changed(text, path, value, remark)
    return text.replace("\n", end)


def _changed(text: str, path: Steps, value: object, remark: str) -> str:
    holder: yaml.Node | None = None  # key of the group
    group = yaml.compose(text, Loader=yaml.SafeLoader)
    for step in path[:-1]:
        holder, group = _entries(group)[step]
    assert group is not None
    entries, step = _entries(group), path[-1]
    entry = {step: value} if isinstance(step, str) else [value]
    if step in entries and value is not None:
        return _replaced(text, *entries[step], value)
    if holder and len(entries) == (step in entries):
        return _replaced(text, holder, group, [] if entries else entry)
    if step in entries:
        key, node = entries[step]
        start, end = key.start_mark.index, _end(node)
        if _is_block(group):  # with the line end before it: the last line may have none
            return text[: text.rfind("\n", 0, start)] + text[_line_end(text, end) :]
        return text[: text.rfind(",", 0, start)] + text[end:]
    end = _end([node for name, (_, node) in entries.items() if name != "complete"][-1])
    if not _is_block(group):
        return f"{text[:end]}, {json.dumps(entry)[1:-1]}{text[end:]}"
    lines = f"{step}:{_written(value)}" if isinstance(step, str) else yaml_text(entry)
    end, (line, *more) = _line_end(text, end), lines.splitlines()
    margin = "\n" + " " * group.start_mark.column
    return margin.join((text[:end], line + remark, *more)) + text[end:]


def _replaced(text: str, key: yaml.Node, node: yaml.Node, value: object) -> str:
    """With another value behind a key, or on the lines below it, whatever its form was."""
    new = _written(value).replace("\n", "\n" + " " * key.start_mark.column)
    colon, start, end = text.index(":", key.end_mark.index) + 1, node.start_mark.index, _end(node)
    behind = text[end : _line_end(text, end)]  # a remark
    if _is_block(node):
        behind, start = text[colon : _line_end(text, colon)], colon
    rest = text[_line_end(text, end) :]
    if new.startswith("\n"):
        return text[:colon] + behind + new + rest
    return text[:colon] + (text[colon:start] or " ") + new.removeprefix(" ") + behind + rest


def _entries(node: yaml.Node | None) -> dict[str | int, tuple[yaml.Node, yaml.Node]]:
    """Key and value of each entry of a group; an item of a list stands for both."""
    if isinstance(node, yaml.MappingNode):
        return {key.value: (key, value) for key, value in node.value}
    items = node.value if isinstance(node, yaml.SequenceNode) else ()
    return {index: (item, item) for index, item in enumerate(items)}


def _is_block(node: yaml.Node) -> bool:
    return isinstance(node, yaml.CollectionNode) and not node.flow_style


def _end(node: yaml.Node) -> int:
    """Where the node's own text ends; the parser counts what follows a block to it."""
    if not _is_block(node):
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end(last[1] if isinstance(last, tuple) else last)


def _line_end(text: str, at: int) -> int:
    """Where the line ends, without its line end."""
    end = text.find("\n", at)
    return len(text) if end < 0 else end


def _written(value: object) -> str:
    """A value as it stands behind `key:`, or on the lines below."""
    if isinstance(value, Verbatim):
        return f" {value}"
    # The list keeps the dumper from writing a group of nothing but scalars in braces.
    return yaml_text({"_": value, "__": []}).removeprefix("_:").removesuffix("\n__: []\n")
