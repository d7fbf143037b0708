"""Machine files (`orthocal guide machine`) to a `Model` and back; the one of the package.

Every number has bounds that no machine of this kind leaves: what lies beyond is a slip.
"""

from __future__ import annotations

import functools
import re
from dataclasses import asdict, dataclass, fields
from datetime import date, datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError
from orthoglide_cal.files.text import (
    YAML_LIMIT,
    Document,
    document_from_bytes,
    read_document,
)
from orthoglide_cal.files.yaml_tree import (
    Group,
    Tree,
    between,
    load_tree,
    not_negative,
    one_of,
    positive,
    text,
    version,
    word,
    yaml_text,
)
from orthoglide_cal.model import AXES, Details, Effect, Entered, Estimate, Gauge, Machine, Model
from orthoglide_cal.model.model import KINDS

DEFAULT_NAME = "orthoglide_prototype.yaml"

# Bounds [mm; tolerances and identified values in the units of their cause].
_LENGTH = between(1.0, 1e5, positive)
_TOOL = between(0.0, 1e5, not_negative)
_TRAVEL = between(1e-3, 1e3, positive)
_FINE = between(1e-6, 100.0, positive)
_PLACEMENT = between(0.0, 1e3, not_negative)
_SHARE = between(0.0, 1.0, not_negative)
LARGEST_OFFSET_MM = 1000.0
_OFFSET = between(-LARGEST_OFFSET_MM, LARGEST_OFFSET_MM)
_TOLERANCE = between(0.0, 1e6, not_negative)
_SMALLEST_TOLERANCE = 1e-9
# In usual sizes.
_LARGEST_TOLERANCE = 1000.0
_VALUE = between(-1e6, 1e6)
_WIDTH = between(0.0, 1e6, not_negative)

# What makes two machines different for the readings; the rest only says what is plausible.
_GEOMETRY = (
    "kind", "leg_length_mm", "parallelogram_width_mm", "tool_offset_mm", "joint_limits_mm",
    "identified",
)  # fmt: skip
# The first line of a file that the program wrote: without the last line it was cut off.
WRITTEN = "# Written by orthocal. The last line, `complete: true`, shows that nothing is missing.\n"

_kind = one_of(KINDS, "This kind of machine is not known.")
_cause = one_of(CAUSES, "This is not a cause id.")


@dataclass(frozen=True)
class StoredMachine:
    """A machine file as read.

    Attributes:
        model: the machine, with its accepted causes.
        document: the text.
        remarks: what the user should know although nothing is wrong.
    """

    model: Model
    document: Document
    remarks: tuple[str, ...]


def read_machine_file(path: Path | str) -> StoredMachine:
    """The machine file at a path ("-": standard input). Raises as `read_machine` does."""
    return machine_file_in(load_tree(read_document(str(path), YAML_LIMIT)))


def machine_file_in(tree: Tree) -> StoredMachine:
    """The machine file that a parsed document is. Raises as `read_machine` does."""
    model = machine_from_tree(tree)
    remark = "It does not say `identified:`. Was it cut off? If not, add the line `identified: []`."
    return StoredMachine(model, tree.document, () if "identified" in tree.value else (remark,))


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
            file=tree.document.path,
            line=1,
        )
    if "readings" in value and "machine" in value:
        raise InputError(
            "This is a session, not a machine file.",
            "Give it as the input; the machine that it was measured on is inside.",
            file=tree.document.path,
        )
    model = machine_in(Group(tree, (), value))
    if tree.document.text.startswith(WRITTEN) and "complete" not in value:
        tree.faults.add(
            "The last line, `complete: true`, is missing: the file was cut off.",
            "Take it from a copy; add the line only if you know that nothing is missing.",
            line=tree.document.text.count("\n"),
            column="complete",
        )
    if model is None or tree.faults:
        raise tree.faults.error()
    return model


