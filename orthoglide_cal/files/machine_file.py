"""Machine files (`orthocal guide machine`) to a `Model` and back; the one of the package.

Every number has bounds that no machine of this kind leaves: what lies beyond is a slip.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date, datetime
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError
from orthoglide_cal.files.delta_machine import delta_keys, delta_values
from orthoglide_cal.files.groups import (
    Group,
    between,
    not_negative,
    one_of,
    positive,
    text,
    version,
    word,
)
from orthoglide_cal.files.orthoglide_machine import OFFSET, orthoglide_keys, orthoglide_values
from orthoglide_cal.files.text import (
    YAML_LIMIT,
    FileText,
    document_from_bytes,
    read_document,
)
from orthoglide_cal.files.yaml_tree import Tree, load_tree, yaml_text
from orthoglide_cal.model import AXES, Details, Effect, Entered, Estimate, Machine, Model
from orthoglide_cal.model.machine import JointOffsets
from orthoglide_cal.model.machines import MACHINES, AnyMachine

# A section that only a Klipper configuration has, or a part of one.
PRINTER_SECTION = re.compile(
    r"^(#\*# )?\[\s*(printer|stepper_\w+|mcu|bed_mesh|gcode_macro|include)\b",
    re.MULTILINE | re.IGNORECASE,
)
DEFAULT_NAME = "orthoglide_prototype.yaml"

# Bounds [mm; tolerances and identified values in the units of their cause].
_TRAVEL = between(1e-3, 1e3, positive)
_TOLERANCE = between(0.0, 1e6, not_negative)
_SMALLEST_TOLERANCE = 1e-9
# In usual sizes.
_LARGEST_TOLERANCE = 1000.0
_VALUE = between(-1e6, 1e6)
_WIDTH = between(0.0, 1e6, not_negative)

# The first line of a file that the program wrote: without the last line it was cut off.
WRITTEN = "# Written by orthocal. The last line, `complete: true`, shows that nothing is missing.\n"

_MACHINE: TypeAdapter[Machine] = TypeAdapter(AnyMachine)
_kind = one_of(MACHINES, "This kind of machine is not known.")


@dataclass(frozen=True)
class StoredMachine:
    """A machine file as read.

    Attributes:
        model: the machine, with its accepted causes.
        document: the text.
        remarks: what the user should know although nothing is wrong.
    """

    model: Model
    document: FileText
    remarks: tuple[str, ...]


def read_machine_file(path: Path | str) -> StoredMachine:
    """The machine file at a path ("-": standard input). Raises as `read_machine` does."""
    document = read_document(str(path), YAML_LIMIT)
    if PRINTER_SECTION.search(document.text):
        raise InputError(
            "This is a printer's configuration, not a machine file.",
            "Give it to solve, diagnose or plan as their input: it describes its machine itself.",
            file=document.path,
        )
    return machine_file_in(load_tree(document))


def machine_file_in(tree: Tree) -> StoredMachine:
    """The machine file that a parsed document is. Raises as `read_machine` does."""
    model = machine_from_tree(tree)
    remark = "It does not say `identified:`. Was it cut off? If not, add the line `identified: []`."
    return StoredMachine(model, tree.file, () if "identified" in tree.value else (remark,))


def read_machine(path: Path | str | None = None) -> Model:
    """The machine described by a file, with its accepted causes; the prototype for None.

    Args:
        path: machine file; "-" is standard input.

    Raises:
        InvalidFileError: everything in it that breaks the schema, each with line and path.
        InputError: not readable, not YAML, or not a machine file.
    """
    if path is None:
        return default_machine()
    return read_machine_file(path).model


def machine_from_text(content: str, path: str) -> Model:
    """The machine that the text of a machine file describes; `path` is its name in messages.

    Raises:
        InvalidFileError, InputError: as `read_machine`.
    """
    return machine_from_tree(load_tree(document_from_bytes(content.encode(), path)))


@functools.cache
def default_machine() -> Model:
    """The paper's prototype, from the file that comes with the package."""
    return read_machine(shipped_folder() / DEFAULT_NAME)


