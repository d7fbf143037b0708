"""A diagnosis as text for a terminal of 80 columns."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from pathlib import Path

from rich.text import Text

from orthoglide_cal.axes import AXES
from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Diagnosis, NamedCause
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Differences, Measured
from orthoglide_cal.report.diagnose_picture import LEGEND, difference_lines, residual_lines
from orthoglide_cal.report.lines import columns, facts, wrapped

_COLOURS = {"consistent": "green", "named": "yellow", "ambiguous": "yellow", "unexplained": "red"}
_KINDS = {
    "readings": "raw readings",
    "six": "differences, max − min",
    "twelve": "differences relative to iso",
    "single": "differences, tool end − joint end",
}
# A technician reads "1e-3" better as millimetres per metre.
_UNITS = {"1e-3": "mm/m"}
# Probability from which "nothing is wrong" is mentioned beside a cause.
_WORTH_SAYING = 0.005


def render(
    diagnosis: Diagnosis,
    measured: Measured,
    machine: Machine,
    machine_file: Path | None = None,
    held_out_file: bool = False,
) -> Text:
    """The whole answer.

    Args:
        diagnosis: what was found.
        measured: the data, for the picture.
        machine: for the offsets active in its controller.
        machine_file: as the user gave it, for the command to run next.
        held_out_file: True if the held-out errors are those of a later file.
    """
    path = "standard input" if diagnosis.source.path == "-" else diagnosis.source.path
    text = Text()

    def add(lines: list[str], style: str = "") -> None:
        for line in lines:
            text.append(f"{line}\n", style=style)

    add(wrapped(path), "bold")
    add(wrapped(f"{diagnosis.count} {_KINDS[diagnosis.kind]}; {diagnosis.machine}"))
    add([""])
    add(wrapped(headline(diagnosis)), f"bold {_COLOURS[diagnosis.verdict]}")
    for cause in diagnosis.causes:
        add(_cause(cause, diagnosis, machine_file))
    add(_gain(diagnosis, held_out_file))
    add(_rivals(diagnosis))
    add(_next(diagnosis), "bold")
    add([""])
    _add_picture(text, diagnosis, measured)
    add(_fit(diagnosis))
    add([""])
    add([f"Joint offsets, mm{_OFFSETS[diagnosis.verdict]}"], "bold")
    add(_offsets(diagnosis, machine))
    add(_notes(diagnosis))
    return text


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    titles = " and ".join(CAUSES[cause.id].title for cause in diagnosis.causes)
    return {
        "consistent": "Consistent: nothing shows beyond this gauge's noise; the model fits.",
        "named": f"Named: {titles}.",
        "ambiguous": f"Ambiguous: these data leave open what is wrong. Likeliest: {titles}.",
        "unexplained": "Unexplained: something is wrong that no listed cause explains.",
    }[diagnosis.verdict]


def _cause(cause: NamedCause, diagnosis: Diagnosis, machine_file: Path | None) -> list[str]:
    rows = []
    if cause.where:
        rows.append(("where", cause.where))
    if cause.parameters:
        rows.append(("size", _sizes(cause)))
    rows.append(("mend", cause.advice))
    if cause.recommended:
        rows.append(("or accept", _command(cause, diagnosis, machine_file)))
    elif not cause.in_machine:
        rows.append(("note", "It lies in the measurement: nothing for the controller to correct."))
    return [*wrapped(f"{cause.id}: {CAUSES[cause.id].title}", 2), *facts(rows, 4)]


def _sizes(cause: NamedCause) -> str:
    parts = []
    for name, found in cause.parameters.items():
        # "y_x" is what a gauge along y meets on leg x; a single parameter needs no name.
        place = "leg {2}, {0} ".format(*name) if "_" in name else f"{name} "
        size = f"{found.value:+.3g} ± {found.std:.2g}" if found.std else f"{found.value:+g}"
        unit = _UNITS.get(found.unit, found.unit)
        parts.append(f"{place if len(cause.parameters) > 1 else ''}{size} {unit}")
    return "; ".join(parts)


def _command(cause: NamedCause, diagnosis: Diagnosis, machine_file: Path | None) -> str:
    """What to type to make the cause part of the machine."""
    path = diagnosis.source.path
    machine = f" --machine {shlex.quote(str(machine_file))}" if machine_file else ""
    quoted = path if path == "-" else shlex.quote(path)
    return f"orthocal diagnose {quoted}{machine} --accept {cause.id}"


def _gain(diagnosis: Diagnosis, held_out_file: bool) -> list[str]:
    """What all accepted causes together are worth."""
    if not diagnosis.causes:
        return []
    first, many = diagnosis.causes[0], len(diagnosis.causes) > 1
    with_it = "with them" if many else "with it"
    left = f"{first.rms_before_mm:.4f} mm r.m.s. by offsets only, {first.rms_after_mm:.4f} mm"
    rows = [("probability", _percent(first.probability))]
    nothing = diagnosis.ranking.get("", 0.0)
    if nothing >= _WORTH_SAYING:
        rows.append(("", f"{_percent(nothing)} that nothing is wrong at all"))
    rows.append(("residual", f"{left} {with_it}"))
    before, after = first.heldout_before_mm, first.heldout_after_mm
    if before is not None and after is not None:
        where = "the later readings" if held_out_file else "readings left out of the fit"
        off = f"of {where}: off by {before:.4f} mm by offsets only, {after:.4f} mm {with_it}."
        if after >= before:
            off += " It does not predict better: not recommended as an extension."
        rows.append(("prediction", off))
    return [*(["  both together"] if many else []), *facts(rows, 4)]


def _percent(probability: float) -> str:
    return "over 99.9 %" if probability > 0.999 else f"{100.0 * probability:.1f} %"


def _rivals(diagnosis: Diagnosis) -> list[str]:
    if diagnosis.verdict != "ambiguous":
        return []
    rivals = [(other, CAUSES[other].title) for other in diagnosis.ambiguous_with]
    return ["  These data are explained as well by", *facts(rivals, 4)]


def _next(diagnosis: Diagnosis) -> list[str]:
    if diagnosis.verdict != "ambiguous":
        return []
    following = diagnosis.next_measurement
    if following is None:
        ids = (*(cause.id for cause in diagnosis.causes), *diagnosis.ambiguous_with)
        mended = all(not CAUSES[id].in_machine for id in ids)
        again = " All of them lie in the measurement: measure again." if mended else ""
        return wrapped(f"No further reading of this kind would tell them apart.{again}", 2)
    first, second = (name or "a sound machine" for name in following.separates)
    return [
        *wrapped(following.what, 2, "Read next: "),
        *wrapped(
            f"It tells {first} from {second} by {following.separation_sigma:.1f} standard"
            " deviations.",
            2 + len("Read next: "),
        ),
    ]


def _add_picture(text: Text, diagnosis: Diagnosis, measured: Measured) -> None:
    """Measured minus predicted, without and with the accepted causes."""
    if isinstance(measured, Differences):
        text.append("Differences, mm\n", style="bold")
        text.append("\n".join(difference_lines(measured, diagnosis)) + "\n")
        return
    models = [("offsets only", diagnosis.nominal_mm)]
    if diagnosis.causes:
        names = " and ".join(cause.id for cause in diagnosis.causes)
        models.append((f"with {names}", diagnosis.explained_mm))
    for name, predicted in models:
        text.append(f"Measured minus predicted, µm: {name}\n", style="bold")
        residual = diagnosis.measured_mm - predicted
        lines = residual_lines(measured, residual, diagnosis.lack_of_fit.noise_mm)
        text.append("\n".join(lines) + "\n")
    text.append(f"{LEGEND}\n")


def _fit(diagnosis: Diagnosis) -> list[str]:
    lack = diagnosis.lack_of_fit
    lines = wrapped(
        f"Offsets only leave {lack.residual_mm:.4f} mm per reading; this gauge's noise is"
        f" {lack.noise_mm:.4f} mm. Noise alone leaves as much in {_chance(lack.p_value)}.",
        2,
    )
    if lack.repeats_mm is not None:
        judged = (
            f" Judged by them, noise leaves as much in {_chance(lack.repeats_p_value)}."
            if lack.repeats_p_value is not None
            else ""
        )
        lines += wrapped(
            f"Repeats scatter by {lack.repeats_mm:.4f} mm.{judged} They share one gauge set-up,"
            " so they understate the real scatter.",
            2,
        )
    return lines


def _chance(p_value: float) -> str:
    if p_value < 1e-6:
        return "fewer than 1 of a million sessions"
    percent = 100.0 * p_value
    return f"{percent:.0f} % of sessions" if percent >= 10.0 else f"{percent:.2g} % of sessions"


_OFFSETS = {
    "consistent": " (true position = indicated + Δρ)",
    "named": " (true = indicated + Δρ), the cause taken into account",
    "ambiguous": " (true = indicated + Δρ), the open choice part of std. dev.",
    "unexplained": " (true = indicated + Δρ), the unexplained part of std. dev.",
}


def _offsets(diagnosis: Diagnosis, machine: Machine) -> list[str]:
    rows = [("", "Δρ", "std. dev.", "active now", "type in")]
    for axis, value, std, active in zip(
        AXES, diagnosis.offsets_mm, diagnosis.std_mm, machine.offsets_mm, strict=True
    ):
        change, now, then = (
            f"{round(float(v), 3) + 0.0:+.3f}" for v in (value, active, active + value)
        )
        rows.append((axis, change, f"{std:.4f}", now, then))
    return columns(rows)


def _notes(diagnosis: Diagnosis) -> list[str]:
    notes = list(diagnosis.notes)
    answer = (diagnosis.verdict, _set_of(cause.id for cause in diagnosis.causes))
    changes = {
        change: (verdict, _set_of(ids.split("+") if ids else ()))
        for change, (verdict, ids) in diagnosis.sensitivity.items()
    }
    if changes and all(other == answer for other in changes.values()):
        notes.append("The answer is the same with all tolerances halved and doubled.")
    else:
        for change, (verdict, ids) in changes.items():
            what = f"{verdict}: {ids}" if ids else verdict
            notes.append(f"With all tolerances {change} the answer is {what}.")
    lines = [line for note in notes for line in wrapped(note, 0, "· ")]
    return ["", *lines] if lines else []


def _set_of(ids: Iterable[str]) -> str:
    return " and ".join(sorted(ids))