def machine_in(file: Group) -> Model | None:
    """The machine that a group of keys describes; None after noting what is wrong with it."""
    file.take("schema_version", version)
    values = {
        "kind": file.take("kind", _kind, Machine.kind),
        "name": file.take("name", word),
        "leg_length_mm": file.take("leg_length_mm", _LENGTH),
        "parallelogram_width_mm": file.take("parallelogram_width_mm", _LENGTH),
        "tool_offset_mm": file.take("tool_offset_mm", _TOOL),
        "joint_limits_mm": file.numbers("joint_limits_mm", 2),
        "workspace_mm": file.take("workspace_mm", _LENGTH),
        "gauge": _gauge(file.group("gauge")),
        "offsets_mm": _offsets(file.group("offsets_mm", required=False)),
        "homing_mm": file.take("homing_mm", _TRAVEL, None),
        "tolerances": _tolerances(file.group("tolerances", required=False)),
        "history": tuple(_entered(entry) for entry in file.groups("history")),
        "report": _details(file.group("report", required=False)),
    }
    file.take("complete", one_of(("true",), "Only `true` can stand here."), None)
    accepted = [_identified(entry) for entry in file.groups("identified")]
    _check_limits(file, values["joint_limits_mm"], values["leg_length_mm"])
    file.refuse_unknown()
    if not file.sound:
        return None
    return Model(Machine(**values), tuple(effect for effect in accepted if effect))


def is_machine_file(tree: Tree) -> bool:
    """Whether a file without readings has a key that makes it a machine file, or means to."""
    keys = set(tree.value) if isinstance(tree.value, dict) else set()
    known = machine_values(default_machine()).keys() - {"name"}
    return "readings" not in keys and not known.isdisjoint(keys)