def shipped_machine(kind: str) -> Path:
    """The machine file that comes with the program for a kind; the prototype's for others."""
    return shipped_folder() / (_SHAPES[kind].shipped if kind in _SHAPES else DEFAULT_NAME)


def shipped_folder() -> Path:
    """Where the machine files are that come with the program; they are never changed."""
    package = Path(str(files("orthoglide_cal")))
    # In a wheel the folder lies inside the package, in a source checkout beside it.
    inside = package / "configs"
    return inside if inside.is_dir() else package.parent / "configs"


def machine_from_tree(tree: Tree) -> Model:
    """The machine that a parsed file describes. Raises as `read_machine` does."""
    value = tree.value
    if not isinstance(value, dict):
        raise InputError(
            "This is not a machine file.",
            f"Copy configs/{DEFAULT_NAME} and change its values.",
            file=tree.file.path,
            line=1,
        )
    if "readings" in value and "machine" in value:
        raise InputError(
            "This is a session, not a machine file.",
            "Give it as the input; the machine that it was measured on is inside.",
            file=tree.file.path,
        )
    model = machine_in(Group(tree, (), value))
    if tree.file.text.startswith(WRITTEN) and "complete" not in value:
        tree.faults.add(
            "The last line, `complete: true`, is missing: the file was cut off.",
            "Take it from a copy; add the line only if you know that nothing is missing.",
            line=tree.file.text.count("\n"),
            column="complete",
        )
    if model is None or tree.faults:
        raise tree.faults.error()
    return model


def machine_in(file: Group) -> Model | None:
    """The machine that a group of keys describes; None after noting what is wrong with it."""
    file.take("schema_version", version)
    likely = _likeliest(file)
    kind = file.take("kind", _kind, likely)
    if kind != "orthoglide" and "kind" not in file.content:
        remedy = f"Add a line `kind: {kind}`."
        file.tree.faults.add("The key is missing.", remedy, line=1, column="kind")
    shape = _SHAPES[kind or likely]
    values = {
        "kind": kind,
        "name": file.take("name", word),
        **shape.read(file),
        "homing_mm": file.take("homing_mm", _TRAVEL, None),
        "tolerances": _tolerances(file.group("tolerances", required=False), kind),
        "history": tuple(_entered(entry) for entry in file.groups("history")),
        "report": _details(file.group("report", required=False)),
    }
    file.take("complete", one_of(("true",), "Only `true` can stand here."), None)
    accepted = [_identified(entry, kind) for entry in file.groups("identified")]
    file.refuse_unknown()
    if not file.sound:
        return None
    return Model(_MACHINE.validate_python(values), tuple(effect for effect in accepted if effect))


class _Shape(NamedTuple):
    """What the machine file of a kind says that others do not."""

    read: Callable[[Group], dict[str, Any]]
    keys: Callable[[Machine], dict[str, Any]]
    # What makes two machines different for the readings; the rest only says what is plausible.
    geometry: tuple[str, ...]
    shipped: str


_SHAPES = {
    "orthoglide": _Shape(
        orthoglide_values,
        orthoglide_keys,
        ("leg_length_mm", "parallelogram_width_mm", "tool_offset_mm", "joint_limits_mm"),
        DEFAULT_NAME,
    ),
    "linear_delta": _Shape(
        delta_values,
        delta_keys,
        ("arm_length_mm", "delta_radius_mm", "tower_angles_deg", "endstops_mm"),
        "linear_delta.yaml",
    ),
}


def _likeliest(file: Group) -> str:
    """What a file of an unknown kind most likely means, so that only its kind is at fault."""
    return max(_SHAPES, key=lambda id: len(file.content.keys() & set(_SHAPES[id].geometry)))


def is_machine_file(tree: Tree) -> bool:
    """Whether a file without readings has a key that makes it a machine file, or means to."""
    keys = set(tree.value) if isinstance(tree.value, dict) else set()
    known = machine_values(default_machine()).keys() - {"name"}
    return "readings" not in keys and not known.isdisjoint(keys)


