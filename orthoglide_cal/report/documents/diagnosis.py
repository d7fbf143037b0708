"""The document of `orthocal diagnose`: what the model leaves out, how sure that is, what to do.

The calibration report shows the same blocks for the verdict, its causes and what to read next.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Diagnosis, Explanation, NamedCause, Verdict
from orthoglide_cal.errors import command, file_words
from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.model import (
    Cause,
    Contact,
    Differences,
    Estimate,
    Floats,
    Ints,
    Measured,
    Readings,
    Series,
    other_axes,
)
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.documents.next_reading import next_blocks, told_data
from orthoglide_cal.report.documents.solution import offsets_grid
from orthoglide_cal.report.json import SCHEMA_VERSION, axes_of, fields_of, input_data
from orthoglide_cal.report.words import (
    comparison_words,
    data_words,
    end_words,
    percent,
    plain,
    signed,
    unit_words,
    with_uncertainty,
)
from orthoglide_cal.results import Calibration

# Verdict → its tone, what it says, and how other offsets than the solution's take it into account.
_VERDICTS = {
    Verdict.CONSISTENT: (
        doc.Tone.GOOD,
        "Consistent: nothing shows beyond this gauge's noise; the model fits.",
        "",
    ),
    Verdict.NAMED: (doc.Tone.WARN, "Named: {causes}.", ", the cause taken into account"),
    Verdict.AMBIGUOUS: (
        doc.Tone.WARN,
        "Ambiguous: these data leave open what is wrong. Likeliest: {causes}.",
        ", the open choice part of std. dev.",
    ),
    Verdict.UNEXPLAINED: (
        doc.Tone.BAD,
        "Unexplained: something is wrong that no listed cause explains.",
        ", the unexplained part of std. dev.",
    ),
}
# A parameter of one leg and direction has the name of that series.
_PLACES = {
    series.name: series.words
    for series in (Series(leg, direction) for leg in range(3) for direction in other_axes(leg))
}
# Probability from which "nothing is wrong" is mentioned beside a cause.
_WORTH_SAYING = 0.005
_BEST = 5  # explanations in the ranking
_LEGEND = "Mean of the repeats, then one sign for each: · noise, + − over 2σ, ▲ ▼ over 4σ."
# More signs than this would not fit beside a name: the largest deviations of each stand for all.
_SIGNS = 30


def diagnosis_document(
    calibration: Calibration, machine_file: Path | None = None, held_out_file: bool = False
) -> doc.Document:
    """The whole answer.

    Args:
        calibration: a result with a diagnosis.
        machine_file: as the user gave it, for the commands to run next.
        held_out_file: True if the held-out errors are those of a later file.
    """
    return doc.Document(
        partial(diagnosis_data, calibration),
        partial(_diagnosis_page, calibration, machine_file, held_out_file),
    )


def _diagnosis_page(
    calibration: Calibration, machine_file: Path | None, held_out_file: bool
) -> doc.Page:
    diagnosis, found = calibration.diagnosed
    tone, _, taken = _VERDICTS[diagnosis.verdict]
    causes = (
        *cause_blocks(diagnosis, machine_file, held_out_file),
        *next_blocks(diagnosis, calibration.following),
    )
    release = calibration.release
    told = () if release.usable else ("Do not enter the offsets.", *release.reasons)
    title = "Joint offsets, mm (true = indicated + Δρ)"
    return doc.Page(
        kind="Diagnosis",
        title=file_words(diagnosis.source.path),
        facts=doc.Facts(
            (
                ("Data", data_words(diagnosis.count, diagnosis.kind)),
                ("Machine", doc.Given(diagnosis.machine)),
            )
        ),
        notice=doc.Notice(tone if release.sound else doc.Tone.BAD, headline(diagnosis), told),
        sections=(
            *((doc.Section(None, causes),) if causes else ()),
            *_pictures(diagnosis, calibration.input.measured),
            doc.Section(
                title if found is calibration.alone else title + taken,
                (offsets_grid(found, release.usable), *note_blocks(diagnosis)),
            ),
        ),
    )


def diagnosis_data(calibration: Calibration) -> dict[str, Any]:
    """The contract's fields, then a few more; lengths in mm, None where nothing is known."""
    diagnosis, found = calibration.diagnosed
    lack, following = diagnosis.lack_of_fit, calibration.following
    return {
        "schema_version": SCHEMA_VERSION,
        "input": input_data(diagnosis.source, diagnosis.kind, diagnosis.count),
        **fields_of(diagnosis, "machine", "verdict"),
        "lack_of_fit": {
            **fields_of(lack, "statistic", "p_value", "noise_mm", "residual_mm", "dof"),
            **fields_of(lack, "repeats_mm", "repeats_p_value"),
        },
        "causes": [_cause_data(cause) for cause in diagnosis.causes],
        "ambiguous_with": list(diagnosis.ambiguous_with),
        "next_measurement": None if following is None else told_data(following),
        **axes_of(found, "offsets_mm", "std_mm"),
        **fields_of(calibration.release, "usable", "reasons"),
        "assumed_tolerances": dict(diagnosis.assumed_tolerances),
        "sensitivity": {
            how: {"verdict": verdict, "causes": list(ids)}
            for how, (verdict, ids) in diagnosis.sensitivity.items()
        },
        "notes": list(diagnosis.notes),
    }


