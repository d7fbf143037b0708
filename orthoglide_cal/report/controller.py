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
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import groupby

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import file_words, visible
from orthoglide_cal.files.controller_file import SAVED, firmware_machine, printer_values
from orthoglide_cal.files.probe_readings import USUAL_ANGLES_DEG
from orthoglide_cal.files.text import csv_text
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.model.workspace import Compensation
from orthoglide_cal.report.case import NOT_NEEDED, Case, check_words
from orthoglide_cal.report.sentences import FIRMWARES
from orthoglide_cal.results import Identity
from orthoglide_cal.words import coverage_words, plain, two_figures, typed

_DECIMALS = 4  # of a table and of a firmware: tenths of a micrometre


def exported(format: str, case: Case, identity: Identity) -> str:
    """What goes into a controller: a page of text, or lines to paste; with what those leave out.

    Below title, origin and warnings, above what to do then; in lines to paste those are comments. A
    forced result is marked as such.
    """
    answer, release, words = case.answer, case.answer.release, case.words
    lines, sign, notes = _text(case), "", iter("")
    if format != "text" and case.machine.adds_to_joints:
        lines, sign, notes = _joints(case), "# ", iter([FIRMWARES["joints"]["before"]])
    elif format != "text":
        changes = [row.change(answer.decimals) for row in answer.parameters]
        new = firmware_machine(case.given.model, changes)
        lines, sign = _LINES[format](new), f"{FIRMWARES[format]['comment']} "
        notes = _notes(format, new, case)
    head = [
        f"{words.title} for {case.machine.name}, {identity.number}",
        f"Issued {identity.issued:%Y-%m-%d %H:%M} UTC by {identity.software}",
        f"From {file_words(case.source.path)}, SHA-256 {case.source.sha256}",
        *(["FORCED: this result must not be used."] if release.reasons else []),
        *map(case.says, release.reasons),
        *([f"Note: {NOT_NEEDED}."] if release.settled else []),
        *(f"Note: {case.says(caution)}" for caution in release.cautions),
        *"\n".join(notes).split("\n"),
    ]
    after = [
        f"After entering: {words.restart[0].lower()}{words.restart[1:]}",
        check_words(answer.check) if answer.check else "",
        f"Record what was entered: {case.record}" if case.record else "",
        f"Correct the remaining errors with a table: {case.table}" if case.table else "",
        f"Then measure again and run: {case.verify}",
    ]
    if release.settled:  # nothing is entered
        after = after[3:4]
    above, below = ([f"{sign}{visible(line)}" for line in part if line] for part in (head, after))
    return "\n".join((*above, *lines, *below, ""))