def machine_values(model: Model) -> dict[str, Any]:
    """Plain values of the machine file, in the file's order."""
    machine, shape = model.machine, _SHAPES[model.machine.kind]
    homing = {} if machine.homing_mm is None else {"homing_mm": machine.homing_mm}
    details = machine.report.model_dump(exclude_none=True)
    return {
        "schema_version": 1,
        "kind": machine.kind,
        "name": machine.name,
        **shape.keys(machine),
        **homing,
        "tolerances": dict(machine.tolerances),
        **({"report": details} if details else {}),
        "history": [
            {
                "date": each.date,
                "before": each.before._asdict(),
                "after": each.after._asdict(),
                "data_sha256": each.data_sha256,
            }
            for each in machine.history
        ],
        "identified": [
            {
                "cause": effect.cause.id,
                "where": "",
                "parameters": {name: _plain(each) for name, each in model.called(effect).items()},
                "date": effect.date,
                "data_sha256": effect.data_sha256,
                "correlation": effect.correlation.round(6).tolist(),
            }
            for effect in model.accepted
        ],
    }


def differing(one: Model, other: Model) -> list[str]:
    """Keys in which two machines differ so that they read differently."""
    first, second = machine_values(one), machine_values(other)
    names = ("kind", *_SHAPES[one.machine.kind].geometry, "identified")
    return [name for name in names if first[name] != second.get(name)]


def machine_text(model: Model) -> str:
    """The machine file's text; `read_machine` gives back the same machine and causes.

    Its last line shows that nothing was cut off.
    """
    return WRITTEN + yaml_text({**machine_values(model), "complete": True})


def _plain(estimate: Estimate) -> dict[str, Any]:
    """Values to twelve digits, so that a file read and written again says the same in its units."""
    value, std = (float(f"{size:.12g}") for size in (estimate.value, estimate.std))
    return {"value": value, "std": std, "unit": estimate.unit}


def _entered(entry: Group) -> Entered | None:
    """One entry of the history."""
    sides = []
    for key in ("before", "after"):
        side = entry.group(key)
        sides.append(tuple(side.take(axis, OFFSET) for axis in AXES))
        side.refuse_unknown()
    date, sha256 = entry.take("date", _day), entry.take("data_sha256", _digest)
    entry.refuse_unknown()
    if not entry.sound:
        return None
    before, after = (JointOffsets(*side) for side in sides)
    return Entered(date=date, before=before, after=after, data_sha256=sha256)


def _details(group: Group) -> Details:
    """Details for reports; none of them is required."""
    names = list(Details.model_fields)
    rules = {name: _day if name == "gauge_due" else word for name in names}
    details = Details(**{name: group.take(name, rule, None) for name, rule in rules.items()})
    group.refuse_unknown()
    return details


def _tolerances(group: Group, kind: str | None) -> dict[str, float | None]:
    """Sizes of the causes that a machine of this kind can have."""
    return {
        id: group.take(id, functools.partial(_tolerance, id, kind))
        for id in group.names(_cause_of(kind))
    }


def _cause_of(kind: str | None) -> Callable[[Any], str]:
    """The rule for ids of the causes that a machine of this kind can have."""
    known = [id for id, cause in CAUSES.items() if kind is None or MACHINES[kind] in cause.sizes]
    return one_of(known, "This is not a cause id of this kind of machine.")


def _tolerance(id: str, kind: str | None, value: Any) -> float:
    """A plausible size; one that nothing could have is a slip."""
    size = _TOLERANCE(value)
    usual = CAUSES[id].sizes[MACHINES[kind]] if kind else float("inf")
    if size > _LARGEST_TOLERANCE * usual:
        raise InputError(
            f"That is more than {_LARGEST_TOLERANCE:g} times the usual size of {id}, {usual:g}.",
            f"Give it in {CAUSES[id].unit or 'its unit'}.",
        )
    if 0.0 < size < _SMALLEST_TOLERANCE:
        raise InputError(
            f"The number must be 0, or from {_SMALLEST_TOLERANCE:g}.", "Give 0 to rule it out."
        )
    return size


