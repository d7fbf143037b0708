"""What goes to the controller: a page of text, LinuxCNC's sections, a table of corrections."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.errors import file_words, visible
from orthoglide_cal.files.table import csv_text
from orthoglide_cal.model import AXES
from orthoglide_cal.model.workspace import Compensation
from orthoglide_cal.report.case import SETTLED, Case, check_words
from orthoglide_cal.results import Identity
from orthoglide_cal.words import coverage_words, plain, two_figures, typed

FORCED = "FORCED: this result must not be used."
_COMPENSATION_DECIMALS = 4  # tenths of a micrometre


@dataclass(frozen=True, eq=False)
class Export:
    """A result whose parameters may go to the controller, or are forced to.

    Attributes:
        case: the result.
        identity: its number.
    """

    case: Case
    identity: Identity

    @property
    def forced(self) -> tuple[str, ...]:
        """Why it must not be used, exported all the same; empty if it may be used."""
        return self.case.answer.release.reasons

    def head(self) -> Iterator[str]:
        """Title, origin, and the warning of a forced export."""
        case, identity = self.case, self.identity
        yield f"{case.words.title} for {case.machine.name}, {identity.number}"
        yield f"Issued {identity.issued:%Y-%m-%d %H:%M} UTC by {identity.software}"
        yield f"From {file_words(case.source.path)}, SHA-256 {case.source.sha256}"
        if self.forced:
            yield from (FORCED, *self.forced)
        if case.answer.release.settled:
            yield f"Note: {SETTLED}."
        yield from (f"Note: {line}" for line in case.answer.release.cautions)

    def afterwards(self) -> Iterator[str]:
        """Re-home, check posture, verification."""
        case, restart = self.case, self.case.words.restart
        yield f"After entering: {restart[0].lower()}{restart[1:]}"
        check = case.answer.check
        if check is not None:
            yield check_words(check)
        if case.record is not None:
            yield f"Record what was entered: {case.record}"
        if case.table is not None:
            yield f"Correct what offsets leave with a table of corrections: {case.table}"
        yield f"Then measure again and run: {case.verify}"


def as_text(export: Export) -> str:
    """A page of plain text for any controller: "the controller says X, truly Y"."""
    case, answer = export.case, export.case.answer
    digits = answer.decimals
    rows = [("", "previous", "change", "U", "enter")] + [
        (
            each.name if case.unit else f"{each.name}, {each.unit}",
            plain(each.active, digits),
            typed(each.change(digits), digits) if each.determined else "unknown",
            two_figures(each.expanded),
            plain(each.new(digits), digits),
        )
        for each in answer.parameters
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    unit = f", {case.unit}" if case.unit else ""
    lines = [
        *map(visible, export.head()),
        "",
        f"{case.words.title}{unit} ({case.words.relation}; U: expanded uncertainty,"
        f" {coverage_words(answer.k or 0.0)}, {100 * answer.confidence:.0f} %)",
        *("  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in rows),
        "",
    ]
    if not case.machine.keeps_itself:
        says = case.machine.home_mm
        lines += [
            "At the isotropic posture, as the controller is set now:",
            *(
                f"{each.name}: the controller says {plain(says, digits)} mm,"
                f" truly {plain(says + each.change(digits), digits)} mm"
                for each in answer.parameters
            ),
            "",
        ]
    lines += map(visible, export.afterwards())
    return "\n".join(lines) + "\n"


def as_linuxcnc(export: Export) -> str:
    """Comments and one [JOINT_n] section per axis; true position = indicated + HOME_OFFSET.

    To be pasted by hand: the configuration itself is never rewritten, because its repeated keys
    and comments would not survive.
    """
    digits = export.case.answer.decimals
    lines = [f"# {visible(line)}" for line in export.head()]
    lines += [
        "#",
        "# HOME_OFFSET takes the joint offset with its sign, in mm (divide by 25.4 if LINEAR_UNITS",
        "# is inch). If yours holds more than the offset, such as the place of the home switch,",
        "# add the change to it instead of replacing it.",
    ]
    for number, each in enumerate(export.case.answer.parameters):
        lines += [
            "",
            f"[JOINT_{number}]",
            f"# axis {each.name}: previous {typed(each.active, digits)},"
            f" change {typed(each.change(digits), digits)} (U = {two_figures(each.expanded)})",
            f"HOME_OFFSET = {plain(each.new(digits), digits)}",
        ]
    lines.append("")
    lines += [f"# {visible(line)}" for line in export.afterwards()]
    return "\n".join(lines) + "\n"


def as_table(table: Compensation, export: Export) -> str:
    """One row per grid point: where the tool is wanted, and what to add to the joint values."""
    head = (
        *(f"{axis}_mm" for axis in AXES),
        *(f"add_to_joint_{axis}_mm" for axis in AXES),
        *("status", "causes", "not_compensated", "number"),
    )
    status = "FORCED" if export.forced else "released"
    stamp = (status, " ".join(table.causes), " ".join(table.left_out), export.identity.number)
    values = np.hstack((table.points_mm, table.corrections_mm)).tolist()
    return csv_text(
        head, ((*(plain(v, _COMPENSATION_DECIMALS) for v in row), *stamp) for row in values)
    )
