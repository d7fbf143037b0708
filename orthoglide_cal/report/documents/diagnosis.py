"""The document of `orthocal diagnose`: what the model leaves out, how sure that is, what to do.

The calibration report shows the same blocks for the verdict, its causes and what to read next.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Diagnosis, Explanation, NamedCause, Verdict
from orthoglide_cal.errors import file_words
from orthoglide_cal.estimation.accuracy import half_width
from orthoglide_cal.estimation.solution import UNUSUAL
from orthoglide_cal.model import (
    Cause,
    Estimate,
    Machine,
    Series,
    other_axes,
)
from orthoglide_cal.model.vocabulary import Vocabulary
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.controller import SETTLED, about
from orthoglide_cal.report.documents.parameters import (
    offsets_grid,
    offsets_title,
    open_blocks,
    parameters_of,
    release_of,
    result_of,
)
from orthoglide_cal.report.documents.pictures import residual_sections
from orthoglide_cal.report.documents.plan import next_blocks
from orthoglide_cal.report.facts import data_words
from orthoglide_cal.report.json import SCHEMA_VERSION, fields_of, input_data
from orthoglide_cal.results import Calibration
from orthoglide_cal.words import (
    counted,
    coverage_words,
    percent,
    plain,
    unit_words,
    with_uncertainty,
)

# Verdict → its tone, what it says, and how other offsets than the solution's take it into account.
_VERDICTS = {
    Verdict.CONSISTENT: (
        doc.Tone.GOOD,
        "Consistent: nothing shows beyond this {noise}'s noise{beside}; the model fits.",
        "",
    ),
    Verdict.NAMED: (doc.Tone.WARN, "Named: {causes}.", ", the cause taken into account"),
    Verdict.AMBIGUOUS: (
        doc.Tone.WARN,
        "Ambiguous: these data leave open what is wrong. Likeliest: {causes}.",
        ", the open choice part of {spread}",
    ),
    Verdict.UNEXPLAINED: (
        doc.Tone.BAD,
        "Unexplained: something is wrong that no listed cause explains.",
        ", the unexplained part of {spread}",
    ),
}
# Instead of "the model fits", where no reading is to spare.
_UNTOLD = (
    doc.Tone.WARN,
    "Consistent, but there is no reading to spare: whether the model fits cannot be told.",
    "",
)
# And where noise seldom leaves as much.
_UNUSUAL = (
    doc.Tone.INFO,
    "Consistent: what is left is larger than usual for this {noise}'s noise{beside}, not large"
    " enough to call the model wrong.",
    "",
)
# A parameter of one leg and direction has the name of that series.
_PLACES = {
    series.name: series.words
    for series in (Series(leg, direction) for leg in range(3) for direction in other_axes(leg))
}
_BEST = 5  # explanations in the ranking


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
    tone, _, taken = _answer(diagnosis)
    causes = (
        *cause_blocks(diagnosis, machine_file, held_out_file),
        *next_blocks(diagnosis, calibration.following),
    )
    release = calibration.release
    vocabulary = found.machine.vocabulary
    told: tuple[str, ...] = (f"{SETTLED}.",) if calibration.settled else ()
    if not release.usable:
        told = (f"Do not enter the {vocabulary.many}.", *release.reasons)
    title = offsets_title(found, True, short=True)
    spread = "U" if found.machine.absolute else "std. dev."
    return doc.Page(
        kind="Diagnosis",
        title=file_words(diagnosis.source.path),
        facts=doc.Facts(
            (
                ("Data", data_words(diagnosis.source, diagnosis.kind, diagnosis.count)),
                ("Machine", doc.Given(diagnosis.machine)),
            )
        ),
        notice=doc.Notice(tone if release.sound else doc.Tone.BAD, headline(diagnosis), told),
        sections=(
            *((doc.Section(None, causes),) if causes else ()),
            *residual_sections(calibration.answer, vocabulary.many, fit_blocks(diagnosis)),
            doc.Section(
                title if found is calibration.alone else title + taken.format(spread=spread),
                (
                    offsets_grid(found, calibration.enters),
                    *open_blocks(calibration, found),
                    *note_blocks(diagnosis),
                ),
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
            **(fields_of(diagnosis, "left_mm", "expected_mm") if found.machine.absolute else {}),
        },
        "causes": [_cause_data(cause, found.machine.vocabulary) for cause in diagnosis.causes],
        "ambiguous_with": list(diagnosis.ambiguous_with),
        "next_measurement": None
        if following is None
        else following.model_dump(include={"what", "separates", "separation_sigma"}),
        **parameters_of(found),
        **result_of(found, "offsets_mm", "std_mm"),
        **release_of(calibration),
        "assumed_tolerances": dict(diagnosis.assumed_tolerances),
        "sensitivity": {
            how: {"verdict": verdict, "causes": list(ids)}
            for how, (verdict, ids) in diagnosis.sensitivity.items()
        },
        "notes": list(diagnosis.notes),
    }


def _cause_data(cause: NamedCause, vocabulary: Vocabulary) -> dict[str, Any]:
    return {
        **fields_of(cause, "id", "probability", "where"),
        "parameters": {
            name: fields_of(found, "value", "std", "unit")
            for name, found in cause.parameters.items()
        },
        **fields_of(cause, "rms_before_mm", "rms_after_mm"),
        **fields_of(cause, "heldout_before_mm", "heldout_after_mm", "aliases"),
        **fields_of(cause, "heldout_ratio", "recommended"),
        "advice": vocabulary.said(cause.advice),
    }


def _answer(diagnosis: Diagnosis) -> tuple[doc.Tone, str, str]:
    if diagnosis.verdict is Verdict.CONSISTENT and not diagnosis.lack_of_fit.dof:
        return _UNTOLD
    if diagnosis.verdict is Verdict.CONSISTENT and diagnosis.lack_of_fit.p_value < UNUSUAL:
        return _UNUSUAL
    return _VERDICTS[diagnosis.verdict]


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    vocabulary = diagnosis.model.machine.vocabulary
    titles = " and ".join(vocabulary.said(CAUSES[cause.id].title) for cause in diagnosis.causes)
    sentence = _answer(diagnosis)[1]
    nothing, causes = diagnosis.nothing_wrong or 0.0, diagnosis.causes
    if diagnosis.verdict is Verdict.AMBIGUOUS and causes and nothing > causes[0].probability:
        sentence = "Ambiguous: these data leave open what is wrong, and whether anything is."
    return sentence.format(causes=titles, noise=vocabulary.noise, beside=vocabulary.also)


def cause_blocks(
    diagnosis: Diagnosis, machine_file: Path | None = None, held_out_file: bool = False
) -> tuple[doc.Block, ...]:
    """Each cause with place, size and remedy, and what all of them together are worth."""
    causes = diagnosis.causes
    if not causes:
        return ()
    blocks: list[doc.Block] = []
    said = diagnosis.model.machine.vocabulary.said
    gain = _gain(diagnosis, held_out_file)
    for cause in causes:
        own = _cause(cause, diagnosis, machine_file)
        blocks.append(doc.Paragraph((doc.Strong(cause.id), f": {said(CAUSES[cause.id].title)}")))
        blocks.append(doc.Facts((*own, *gain) if len(causes) == 1 else own))
    if len(causes) > 1:
        blocks += [doc.Paragraph(doc.Strong("Both together")), doc.Facts(gain)]
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        rivals = tuple(
            (" with ".join(ids), said(" and ".join(CAUSES[id].title for id in ids)))
            for ids in diagnosis.rivals
        )
        blocks += [doc.Paragraph("These data are explained as well by"), doc.Facts(rivals)]
    return tuple(blocks)


def _cause(
    cause: NamedCause, diagnosis: Diagnosis, machine_file: Path | None
) -> tuple[tuple[str, doc.Blank], ...]:
    rows: list[tuple[str, doc.Blank]] = []
    if cause.where:
        rows.append(("where", cause.where))
    if cause.parameters:
        rows.append(("size", _size(cause.parameters, diagnosis.model.machine)))
    rows.append(("mend", diagnosis.model.machine.vocabulary.said(cause.advice)))
    doubt = diagnosis.model.machine.companions.get(cause.id)
    if doubt is not None:
        rows.append(("doubt", doubt))
    if cause.recommended:
        option = f"--accept {cause.id}"
        accept = about("diagnose", diagnosis.source, machine=machine_file, options=option)
        rows.append(("or accept", doc.Typed(accept)))
    elif not cause.in_machine:
        rows.append(("note", "It lies in the measurement: nothing for the controller to correct."))
    else:
        rows.append(("note", "Making it part of the machine's model is not recommended."))
    if cause.aliases and diagnosis.verdict is not Verdict.AMBIGUOUS:
        rows.append(("looks like", ", ".join(cause.aliases)))
    return tuple(rows)


def _size(parameters: Mapping[str, Estimate], machine: Machine) -> str:
    """Parameters with what the table of this kind of machine states: U, or standard deviations."""
    sizes, k = [], half_width(math.inf) if machine.absolute else 1.0
    for name, found in parameters.items():
        # A single parameter needs no name.
        place = machine.vocabulary.axes.get(name) or _PLACES.get(name, name)
        size = with_uncertainty(found.value, k * found.std) if found.std else f"{found.value:+g}"
        named = f"{place} {size}" if len(parameters) > 1 else size
        sizes.append(f"{named} {unit_words(found.unit)}".rstrip())
    meant = f" (± U, {coverage_words(k)})" if machine.absolute else ""
    return "; ".join(sizes) + meant


def _gain(diagnosis: Diagnosis, held_out_file: bool) -> tuple[tuple[str, doc.Blank], ...]:
    """What all accepted causes together are worth."""
    first = diagnosis.causes[0]
    with_it = "with them" if len(diagnosis.causes) > 1 else "with it"
    many = diagnosis.model.machine.vocabulary.many

    def gain(before: float, after: float, what: str) -> str:
        return f"{plain(before, 4)} mm {what}with {many} only, {plain(after, 4)} mm {with_it}"

    rows: list[tuple[str, doc.Blank]] = [("probability", percent(first.probability, 1))]
    nothing = diagnosis.nothing_wrong
    if nothing is not None:
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
            return str(diagnosis.model.machine.vocabulary.said(CAUSES[ids[0]].title))
        if explanation.pattern is not None:
            return str(diagnosis.model.machine.vocabulary.said(explanation.pattern))
        return " and ".join(ids) or "no cause"

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
    vocabulary, measured = diagnosis.model.machine.vocabulary, diagnosis.measured
    left, noise = diagnosis.left_mm, diagnosis.expected_mm
    if not lack.dof:
        told = f"As many {vocabulary.many} as readings: they fit exactly, whatever is wrong."
        return (doc.Paragraph(told),)
    said = [
        f"{vocabulary.many.capitalize()} only leave {plain(left, 4)} mm r.m.s.{measured.weighing};"
        f" this {vocabulary.noise}'s noise{vocabulary.also} would leave"
        f" {plain(noise, 4)} mm. Noise alone leaves as much in {_sessions(lack.p_value)}"
        f" ({counted(lack.dof, 'degree')} of freedom)."
    ]
    if lack.repeats_mm is not None:
        judged = ""
        if lack.repeats_p_value is not None:
            chance = _sessions(lack.repeats_p_value)
            judged = f" Judged by them, noise leaves as much in {chance}."
        said.append(
            f"Repeats scatter by {plain(lack.repeats_mm, 4)} mm.{judged} {vocabulary.repeats}"
        )
    return tuple(map(doc.Paragraph, said))


def _sessions(p_value: float) -> str:
    if p_value < 1e-6:
        return "fewer than 1 of a million sessions"
    share = 100.0 * p_value
    return f"{share:.0f} % of sessions" if share >= 10.0 else f"{share:.2g} % of sessions"
