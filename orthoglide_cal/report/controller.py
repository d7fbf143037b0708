"""Exports for the controller: a page of text, lines to paste, a table of corrections.

All firmwares of a linear delta have a delta radius, tower angles and arms in common; an endstop is
stated as

    Klipper          position_endstop: height of the nozzle, in the middle, at which it triggers
    RepRapFirmware   H + correction (M666), the three corrections summing to zero
    Marlin           H − adjustment (M666), no adjustment above zero

and the carriage stands at that height + √(arm² − radius²) then.

Sources: Klipper's "Configuration reference" ([stepper_a], delta kinematics); RepRapFirmware's
documents of M665 and M666; Marlin's M665.cpp, M666.cpp (no adjustment above zero is taken) and
motion.cpp: after homing the nozzle is believed at H less the probe's z offset (M851), each carriage
lowered by its adjustment.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np

from orthoglide_cal.causes import CAUSES, correcting
from orthoglide_cal.errors import file_words, visible
from orthoglide_cal.files.controller_file import ControllerFile
from orthoglide_cal.files.probe_readings import USUAL_ANGLES_DEG
from orthoglide_cal.files.text import csv_text
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.model.workspace import Compensation
from orthoglide_cal.report.case import NOT_NEEDED, Case, check_words
from orthoglide_cal.results import Correction, Identity
from orthoglide_cal.words import coverage_words, plain, two_figures, typed

_DECIMALS = 4  # of a table and of a firmware: tenths of a micrometre


def _around(
    case: Case, identity: Identity, lines: Iterable[str], sign: str = "", *remarks: str
) -> str:
    """The lines to enter, below title, origin and warnings, above what to do then.

    Each of the others begins with `sign`, as a comment does. A forced result is marked as such.
    """
    release = case.answer.release
    head = [
        f"{case.words.title} for {case.machine.name}, {identity.number}",
        f"Issued {identity.issued:%Y-%m-%d %H:%M} UTC by {identity.software}",
        f"From {file_words(case.source.path)}, SHA-256 {case.source.sha256}",
        *(["FORCED: this result must not be used."] if release.reasons else []),
        *map(case.says, release.reasons),
        *([f"Note: {NOT_NEEDED}."] if release.settled else []),
        *(f"Note: {case.says(caution)}" for caution in release.cautions),
        *remarks,
    ]
    after = []
    if not release.settled:  # else nothing is entered
        after.append(f"After entering: {case.words.restart[0].lower()}{case.words.restart[1:]}")
        if case.answer.check is not None:
            after.append(check_words(case.answer.check))
        if case.record is not None:
            after.append(f"Record what was entered: {case.record}")
    if case.table is not None:
        after.append(f"Correct the remaining errors with a table: {case.table}")
    if not release.settled:
        after.append(f"Then measure again and run: {case.verify}")
    above, below = ([f"{sign}{visible(line)}" for line in part] for part in (head, after))
    return "\n".join((*above, *lines, *below, ""))


def exported(format: str, case: Case, identity: Identity) -> str:
    """What goes into a controller: a page of text, or lines to paste; with what those leave out."""
    if format == "text":
        return _around(case, identity, _text(case))
    if case.machine.adds_to_joints:
        return _around(case, identity, _joints(case), "# ")
    name, lines, sign = FIRMWARES[format]
    left_out = _left_out(name, case)
    return _around(case, identity, lines(firmware_machine(case)), f"{sign} ", *left_out)


def _text(case: Case) -> Sequence[str]:
    """For any controller: "the controller says X, truly Y"."""
    answer, home = case.answer, case.machine.home_mm
    digits = answer.decimals
    says, posture = plain(home, digits), [f"{case.words.home}, as the controller is set now:"]
    unit, rows = case.machine.common_unit, [("", "previous", "change", "U", "enter")]
    for row in answer.parameters:
        name = row.name if unit else f"{row.name}, {row.unit}"
        change = typed(row.change(digits), digits) if row.determined else "unknown"
        active, new = plain(row.active, digits), plain(row.new(digits), digits)
        rows.append((name, active, change, two_figures(row.expanded), new))
        truly = plain(home + row.change(digits), digits)
        posture.append(f"{row.name}: the controller says {says} mm, truly {truly} mm")
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "",
        f"{case.words.title}{unit} ({case.words.relation}; U: expanded"
        f" uncertainty, {coverage_words(answer.k or 0.0)}, {100 * answer.confidence:.0f} %)",
        *("  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in rows),
        "",
        *((*posture, "") if case.words.home else ()),
    ]


def _joints(case: Case) -> Iterator[str]:
    """Comments and one [JOINT_n] section per axis; true position = indicated + HOME_OFFSET."""
    digits = case.answer.decimals
    yield "#"
    yield "# HOME_OFFSET takes the joint offset with its sign, in mm (divide by 25.4 if"
    yield "# LINEAR_UNITS is inch). If yours holds more than the offset, such as the place of the"
    yield "# home switch, add the change to it instead of replacing it."
    for number, row in enumerate(case.answer.parameters):
        change = f"{typed(row.change(digits), digits)} (U = {two_figures(row.expanded)})"
        yield from ("", f"[JOINT_{number}]")
        yield f"# axis {row.name}: previous {typed(row.active, digits)}, change {change}"
        yield f"HOME_OFFSET = {plain(row.new(digits), digits)}"
    yield ""


def as_table(table: Compensation, case: Case, identity: Identity) -> str:
    """One row per grid point: where the tool is wanted, and what to add to the joint values."""
    head = (
        *(f"{axis}_mm" for axis in AXES),
        *(f"add_to_joint_{axis}_mm" for axis in AXES),
        *("status", "causes", "not_compensated", "number"),
    )
    status = "FORCED" if case.answer.release.reasons else "released"
    stamp = (status, " ".join(table.causes), " ".join(table.left_out), identity.number)
    values = np.hstack((table.points_mm, table.corrections_mm)).tolist()
    return csv_text(head, ((*map(_number, row), *stamp) for row in values))


# --- firmwares of a linear delta --------------------------------------------------------------


def firmware_machine(case: Case) -> LinearDelta:
    """The machine as its firmware is to have it, with arms that were accepted as longer."""
    model, answer = case.given.model, case.answer
    machine = LinearDelta.require(model.machine)
    *endstops, radius, angle_a, angle_b = (row.new(answer.decimals) for row in answer.parameters)
    arms = np.array(machine.arm_length_mm)
    for effect in model.accepted:
        if effect.cause.id in machine.fixed_parameters:
            arms += effect.theta
    return machine.changed(
        arm_length_mm=tuple(arms.tolist()),
        delta_radius_mm=radius,
        tower_angles_deg=(angle_a, angle_b, machine.tower_angles_deg[2]),
        endstops_mm=tuple(endstops),
    )


def firmware_values(
    case: Case, made: Sequence[Correction] = (), file: ControllerFile | None = None
) -> dict[str, float]:
    """The same by the names that a calibration gives them; arms as arm_a, arm_b, arm_c.

    With corrections of named causes: longer arms, and pitch_a, pitch_b, pitch_c [mm per turn] of
    the towers' scales; a carriage then stands elsewhere at its endstop.
    """
    new = firmware_machine(case)
    names = [*"abc", "radius", *(f"{of}_{tower}" for of in ("angle", "arm") for tower in "abc")]
    values = (*new.endstops_mm, new.delta_radius_mm, *new.tower_angles_deg, *new.arm_length_mm)
    setting, known = (
        dict(zip(names, values, strict=True)),
        {e.cause.id for e in case.given.model.accepted},
    )
    home, heights = new.home_mm, new.endstop_carriages_mm
    settings = file.settings if file else {}
    for id, tower, value in ((one.id, one.name, one.value) for one in made):
        if not CAUSES[id].by_joint:
            setting[f"arm_{tower}"] += 0.0 if id in known else value
            continue
        (effect,) = correcting(new, {id: {tower: value}})
        at = "abc".index(tower)
        low, high = effect.cause.correction(-effect.theta, np.array([home, home + 1.0]), home)[
            0, :, at
        ]
        excess = 1.0 / (1.0 + high - low)
        setting[f"pitch_{tower}"] = float(settings[f"pitch_{tower}"].before) * excess
        setting[tower] += (excess - 1.0) * (heights[at] - home)
    return setting


def klipper(new: LinearDelta) -> Iterator[str]:
    """Lines of the SAVE_CONFIG block of printer.cfg."""
    yield "# In printer.cfg, at its end: put these in place of the same lines of the SAVE_CONFIG"
    yield "# block. Paste nothing else there: every line of it begins with #*#."
    yield "# Where these settings stand above the block, too, delete them there: Klipper obeys"
    yield "# those first."
    yield "# Then type RESTART, home (G28), and make a new mesh (BED_MESH_CALIBRATE)."
    yield "#*# [printer]"
    yield f"#*# delta_radius = {_number(new.delta_radius_mm)}"
    towers = new.tower_angles_deg, new.arm_length_mm, new.endstops_mm
    for tower, *numbers in zip("abc", *towers, strict=True):
        yield from ("#*#", f"#*# [stepper_{tower}]")
        named = zip(("angle", "arm_length", "position_endstop"), numbers, strict=True)
        yield from (f"#*# {name} = {_number(value)}" for name, value in named)


def reprapfirmware(new: LinearDelta) -> Iterator[str]:
    """M665 and M666 of config.g; towers a, b, c are X, Y, Z."""
    yield "; In config.g, in place of its M665 and M666; if config-override.g has them, too, delete"
    yield "; them there. Then restart, home (G28), and make a new height map (G29)."
    arms = new.arm_length_mm[:1] if _equal(new) else new.arm_length_mm
    lengths, height = ":".join(map(_number, arms)), float(np.mean(new.endstops_mm))
    radius, bed = _number(new.delta_radius_mm), _number(new.bed_radius_mm)
    yield f"M665 L{lengths} R{radius} H{_number(height)} B{bed} {_turned(new)}"
    yield f"M666 {_towers([endstop - height for endstop in new.endstops_mm])}"
    if not _equal(new):
        yield "; Three lengths after L need RepRapFirmware 2.03 or newer."


def marlin(new: LinearDelta) -> Iterator[str]:
    """M665 and M666, saved with M500; towers a, b, c are X, Y, Z."""
    yield "; Send these lines, then home (G28) and make a new mesh (G29). If Marlin knows a Z"
    yield "; offset of the probe (M851), add it to H with its sign: it takes it off again."
    yield "; M500 keeps the values only where Marlin has EEPROM_SETTINGS; otherwise enter them in"
    yield "; Configuration.h, too."
    arm = float(np.mean(new.arm_length_mm))
    # No endstop may be adjusted upwards.
    height = min(new.endstops_mm)
    radius = _number(new.delta_radius_mm)
    line = f"M665 L{_number(arm)} R{radius} H{_number(height)} {_turned(new)}"
    if not _equal(new):
        named = zip("ABC", new.arm_length_mm, strict=True)
        line += "".join(f" {name}{_number(length - arm)}" for name, length in named)
    yield line
    yield f"M666 {_towers([height - endstop for endstop in new.endstops_mm])}"
    yield "M500"
    if not _equal(new):
        yield "; A, B, C: each arm's excess over L. In old versions B meant something else: then"
        yield "; leave A, B and C out; the difference of the arms is not entered."


def linuxcnc(new: LinearDelta) -> Iterator[str]:
    """R and L of lineardeltakins, whose towers stand at 90, 210 and 330 degrees, and the heights of
    the carriages at their switches."""
    yield "# In the HAL file, in place of the same lines; in the INI the HOME_OFFSET. Then restart"
    yield "# LinuxCNC and home. In mm: divide by 25.4 if LINEAR_UNITS is inch."
    arm, radius = float(np.mean(new.arm_length_mm)), new.delta_radius_mm
    yield f"setp lineardeltakins.R {_number(radius)}"
    yield f"setp lineardeltakins.L {_number(arm)}"
    towers = sorted("abc", key=lambda t: (new.tower_angles_deg["abc".index(t)] - 30.0) % 360.0)
    for number, tower in enumerate(towers):
        height = new.endstops_mm["abc".index(tower)] + math.sqrt(arm**2 - radius**2)
        yield from (f"[JOINT_{number}]", f"# tower {tower}", f"HOME_OFFSET = {_number(height)}")
    if not _equal(new):
        yield "# Not in these lines: the lengths of the single arms; L is their mean."
    turned = np.sort(np.mod(new.tower_angles_deg, 360.0)) - (90.0, 210.0, 330.0)
    if np.any(np.abs(turned) >= 0.5 * 10.0**-_DECIMALS):
        yield "# Not in these lines: towers at other angles than 90, 210 and 330 degrees."


def _equal(new: LinearDelta) -> bool:
    """True if one length is enough for the arms."""
    return len({round(arm, _DECIMALS) for arm in new.arm_length_mm}) == 1


def _turned(new: LinearDelta) -> str:
    return _towers(np.subtract(new.tower_angles_deg, USUAL_ANGLES_DEG))


def _towers(numbers: Iterable[float]) -> str:
    return " ".join(f"{n}{_number(v)}" for n, v in zip("XYZ", numbers, strict=True))


def _number(value: float) -> str:
    return plain(value, _DECIMALS)


# Format → the name of the firmware, its lines, and what begins a comment.
FIRMWARES: Mapping[str, tuple[str, Callable[[LinearDelta], Iterator[str]], str]] = {
    "klipper": ("Klipper", klipper, "#"),
    "reprapfirmware": ("RepRapFirmware", reprapfirmware, ";"),
    "marlin": ("Marlin", marlin, ";"),
    "linuxcnc": ("LinuxCNC's lineardeltakins", linuxcnc, "#"),
}


def _left_out(name: str, case: Case) -> Iterator[str]:
    """Parts of the calibration for which the firmware has no setting."""
    but = " (only when it is compiled)" if name == "Marlin" else ""
    mesh = "" if name.startswith("LinuxCNC") else "; its mesh corrects the shape of the bed"
    yield f"{name} has no setting for towers that lean or for a radius of each tower{but}{mesh}."
    for id in dict.fromkeys(cause.id for cause in case.known):
        if id not in case.machine.fixed_parameters:
            yield f"Not in these lines: {id}; {CAUSES[id].words(case.machine).no_setting}."
    unknown = [row.name for row in case.answer.parameters if not row.determined]
    if unknown:
        yield f"Unchanged, because these readings do not determine them: {', '.join(unknown)}."