def _cause_data(cause: NamedCause) -> dict[str, Any]:
    return {
        **fields_of(cause, "id", "probability", "where"),
        "parameters": {
            name: fields_of(found, "value", "std", "unit")
            for name, found in cause.parameters.items()
        },
        **fields_of(cause, "rms_before_mm", "rms_after_mm"),
        **fields_of(cause, "heldout_before_mm", "heldout_after_mm", "aliases"),
        **fields_of(cause, "heldout_ratio", "recommended", "advice"),
    }


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    titles = " and ".join(CAUSES[cause.id].title for cause in diagnosis.causes)
    return _VERDICTS[diagnosis.verdict][1].format(causes=titles)


def cause_blocks(
    diagnosis: Diagnosis, machine_file: Path | None = None, held_out_file: bool = False
) -> tuple[doc.Block, ...]:
    """Each cause with place, size and remedy, and what all of them together are worth."""
    causes = diagnosis.causes
    if not causes:
        return ()
    blocks: list[doc.Block] = []
    gain = _gain(diagnosis, held_out_file)
    for cause in causes:
        own = _cause(cause, diagnosis, machine_file)
        blocks.append(doc.Paragraph((doc.Strong(cause.id), f": {CAUSES[cause.id].title}")))
        blocks.append(doc.Facts((*own, *gain) if len(causes) == 1 else own))
    if len(causes) > 1:
        blocks += [doc.Paragraph(doc.Strong("Both together")), doc.Facts(gain)]
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        rivals = tuple((rival, CAUSES[rival].title) for rival in diagnosis.ambiguous_with)
        blocks += [doc.Paragraph("These data are explained as well by"), doc.Facts(rivals)]
    return tuple(blocks)


def _cause(
    cause: NamedCause, diagnosis: Diagnosis, machine_file: Path | None
) -> tuple[tuple[str, doc.Blank], ...]:
    rows: list[tuple[str, doc.Blank]] = []
    if cause.where:
        rows.append(("where", cause.where))
    if cause.parameters:
        rows.append(("size", _size(cause.parameters)))
    rows.append(("mend", cause.advice))
    if cause.recommended:
        path, option = diagnosis.source.path, f"--accept {cause.id}"
        accept = command("diagnose", path, machine=machine_file, options=option)
        rows.append(("or accept", doc.Command(accept)))
    elif not cause.in_machine:
        rows.append(("note", "It lies in the measurement: nothing for the controller to correct."))
    else:
        rows.append(("note", "Making it part of the machine's model is not recommended."))
    if cause.aliases and diagnosis.verdict is not Verdict.AMBIGUOUS:
        rows.append(("looks like", ", ".join(cause.aliases)))
    return tuple(rows)


def _size(parameters: Mapping[str, Estimate]) -> str:
    """Parameters with their standard deviations."""
    sizes = []
    for name, found in parameters.items():
        # A single parameter needs no name.
        place = _PLACES.get(name, name)
        size = with_uncertainty(found.value, found.std) if found.std else f"{found.value:+g}"
        named = f"{place} {size}" if len(parameters) > 1 else size
        sizes.append(f"{named} {unit_words(found.unit)}".rstrip())
    return "; ".join(sizes)


