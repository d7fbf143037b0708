"""Exports for the controller: a page of text, lines to paste, a table of corrections."""

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import groupby

import numpy as np

from orthoglide_cal.errors import file_words, visible
from orthoglide_cal.files.controller_file import SAVED, firmware_machine, printer_values
from orthoglide_cal.files.gcode import words_of
from orthoglide_cal.files.text import csv_text
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.report.case import Case, check_words
from orthoglide_cal.report.sentences import FIRMWARES, cause_words
from orthoglide_cal.results.answer import Identity
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    moment_words,
    plain,
    two_figures,
    typed,
    uncapitalized,
)

_DECIMALS = 4  # of a table and of a firmware: tenths of a micrometre
_number = partial(plain, decimals=_DECIMALS)


def exported(format: str, case: Case, identity: Identity) -> str:
    """Text for a controller: a page, or lines to paste, where all but those are comments."""
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
        f"Issued {moment_words(identity.issued)} by {identity.software}",
        f"From {file_words(case.source.path)}, SHA-256 {case.source.sha256}",
        *["FORCED: this result must not be used."] * bool(release.reasons),
        *map(case.says, release.reasons),
        *[f"Note: {case.says(Reason.of('nothing_to_enter'))}"] * release.settled,
        *(f"Note: {case.says(caution)}" for caution in release.cautions),
        *"\n".join(notes).split("\n"),
    ]
    after = [f"Correct the remaining errors with a table: {case.table}"] * bool(case.table)
    if not release.settled:
        first = f"After entering: {uncapitalized(words.restart)}"
        check = check_words(answer.check) if answer.check else ""
        record = f"Record what was entered: {case.record}" * bool(case.record)
        after = [first, check, record, *after, f"Then measure again and run: {case.verify}"]
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
        f" uncertainty, k = {answer.k or 0.0:.2f}, 95 %)",
    )
    yield from ("  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in rows)
    yield ""
    if case.words.home:
        yield f"{case.words.home}, as the controller is set now:"
        for row in answer.parameters:
            says, truly = (plain(home + by, digits) for by in (0.0, row.found or 0.0))
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


def as_table(corrections_mm: Floats, case: Case) -> str:
    """One row per grid point: where the tool is wanted, and what to add to the joint values."""
    added = (f"add_to_joint_{axis}_mm" for axis in AXES)
    head = (*(f"{axis}_mm" for axis in AXES), *added, "status")
    status = "FORCED" if case.answer.release.reasons else "released"
    return csv_text(head, ((*map(_number, row), status) for row in corrections_mm.tolist()))


# --- firmwares of a linear delta --------------------------------------------------------------


def _klipper(new: LinearDelta) -> Iterator[str]:
    """Lines of the SAVE_CONFIG block of printer.cfg."""
    values = printer_values(new)
    for section, names in groupby(SAVED, key=lambda name: SAVED[name][0]):
        yield from ("#*#", f"#*# [{section}]")
        yield from (f"#*# {SAVED[name][1]} = {_number(values[name])}" for name in names)


def _codes(new: LinearDelta, marlin: bool = False) -> Iterator[str]:
    """Lines M665 and M666, of config.g or for Marlin's console; towers a, b, c are X, Y, Z."""
    words = words_of(new, marlin)
    for code, names in groupby(words, key=lambda name: name[:4]):
        written = (f"{name[4:]}{':'.join(map(_number, words[name]))}" for name in names)
        yield f"{code} {' '.join(written)}"
    if marlin:
        yield "M500"


def _linuxcnc(new: LinearDelta) -> Iterator[str]:
    """Values of lineardeltakins, whose towers stand at 90, 210 and 330 degrees."""
    arm, radius = float(np.mean(new.arm_length_mm)), new.delta_radius_mm
    yield f"setp lineardeltakins.R {_number(radius)}"
    yield f"setp lineardeltakins.L {_number(arm)}"
    towers = sorted("abc", key=lambda t: (new.tower_angles_deg["abc".index(t)] - 30.0) % 360.0)
    for number, tower in enumerate(towers):
        height = new.endstops_mm["abc".index(tower)] + math.sqrt(arm**2 - radius**2)
        yield from (f"[JOINT_{number}]", f"# tower {tower}", f"HOME_OFFSET = {_number(height)}")


_LINES: Mapping[str, Callable[[LinearDelta], Iterator[str]]] = {
    "klipper": _klipper,
    "reprapfirmware": _codes,
    "marlin": partial(_codes, marlin=True),
    "linuxcnc": _linuxcnc,
}


def _notes(format: str, new: LinearDelta, case: Case) -> Iterator[str]:
    """Sentences on what the firmware has no setting for, and where its lines go."""
    texts = FIRMWARES[format]
    yield texts["lacks"]
    for id in dict.fromkeys(cause.id for cause in case.known):
        if id not in case.machine.fixed_parameters:
            yield f"Not in these lines: {id}; {cause_words(id, case.machine)['no_setting']}."
    if unknown := [row.name for row in case.answer.parameters if not row.determined]:
        yield f"Unchanged, because these readings do not determine them: {', '.join(unknown)}."
    turned = np.sort(np.mod(new.tower_angles_deg, 360.0)) - (90.0, 210.0, 330.0)
    turns = bool(np.any(np.abs(turned) >= 0.5 * 10.0**-_DECIMALS))
    wanted = {"unequal": not new.equal_arms, "turned": turns, "before": True}
    yield from (texts[name] for name, holds in wanted.items() if holds and name in texts)