def _day(value: Any) -> str:
    """An ISO date, perhaps with the time."""
    try:
        date.fromisoformat(text(value)[:10])
        datetime.fromisoformat(text(value))
    except ValueError as error:
        raise InputError("This is not a date.", "Write it as 2025-01-31.") from error
    return text(value)


def _digest(value: Any) -> str:
    """A SHA-256 digest."""
    if not re.fullmatch("[0-9a-f]{64}", text(value)):
        raise InputError("This is not a SHA-256 digest.", "Give its 64 hexadecimal digits.")
    return text(value)


def _identified(entry: Group, kind: str | None) -> Effect | None:
    id = entry.take("cause", functools.partial(_lasting, kind))
    entry.take("where", _nowhere, None)
    group = entry.group("parameters")
    named = {name: _estimate(group.group(name), id) for name in group.names(word)}
    date, sha256 = entry.take("date", _day), entry.take("data_sha256", _digest)
    correlation = entry.rows("correlation")
    if entry.sound:
        names = MACHINES[kind or "orthoglide"].named(CAUSES[id].names)
        if named.keys() != set(names.values()):
            what = f"{id} has the parameters {', '.join(names.values())}."
            entry.note(what, "Give each of them once.", "parameters")
        if correlation:
            _check_correlation(entry, correlation, len(named))
    entry.refuse_unknown()
    if not entry.sound:
        return None
    own = {called: name for name, called in names.items()}
    estimates = {own[name]: each for name, each in named.items() if each is not None}
    matrix = np.array(correlation) if correlation else np.eye(len(estimates))
    return CAUSES[id].estimated(estimates, matrix).accepted(date, sha256)


def _nowhere(value: Any) -> str:
    """What lasts acts on the whole machine."""
    if text(value):
        raise InputError("An accepted cause acts on the whole machine.", 'Write where: "".')
    return ""


def _lasting(kind: str | None, value: Any) -> str:
    """Id of a cause that the same machine still has in the next session."""
    id = _cause_of(kind)(value)
    if not CAUSES[id].lasting:
        own = (
            CAUSES[each] for each in CAUSES if kind is None or MACHINES[kind] in CAUSES[each].sizes
        )
        lasting = ", ".join(cause.id for cause in own if cause.lasting)
        raise InputError("This cause cannot be part of a machine.", f"Use one of {lasting}.")
    return id


def _estimate(group: Group, id: str | None) -> Estimate | None:
    rule = _WIDTH if id and CAUSES[id].positive else _VALUE
    value, std = group.take("value", rule), group.take("std", _WIDTH)
    unit = group.take("unit", text)
    group.refuse_unknown()
    wanted = CAUSES[id].unit if id else unit
    if group.sound and unit != wanted:
        group.note(
            f"{id} is measured in {wanted or 'no unit'}, not {unit!r}.",
            f"Convert the value and its std, and write unit: {wanted!r}.",
            "unit",
        )
    return Estimate(value, std, unit) if group.sound else None


def _check_correlation(entry: Group, rows: tuple[tuple[float, ...], ...], size: int) -> None:
    if {len(rows), *map(len, rows)} != {size}:
        entry.note(
            f"The correlations are not {size} rows of {size} numbers.",
            "Give one row for each parameter, in their order, or remove them.",
            "correlation",
        )
        return
    matrix = np.array(rows)
    if (
        np.abs(matrix - matrix.T).max() > 1e-5
        or np.abs(np.diag(matrix) - 1.0).max() > 1e-5
        or np.linalg.eigvalsh(matrix)[0] < -1e-5
    ):
        entry.note(
            "These numbers are not correlations.",
            "They are symmetric, with ones on the diagonal, and of no negative variance.",
            "correlation",
        )