def _gain(diagnosis: Diagnosis, held_out_file: bool) -> tuple[tuple[str, doc.Blank], ...]:
    """What all accepted causes together are worth."""
    first = diagnosis.causes[0]
    with_it = "with them" if len(diagnosis.causes) > 1 else "with it"

    def gain(before: float, after: float, what: str) -> str:
        return f"{plain(before, 4)} mm {what}with offsets only, {plain(after, 4)} mm {with_it}"

    rows: list[tuple[str, doc.Blank]] = [("probability", percent(first.probability, 1))]
    nothing = diagnosis.ranking.get(Explanation(), 0.0)
    if nothing >= _WORTH_SAYING:
        rows.append(("", f"{percent(nothing, 1)} that nothing is wrong at all"))
    rows.append(("residual", gain(first.rms_before_mm, first.rms_after_mm, "r.m.s. ")))
    before, after = first.heldout_before_mm, first.heldout_after_mm
    where = "the later readings" if held_out_file else "readings left out of the fit"
    off = f"of {where}: off by {gain(before, after, '')}."
    if after >= before:
        off += " It does not predict better: not recommended as an extension."
    return (*rows, ("prediction", off))


def ranking_grid(diagnosis: Diagnosis) -> doc.Grid:
    """The best of all explanations that were tried."""

    def words(explanation: Explanation) -> str:
        ids = explanation.causes
        if len(ids) == 1:
            return CAUSES[ids[0]].title
        return explanation.pattern or " and ".join(ids) or "no cause"

    best = list(diagnosis.ranking.items())[:_BEST]
    return doc.Grid(
        ("explanation", "probability"),
        tuple((words(tried), percent(p)) for tried, p in best),
        caption="The best explanations of all that were tried.",
    )


def note_blocks(diagnosis: Diagnosis) -> tuple[doc.Block, ...]:
    """Remarks, the sizes that were assumed, and how the answer depends on the tolerances."""
    notes = list(diagnosis.notes)
    if assumed := diagnosis.assumed_tolerances:
        sizes = ", ".join(_assumed(CAUSES[id], size) for id, size in assumed.items())
        notes.append(f"Assumed sizes (not in the machine file): {sizes}.")
    answer = (diagnosis.verdict, {cause.id for cause in diagnosis.causes})
    changed = diagnosis.sensitivity
    if changed and all((verdict, set(ids)) == answer for verdict, ids in changed.values()):
        notes.append("The answer is the same with all tolerances halved and doubled.")
    else:
        for how, (verdict, ids) in changed.items():
            what = f"{verdict}: {' and '.join(sorted(ids))}" if ids else verdict
            notes.append(f"With all tolerances {how} the answer is {what}.")
    return tuple(doc.Paragraph(note, small=True) for note in notes)


def _assumed(cause: Cause, size: float) -> str:
    """Without its size where the cause has none: it happens or it does not."""
    return f"{cause.id} {size:g} {unit_words(cause.unit)}" if cause.unit else cause.id


def fit_blocks(diagnosis: Diagnosis) -> tuple[doc.Block, ...]:
    """Do the offsets alone explain the data?"""
    lack = diagnosis.lack_of_fit
    left = rms(diagnosis.measured_mm - diagnosis.nominal_mm)
    # Both are root mean squares: the fit takes a part of the noise away, too.
    noise = left * lack.noise_mm / lack.residual_mm if lack.residual_mm else lack.noise_mm
    said = [
        f"Offsets only leave {plain(left, 4)} mm r.m.s.; this gauge's noise would leave"
        f" {plain(noise, 4)} mm. Noise alone leaves as much in {_sessions(lack.p_value)}"
        f" ({lack.dof} degrees of freedom)."
    ]
    if lack.repeats_mm is not None:
        judged = ""
        if lack.repeats_p_value is not None:
            chance = _sessions(lack.repeats_p_value)
            judged = f" Judged by them, noise leaves as much in {chance}."
        said.append(
            f"Repeats scatter by {plain(lack.repeats_mm, 4)} mm.{judged} They share one gauge"
            " set-up, so they understate the real scatter."
        )
    return tuple(map(doc.Paragraph, said))


def _sessions(p_value: float) -> str:
    if p_value < 1e-6:
        return "fewer than 1 of a million sessions"
    share = 100.0 * p_value
    return f"{share:.0f} % of sessions" if share >= 10.0 else f"{share:.2g} % of sessions"