def machine_values(model: Model) -> dict[str, Any]:
    """Plain values of the machine file, in the file's order."""
    machine = model.machine
    homing = {} if machine.homing_mm is None else {"homing_mm": machine.homing_mm}
    details = {name: said for name, said in asdict(machine.report).items() if said is not None}
    return {
        "schema_version": 1,
        "kind": machine.kind,
        "name": machine.name,
        "leg_length_mm": machine.leg_length_mm,
        "parallelogram_width_mm": machine.parallelogram_width_mm,
        "tool_offset_mm": machine.tool_offset_mm,
        "joint_limits_mm": list(machine.joint_limits_mm),
        "workspace_mm": machine.workspace_mm,
        "gauge": _stated(machine.gauge),
        "offsets_mm": dict(zip(AXES, machine.offsets_mm, strict=True)),
        **homing,
        "tolerances": dict(machine.tolerances),
        **({"report": details} if details else {}),
        "history": [
            {
                "date": each.date,
                "before": dict(zip(AXES, each.before_mm, strict=True)),
                "after": dict(zip(AXES, each.after_mm, strict=True)),
                "data_sha256": each.data_sha256,
            }
            for each in machine.history
        ],
        "identified": [
            {
                "cause": effect.cause.id,
                "where": "",
                "parameters": {name: _plain(each) for name, each in effect.estimates.items()},
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
    return [name for name in _GEOMETRY if first[name] != second[name]]


def machine_text(model: Model) -> str:
    """The machine file's text; `read_machine` gives back the same machine and causes.

    Its last line shows that nothing was cut off.
    """
    return WRITTEN + yaml_text({**machine_values(model), "complete": True})


def _plain(estimate: Estimate) -> dict[str, Any]:
    """Values to twelve digits, so that a file read and written again says the same in its units."""
    value, std = (float(f"{size:.12g}") for size in (estimate.value, estimate.std))
    return {"value": value, "std": std, "unit": estimate.unit}


def _check_limits(file: Group, limits: tuple[float, ...] | None, length: float | None) -> None:
    if limits is None:
        return
    if not limits[0] < 0.0 < limits[1]:
        file.note(
            "The limits must be ordered, with the isotropic posture (0) between them.",
            "Give displacements from the isotropic posture, such as [-100, 60].",
            "joint_limits_mm",
        )
        return
    for index, limit in enumerate(limits):
        if length is not None and abs(limit) >= length:
            file.note(
                f"The limit is beyond the leg's length of {length} mm.",
                "Give the displacement from the isotropic posture, not the joint value.",
                "joint_limits_mm",
                index,
            )


def _gauge(group: Group) -> Gauge | None:
    values = {
        "resolution_mm": group.take("resolution_mm", _FINE),
        "range_mm": group.take("range_mm", _TRAVEL),
        "revolution_mm": group.take("revolution_mm", _TRAVEL, None),
        "repeatability_mm": group.take("repeatability_mm", _FINE),
        "placement_mm": group.take("placement_mm", _PLACEMENT, None),
        "scale_u": group.take("scale_u", _SHARE, None),
    }
    group.refuse_unknown()
    return Gauge(**values) if group.sound else None


def _stated(gauge: Gauge) -> dict[str, float | None]:
    """What is stated of a gauge; no revolution is a statement, too."""
    values = asdict(gauge)
    return {
        key: value for key, value in values.items() if value is not None or key == "revolution_mm"
    }


def _offsets(group: Group) -> tuple[float | None, ...]:
    offsets = tuple(group.take(axis, _OFFSET, 0.0) for axis in AXES)
    group.refuse_unknown()
    return offsets


def _entered(entry: Group) -> Entered | None:
    """One entry of the history."""
    sides = []
    for key in ("before", "after"):
        side = entry.group(key)
        sides.append(tuple(side.take(axis, _OFFSET) for axis in AXES))
        side.refuse_unknown()
    date, sha256 = entry.take("date", _day), entry.take("data_sha256", _digest)
    entry.refuse_unknown()
    return Entered(date, sides[0], sides[1], sha256) if entry.sound else None


def _details(group: Group) -> Details:
    """Details for reports; none of them is required."""
    names = [field.name for field in fields(Details)]
    rules = {name: _day if name == "gauge_due" else word for name in names}
    details = Details(**{name: group.take(name, rule, None) for name, rule in rules.items()})
    group.refuse_unknown()
    return details


def _tolerances(group: Group) -> dict[str, float | None]:
    return {id: group.take(id, functools.partial(_tolerance, id)) for id in group.names(_cause)}


def _tolerance(id: str, value: Any) -> float:
    """A plausible size; one that nothing could have is a slip."""
    size = _TOLERANCE(value)
    usual = max(CAUSES[id].sizes.values(), default=float("inf"))
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


def _identified(entry: Group) -> Effect | None:
    id = entry.take("cause", _lasting)
    entry.take("where", _nowhere, None)
    group = entry.group("parameters")
    named = {name: _estimate(group.group(name), id) for name in group.names(word)}
    date, sha256 = entry.take("date", _day), entry.take("data_sha256", _digest)
    correlation = entry.rows("correlation")
    if entry.sound:
        names = CAUSES[id].names
        if named.keys() != set(names):
            what = f"{id} has the parameters {', '.join(names)}."
            entry.note(what, "Give each of them once.", "parameters")
        if correlation:
            _check_correlation(entry, correlation, len(named))
    entry.refuse_unknown()
    if not entry.sound:
        return None
    estimates = {name: estimate for name, estimate in named.items() if estimate is not None}
    matrix = np.array(correlation) if correlation else np.eye(len(estimates))
    return CAUSES[id].estimated(estimates, matrix).accepted(date, sha256)


def _nowhere(value: Any) -> str:
    """What lasts acts on the whole machine."""
    if text(value):
        raise InputError("An accepted cause acts on the whole machine.", 'Write where: "".')
    return ""


def _lasting(value: Any) -> str:
    """Id of a cause that the same machine still has in the next session."""
    id = _cause(value)
    if not CAUSES[id].lasting:
        lasting = ", ".join(cause.id for cause in CAUSES.values() if cause.lasting)
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
