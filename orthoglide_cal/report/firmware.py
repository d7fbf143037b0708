"""What goes into the firmware of a linear delta: lines to paste, and what they cannot say.

All of them have a delta radius, tower angles and arms in common; an endstop is stated as

    Klipper          position_endstop: height of the nozzle, in the middle, at which it triggers
    RepRapFirmware   H + correction (M666), the three corrections summing to zero
    Marlin           H − adjustment (M666), no adjustment above zero

and the carriage stands at that height + √(arm² − radius²) then.

Sources: Klipper's "Configuration reference" ([stepper_a], delta kinematics); RepRapFirmware's
documents of M665 and M666; Marlin's M665.cpp, M666.cpp (no adjustment above zero is taken) and
motion.cpp: after homing the nozzle is believed at H less the probe's z offset (M851), each carriage
lowered by its adjustment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.errors import visible
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.report.controller import Export
from orthoglide_cal.words import plain

# Where the towers of all firmwares stand before any correction, in the order of their names [deg].
TOWERS = (210.0, 330.0, 90.0)
DECIMALS = 4
# Accepted causes that are in the lines, all others are not.
_ENTERED = frozenset(("leg_length",))
_ELSEWHERE = {
    "bed_shape": "a bed mesh follows it; make a new one",
    "encoder_scale": "correct the steps per millimetre of each tower",
}
_NOWHERE = "it has no setting for that: correct the fault"


@dataclass(frozen=True)
class FirmwareValues:
    """The numbers of a firmware.

    Attributes:
        arms: of towers a, b, c [mm].
        radius: delta radius [mm].
        angles: of towers a, b, c, counter-clockwise from x [deg].
        endstops: height of the nozzle, in the middle, at which each triggers [mm].
        bed: radius of the bed [mm].
    """

    arms: tuple[float, ...]
    radius: float
    angles: tuple[float, ...]
    endstops: tuple[float, ...]
    bed: float

    @property
    def equal_arms(self) -> bool:
        """Whether one length is enough."""
        return len({round(arm, DECIMALS) for arm in self.arms}) == 1

    @property
    def by_name(self) -> dict[str, float]:
        """Each value by the name that a calibration gives it; arms as arm_a, arm_b, arm_c."""
        names = [*"abc", "radius", *(f"{of}_{tower}" for of in ("angle", "arm") for tower in "abc")]
        values = (*self.endstops, self.radius, *self.angles, *self.arms)
        return dict(zip(names, values, strict=True))


def values_of(export: Export) -> FirmwareValues:
    """What is to be entered; arms that were accepted as longer are entered as they are."""
    model, answer = export.case.given.model, export.case.answer
    machine = LinearDelta.require(model.machine)
    *endstops, radius, angle_a, angle_b = (each.new(answer.decimals) for each in answer.parameters)
    nominal = np.array(machine.arm_length_mm)
    arms = nominal.copy()
    for effect in model.accepted:
        if effect.cause.id in _ENTERED:
            arms += effect.theta
    # The carriages stay where they are; longer arms let the nozzle down.
    lower = np.sqrt(arms**2 - radius**2) - np.sqrt(nominal**2 - radius**2)
    return FirmwareValues(
        tuple(arms.tolist()),
        radius,
        (angle_a, angle_b, machine.tower_angles_deg[2]),
        tuple((np.array(endstops) - lower).tolist()),
        machine.bed_radius_mm,
    )


def klipper(values: FirmwareValues) -> Iterator[str]:
    """Lines of the SAVE_CONFIG block of printer.cfg."""
    yield "# In printer.cfg, at its end: put these in place of the same lines of the SAVE_CONFIG"
    yield "# block. Paste nothing else there: every line of it begins with #*#."
    yield "# Where these settings stand above the block, too, delete them there: Klipper obeys"
    yield "# those first."
    yield "# Then type RESTART, home (G28), and make a new mesh (BED_MESH_CALIBRATE)."
    yield "#*# [printer]"
    yield f"#*# delta_radius = {_number(values.radius)}"
    for tower, *numbers in zip("abc", values.angles, values.arms, values.endstops, strict=True):
        angle, arm, endstop = map(_number, numbers)
        yield "#*#"
        yield f"#*# [stepper_{tower}]"
        yield f"#*# angle = {angle}"
        yield f"#*# arm_length = {arm}"
        yield f"#*# position_endstop = {endstop}"


def reprapfirmware(values: FirmwareValues) -> Iterator[str]:
    """M665 and M666 of config.g; towers a, b, c are X, Y, Z."""
    yield "; In config.g, in place of its M665 and M666; if config-override.g has them, too, delete"
    yield "; them there. Then restart, home (G28), and make a new height map (G29)."
    arms = values.arms[:1] if values.equal_arms else values.arms
    height = float(np.mean(values.endstops))
    lengths = ":".join(map(_number, arms))
    yield (
        f"M665 L{lengths} R{_number(values.radius)} H{_number(height)} B{_number(values.bed)}"
        f" {_towers(_trims(values))}"
    )
    yield f"M666 {_towers([endstop - height for endstop in values.endstops])}"
    if not values.equal_arms:
        yield "; Three lengths after L need RepRapFirmware 2.03 or newer."


def marlin(values: FirmwareValues) -> Iterator[str]:
    """M665 and M666, saved with M500; towers a, b, c are X, Y, Z."""
    yield "; Send these lines, then home (G28) and make a new mesh (G29). If Marlin knows a Z"
    yield "; offset of the probe (M851), add it to H with its sign: it takes it off again."
    yield "; M500 keeps the values only where Marlin has EEPROM_SETTINGS; otherwise enter them in"
    yield "; Configuration.h, too."
    arm = float(np.mean(values.arms))
    # No endstop may be adjusted upwards.
    height = min(values.endstops)
    line = f"M665 L{_number(arm)} R{_number(values.radius)} H{_number(height)}"
    line += f" {_towers(_trims(values))}"
    if not values.equal_arms:
        named = zip("ABC", values.arms, strict=True)
        line += "".join(f" {name}{_number(each - arm)}" for name, each in named)
    yield line
    yield f"M666 {_towers([height - endstop for endstop in values.endstops])}"
    yield "M500"
    if not values.equal_arms:
        yield "; A, B, C: each arm's excess over L. In old versions B meant something else: then"
        yield "; leave A, B and C out; the difference of the arms is not entered."


def _trims(values: FirmwareValues) -> list[float]:
    return [angle - usual for angle, usual in zip(values.angles, TOWERS, strict=True)]


def _towers(numbers: Sequence[float]) -> str:
    return " ".join(f"{n}{_number(v)}" for n, v in zip("XYZ", numbers, strict=True))


def _number(value: float) -> str:
    return plain(value, DECIMALS)


# Format → the name of the firmware, its lines, and what begins a comment.
FIRMWARES: Mapping[str, tuple[str, Callable[[FirmwareValues], Iterator[str]], str]] = {
    "klipper": ("Klipper", klipper, "#"),
    "reprapfirmware": ("RepRapFirmware", reprapfirmware, ";"),
    "marlin": ("Marlin", marlin, ";"),
}


def as_firmware(format: str, export: Export) -> str:
    """The lines to paste, with what they are and what they leave out as comments."""
    name, lines, sign = FIRMWARES[format]
    said = (*export.head(), *_left_out(name, export))
    after = [f"{sign} {visible(line)}" for line in export.afterwards()]
    return "\n".join(
        (*(f"{sign} {visible(line)}" for line in said), *lines(values_of(export)), *after, "")
    )


def _left_out(name: str, export: Export) -> Iterator[str]:
    """What the firmware has no setting for, and what of it is known of this machine."""
    own = " but when it is compiled" if name == "Marlin" else ""
    yield (
        f"{name} has no setting for towers that lean, nor for a radius of each tower{own}; the"
        " shape of the bed is left to its mesh."
    )
    case = export.case
    for id in dict.fromkeys(cause.id for cause in case.known):
        if id not in _ENTERED:
            yield f"Not in these lines: {id}; {_ELSEWHERE.get(id, _NOWHERE)}."
    unknown = [each.name for each in case.answer.parameters if not each.determined]
    if unknown:
        yield f"Left as they are, because these readings do not tell: {', '.join(unknown)}."
