"""What only the machine file of a linear delta says: towers, arms, endstops, bed and probe."""

from __future__ import annotations

from typing import Any

from orthoglide_cal.files.groups import Group, between, not_negative, positive
from orthoglide_cal.model.instrument import CALLIPER_MM, Probe
from orthoglide_cal.model.linear_delta import TOWERS, TOWERS_TURN, Endstops, counter_clockwise

_LENGTH = between(1.0, 1e5, positive)
_HEIGHT = between(-1e4, 1e4)
_FINE = between(1e-6, 10.0, positive)
_STEP = between(0.0, 10.0, not_negative)


def delta_values(file: Group) -> dict[str, Any]:
    """Fields of a `LinearDelta` from the keys of its file; faults are noted in the group."""
    arms, radius = _arms(file), file.take("delta_radius_mm", _LENGTH)
    angles, probe = file.numbers("tower_angles_deg", 3), file.group("probe")
    bed = file.take("bed_radius_mm", _LENGTH)
    ends = file.group("endstops_mm")
    endstops = tuple(ends.take(tower, _HEIGHT) for tower in TOWERS)
    ends.refuse_unknown()
    resolution = probe.take("resolution_mm", _STEP)
    repeatability = probe.take("repeatability_mm", _FINE)
    calliper, texture = (
        probe.take("calliper_mm", _FINE, CALLIPER_MM),
        probe.take("texture_mm", _STEP, None),
    )
    probe.refuse_unknown()
    if angles is not None and not counter_clockwise(angles):
        file.note(
            TOWERS_TURN,
            "Give the angles as the firmware has them, such as [210, 330, 90].",
            "tower_angles_deg",
        )
    if None not in (*arms, radius) and radius >= min(arms):
        file.note(
            "The radius is as large as an arm is long.",
            "Give the horizontal distance between the arm's joints with the tool in the middle.",
            "delta_radius_mm",
        )
    if angles is None or not (file.sound and probe.sound and ends.sound):
        return {}
    return {
        "arm_length_mm": arms,
        "delta_radius_mm": radius,
        "tower_angles_deg": angles,
        "endstops_mm": Endstops(*endstops),
        "bed_radius_mm": bed,
        "probe": Probe(
            resolution_mm=resolution,
            repeatability_mm=repeatability,
            calliper_mm=calliper,
            texture_mm=texture,
        ),
    }


def delta_keys(machine: Any) -> dict[str, Any]:
    """The same keys and values as the file has them."""
    return {
        "arm_length_mm": list(machine.arm_length_mm),
        "delta_radius_mm": machine.delta_radius_mm,
        "tower_angles_deg": list(machine.tower_angles_deg),
        "endstops_mm": machine.endstops_mm._asdict(),
        "bed_radius_mm": machine.bed_radius_mm,
        "probe": machine.probe.model_dump(exclude_none=True),
    }


def _arms(file: Group) -> tuple[Any, ...]:
    """One length for all arms, or one for each tower."""
    if isinstance(file.content.get("arm_length_mm"), list):
        given = file.numbers("arm_length_mm", 3) or (None,) * 3
        if all(each is not None and each > 1.0 for each in given):
            return given
        if None not in given:
            file.note("An arm is longer than a millimetre.", "Give it in mm.", "arm_length_mm")
        return (None,) * 3
    return (file.take("arm_length_mm", _LENGTH),) * 3
