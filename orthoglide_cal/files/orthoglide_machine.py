"""What only the machine file of an Orthoglide says: legs, travel, gauge and joint offsets."""

from __future__ import annotations

from typing import Any

from orthoglide_cal.files.groups import Group, between, not_negative, positive
from orthoglide_cal.model import AXES, Gauge
from orthoglide_cal.model.machine import LARGEST_OFFSET_MM, JointOffsets, Machine
from orthoglide_cal.model.orthoglide import Orthoglide

# Bounds [mm].
_LENGTH = between(1.0, 1e5, positive)
_TOOL = between(0.0, 1e5, not_negative)
_TRAVEL = between(1e-3, 1e3, positive)
_FINE = between(1e-6, 100.0, positive)
_PLACEMENT = between(0.0, 1e3, not_negative)
_SHARE = between(0.0, 1.0, not_negative)
OFFSET = between(-LARGEST_OFFSET_MM, LARGEST_OFFSET_MM)


def orthoglide_values(file: Group) -> dict[str, Any]:
    """Fields of a `Machine` from the keys of its file; faults are noted in the group."""
    values = {
        "leg_length_mm": file.take("leg_length_mm", _LENGTH),
        "parallelogram_width_mm": file.take("parallelogram_width_mm", _LENGTH),
        "tool_offset_mm": file.take("tool_offset_mm", _TOOL),
        "joint_limits_mm": file.numbers("joint_limits_mm", 2),
        "workspace_mm": file.take("workspace_mm", _LENGTH),
        "gauge": _gauge(file.group("gauge")),
        "offsets_mm": _offsets(file.group("offsets_mm", required=False)),
    }
    _check_limits(file, values["joint_limits_mm"], values["leg_length_mm"])
    return values


def orthoglide_keys(nominal: Machine) -> dict[str, Any]:
    """The same keys and values as the file has them."""
    machine = Orthoglide.require(nominal)
    return {
        "leg_length_mm": machine.leg_length_mm,
        "parallelogram_width_mm": machine.parallelogram_width_mm,
        "tool_offset_mm": machine.tool_offset_mm,
        "joint_limits_mm": list(machine.joint_limits_mm),
        "workspace_mm": machine.workspace_mm,
        "gauge": _stated(machine.gauge),
        "offsets_mm": dict(zip(AXES, machine.offsets_mm, strict=True)),
    }


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
    values = gauge.model_dump()
    return {
        key: value for key, value in values.items() if value is not None or key == "revolution_mm"
    }


def _offsets(group: Group) -> JointOffsets:
    offsets = JointOffsets(*(group.take(axis, OFFSET, 0.0) for axis in AXES))
    group.refuse_unknown()
    return offsets