def _pictures(diagnosis: Diagnosis, measured: Measured) -> tuple[doc.Section, ...]:
    """Measured minus predicted, without and with the accepted causes; do the offsets suffice?"""
    fit = fit_blocks(diagnosis)
    if isinstance(measured, Differences):
        return (doc.Section("Differences, mm", (_differences(measured, diagnosis), *fit)),)
    models = {"offsets only": diagnosis.nominal_mm}
    if diagnosis.causes:
        names = " and ".join(cause.id for cause in diagnosis.causes)
        models[f"with {names}"] = diagnosis.explained_mm
    sections = []
    for name, predicted in models.items():
        residual = diagnosis.measured_mm - predicted
        grid = _residuals(measured, residual, diagnosis.lack_of_fit.noise_mm)
        sections.append(doc.Section(f"Measured minus predicted, µm: {name}", (grid,)))
    return (*sections, doc.Section(None, (doc.Paragraph(_LEGEND, small=True), *fit)))


def _differences(measured: Differences, diagnosis: Diagnosis) -> doc.Grid:
    """One row per difference: measured, predicted, left without and with the causes [mm]."""
    columns = {
        "measured": diagnosis.measured_mm,
        "predicted by offsets": diagnosis.nominal_mm,
        "left": diagnosis.measured_mm - diagnosis.nominal_mm,
    }
    if diagnosis.causes:
        head = "left with the cause" + "s" * (len(diagnosis.causes) > 1)
        columns[head] = diagnosis.measured_mm - diagnosis.explained_mm
    rows = (
        (each.name, *(signed(float(values[k]), 3) for values in columns.values()))
        for k, each in enumerate(measured.which)
    )
    return doc.Grid(("", *columns), tuple(rows), caption=comparison_words(measured.which)[1])


def _residuals(measured: Readings, residual: Floats, sigma: float) -> doc.Grid:
    """One row per series, one column per posture.

    Args:
        measured: n readings.
        residual: measured − predicted, shape (n,) [mm].
        sigma: standard deviation of one reading [mm].
    """
    postures = list(dict.fromkeys(measured.posture))
    columns: list[list[str]] = [[] for _ in postures]
    names = []
    for name, own in _series(measured):
        names.append(name)
        in_time = own[np.argsort(measured.plan.order[own], kind="stable")]
        for posture, column in zip(postures, columns, strict=True):
            chosen = [k for k in in_time if measured.posture[k] == posture]
            column.append(_mean_and_signs(residual[chosen], sigma))
    for column in columns:
        # Signs begin below each other, however many repeats there are.
        longest = max(len(cell.partition(" ")[2]) for cell in column)
        column[:] = [cell + " " * (longest - len(cell.partition(" ")[2])) for cell in column]
    return doc.Grid(("leg, direction", *postures), tuple(zip(names, *columns, strict=True)))


def _series(measured: Readings) -> Iterator[tuple[str, Ints]]:
    """Readings of one leg, direction, leg end, gauge place and part: its name, which they are."""
    plan = measured.plan
    several = np.unique(plan.gauge_at).size > 1
    keys = np.stack((plan.leg, plan.direction, plan.contact, plan.gauge_at, plan.part), axis=1)
    for key in np.unique(keys, axis=0):
        name, contact = Series(int(key[0]), int(key[1])).words, Contact(int(key[2]))
        if contact.end:
            name += end_words(contact.end)
        elif several:
            name += f", at {key[3]:g}"
        if plan.parts > 1:
            name += f", part {key[4] + 1:.0f}"
        yield name, np.flatnonzero(np.all(keys == key, axis=1))


def _mean_and_signs(residual: Floats, sigma: float) -> str:
    """The mean over the repeats [µm] and a sign for each, in order of time."""
    if not residual.size:
        return ""
    parts = np.array_split(residual, min(residual.size, _SIGNS))
    signs = "".join(_sign(float(part[np.argmax(np.abs(part))]), sigma) for part in parts)
    return f"{signed(1000.0 * float(residual.mean()), 1)} {signs}"


def _sign(residual: float, sigma: float) -> str:
    if abs(residual) <= 2.0 * sigma:
        return "·"
    large = abs(residual) > 4.0 * sigma
    return ("▲" if large else "+") if residual > 0.0 else ("▼" if large else "−")