def _text(case: Case) -> Iterator[str]:
    """For any controller: "the controller says X, truly Y"."""
    answer, home, digits = case.answer, case.machine.home_mm, case.answer.decimals
    unit, rows = case.machine.common_unit, [("", "previous", "change", "U", "enter")]
    for row in answer.parameters:
        name = row.name if unit else f"{row.name}, {row.unit}"
        change = typed(row.change(digits), digits) if row.determined else "unknown"
        active, new = plain(row.active, digits), plain(row.new(digits), digits)
        rows.append((name, active, change, two_figures(row.expanded), new))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    yield from (
        "",
        f"{case.words.title}{unit} ({case.words.relation}; U: expanded"
        f" uncertainty, {coverage_words(answer.k or 0.0)}, 95 %)",
    )
    yield from ("  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in rows)
    yield ""
    if case.words.home:
        yield f"{case.words.home}, as the controller is set now:"
        for row in answer.parameters:
            says, truly = (plain(home + by, digits) for by in (0.0, row.change(digits)))
            yield f"{row.name}: the controller says {says} mm, truly {truly} mm"
        yield ""


def _joints(case: Case) -> Iterator[str]:
    """One [JOINT_n] section per axis; true position = indicated + HOME_OFFSET."""
    digits = case.answer.decimals
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


def _klipper(new: LinearDelta) -> Iterator[str]:
    """Lines of the SAVE_CONFIG block of printer.cfg."""
    values = printer_values(new)
    for section, names in groupby(SAVED, key=lambda name: SAVED[name][0]):
        yield from ("#*#", f"#*# [{section}]")
        yield from (f"#*# {SAVED[name][1]} = {_number(values[name])}" for name in names)


def _reprapfirmware(new: LinearDelta) -> Iterator[str]:
    """M665 and M666 of config.g; towers a, b, c are X, Y, Z."""
    arms = new.arm_length_mm[:1] if _equal(new) else new.arm_length_mm
    lengths, height = ":".join(map(_number, arms)), float(np.mean(new.endstops_mm))
    radius, bed = _number(new.delta_radius_mm), _number(new.bed_radius_mm)
    yield f"M665 L{lengths} R{radius} H{_number(height)} B{bed} {_turned(new)}"
    yield f"M666 {_towers(np.array(new.endstops_mm) - height)}"


def _marlin(new: LinearDelta) -> Iterator[str]:
    """M665 and M666, saved with M500; towers a, b, c are X, Y, Z."""
    arm = float(np.mean(new.arm_length_mm))
    height = min(new.endstops_mm)  # no endstop may be adjusted upwards
    more = "" if _equal(new) else f" {_towers(np.array(new.arm_length_mm) - arm, 'ABC')}"
    radius = _number(new.delta_radius_mm)
    yield f"M665 L{_number(arm)} R{radius} H{_number(height)} {_turned(new)}{more}"
    yield f"M666 {_towers(height - np.array(new.endstops_mm))}"
    yield "M500"


def _linuxcnc(new: LinearDelta) -> Iterator[str]:
    """R and L of lineardeltakins, whose towers stand at 90, 210 and 330 degrees, and the heights of
    the carriages at their switches."""
    arm, radius = float(np.mean(new.arm_length_mm)), new.delta_radius_mm
    yield f"setp lineardeltakins.R {_number(radius)}"
    yield f"setp lineardeltakins.L {_number(arm)}"
    towers = sorted("abc", key=lambda t: (new.tower_angles_deg["abc".index(t)] - 30.0) % 360.0)
    for number, tower in enumerate(towers):
        height = new.endstops_mm["abc".index(tower)] + math.sqrt(arm**2 - radius**2)
        yield from (f"[JOINT_{number}]", f"# tower {tower}", f"HOME_OFFSET = {_number(height)}")


def _equal(new: LinearDelta) -> bool:
    """True if one length is enough for the arms."""
    return len({round(arm, _DECIMALS) for arm in new.arm_length_mm}) == 1


def _turned(new: LinearDelta) -> str:
    return _towers(np.subtract(new.tower_angles_deg, USUAL_ANGLES_DEG))


def _towers(numbers: Iterable[float], names: str = "XYZ") -> str:
    return " ".join(f"{n}{_number(v)}" for n, v in zip(names, numbers, strict=True))


def _number(value: float) -> str:
    return plain(value, _DECIMALS)


_LINES: Mapping[str, Callable[[LinearDelta], Iterator[str]]] = {
    "klipper": _klipper,
    "reprapfirmware": _reprapfirmware,
    "marlin": _marlin,
    "linuxcnc": _linuxcnc,
}


def _notes(format: str, new: LinearDelta, case: Case) -> Iterator[str]:
    """Parts of the calibration for which the firmware has no setting, and where its lines go."""
    texts = FIRMWARES[format]
    yield texts["lacks"]
    for id in dict.fromkeys(cause.id for cause in case.known):
        if id not in case.machine.fixed_parameters:
            yield f"Not in these lines: {id}; {CAUSES[id].words(case.machine).no_setting}."
    unknown = [row.name for row in case.answer.parameters if not row.determined]
    if unknown:
        yield f"Unchanged, because these readings do not determine them: {', '.join(unknown)}."
    if not _equal(new) and "unequal" in texts:
        yield texts["unequal"]
    turned = np.sort(np.mod(new.tower_angles_deg, 360.0)) - (90.0, 210.0, 330.0)
    if np.any(np.abs(turned) >= 0.5 * 10.0**-_DECIMALS) and "turned" in texts:
        yield texts["turned"]
    yield texts["before"]
