"""Machine files (the contract in the README) to a `Model` and back; the one of the package."""

from __future__ import annotations

import functools
import re
from dataclasses import asdict
from datetime import date, datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError
from orthoglide_cal.files.text import (
    YAML_LIMIT,
    document_from_bytes,
    read_document,
)
from orthoglide_cal.files.yaml_tree import (
    Group,
    Tree,
    load_tree,
    not_negative,
    number,
    one_of,
    positive,
    text,
    version,
    word,
    yaml_text,
)
from orthoglide_cal.model import AXES, Effect, Estimate, Gauge, Machine, Model
from orthoglide_cal.model.model import KINDS

DEFAULT_NAME = "orthoglide_prototype.yaml"

_kind = one_of(KINDS, "This kind of machine is not known.")
_cause = one_of(CAUSES, "This is not a cause id.")


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
    return machine_from_tree(load_tree(read_document(str(path), YAML_LIMIT)))


def machine_from_text(content: str, path: str) -> Model:
    """The machine that the text of a machine file describes; `path` is its name in messages.

    Raises:
        InvalidFileError, InputError: as `read_machine`.
    """
    return machine_from_tree(load_tree(document_from_bytes(content.encode(), path)))


@functools.cache
def default_machine() -> Model:
    """The paper's prototype, from the file that comes with the package."""
    package, name = Path(str(files("orthoglide_cal"))), f"configs/{DEFAULT_NAME}"
    # In a wheel the file lies inside the package, in a source checkout beside it.
    inside = package / name
    found = inside if inside.is_file() else package.parent / name
    return machine_from_tree(load_tree(read_document(str(found))))


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
    if model is None or tree.faults:
        raise tree.faults.error()
    return model


def machine_in(file: Group) -> Model | None:
    """The machine that a group of keys describes; None after noting what is wrong with it."""
    file.take("schema_version", version)
    values = {
        "kind": file.take("kind", _kind, Machine.kind),
        "name": file.take("name", word),
        "leg_length_mm": file.take("leg_length_mm", positive),
        "parallelogram_width_mm": file.take("parallelogram_width_mm", positive),
        "tool_offset_mm": file.take("tool_offset_mm", not_negative),
        "joint_limits_mm": file.numbers("joint_limits_mm", 2),
        "workspace_mm": file.take("workspace_mm", positive),
        "gauge": _gauge(file.group("gauge")),
        "offsets_mm": _offsets(file.group("offsets_mm", required=False)),
        "homing_mm": file.take("homing_mm", positive, None),
        "tolerances": _tolerances(file.group("tolerances", required=False)),
    }
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


def machine_text(model: Model) -> str:
    """The machine file's text; `read_machine` gives back the same machine and causes."""
    return yaml_text(machine_values(model))


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
        "resolution_mm": group.take("resolution_mm", positive),
        "range_mm": group.take("range_mm", positive),
        "revolution_mm": group.take("revolution_mm", positive, None),
        "repeatability_mm": group.take("repeatability_mm", positive),
        "placement_mm": group.take("placement_mm", not_negative, None),
        "scale_u": group.take("scale_u", not_negative, None),
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
    offsets = tuple(group.take(axis, number, 0.0) for axis in AXES)
    group.refuse_unknown()
    return offsets


def _tolerances(group: Group) -> dict[str, float | None]:
    return {id: group.take(id, not_negative) for id in group.names(_cause)}


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
    rule = not_negative if id and CAUSES[id].positive else number
    value, std = group.take("value", rule), group.take("std", not_negative)
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
