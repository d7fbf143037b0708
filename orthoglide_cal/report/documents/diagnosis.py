"""The document of `orthocal diagnose`: what the model leaves out, how sure that is, what to do.

The calibration report shows the same blocks for the verdict, its causes and what to read next.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import NextMeasurement, Verdict
from orthoglide_cal.errors import file_words
from orthoglide_cal.estimation.solution import UNUSUAL
from orthoglide_cal.model import Series, other_axes
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import SETTLED, Case
from orthoglide_cal.report.documents.parameters import (
    alone_block,
    open_blocks,
    parameters_grid,
    parameters_title,
)
from orthoglide_cal.report.documents.pictures import residual_sections
from orthoglide_cal.report.facts import data_words
from orthoglide_cal.results import Answer, FoundCause
from orthoglide_cal.words import (
    chance,
    counted,
    percent,
    plain,
    unit_words,
    with_uncertainty,
)

# Verdict → its tone, and what it says.
_VERDICTS = {
    Verdict.CONSISTENT: (
        doc.Tone.GOOD,
        "Consistent: nothing shows beyond this {noise}'s noise{also}; the model fits.",
    ),
    Verdict.NAMED: (doc.Tone.WARN, "Cause found: {causes}."),
    Verdict.AMBIGUOUS: (
        doc.Tone.WARN,
        "Ambiguous: these data leave open what is wrong. Likeliest: {causes}.",
    ),
    Verdict.UNEXPLAINED: (
        doc.Tone.BAD,
        "Unexplained: something is wrong that no listed cause explains.",
    ),
}
# Instead of "the model fits", where no reading is to spare.
_NOTHING_TO_SPARE = (
    doc.Tone.WARN,
    "Consistent, but there is no reading to spare: these data cannot show whether the model fits.",
)
# And where noise seldom leaves as much.
_UNUSUAL = (
    doc.Tone.INFO,
    "Consistent: what is left is larger than usual for this {noise}'s noise{also}, not large"
    " enough to call the model wrong.",
)
# How parameters take into account what is open.
_WIDENED = {
    Verdict.AMBIGUOUS: "U includes the undecided causes.",
    Verdict.UNEXPLAINED: "U includes what is unexplained.",
}
# A parameter of one leg and direction has the name of that series.
_PLACES = {
    series.name: series.words
    for series in (Series(leg, direction) for leg in range(3) for direction in other_axes(leg))
}
_BEST = 5  # explanations in the ranking


def diagnosis_document(case: Case) -> doc.Document:
    """The whole answer."""
    return doc.Document(
        partial(case.answer.model_dump, mode="json"), partial(_diagnosis_page, case)
    )


def _diagnosis_page(case: Case) -> doc.Page:
    answer, words = case.answer, case.words
    causes = (*cause_blocks(case), *next_blocks(answer))
    release = answer.release
    told: tuple[str, ...] = (f"{SETTLED}.",) if release.settled else ()
    if not release.usable:
        told = (f"Do not enter the {words.many}.", *release.reasons)
    widened = _WIDENED.get(answer.verdict) if answer.verdict else None
    return doc.Page(
        kind="Diagnosis",
        title=file_words(case.source.path),
        facts=doc.Facts(
            (
                ("Data", data_words(case.source, answer.input.kind, answer.input.readings)),
                ("Machine", doc.Given(answer.machine.name)),
            )
        ),
        notice=doc.Notice(
            _verdict(case)[0] if release.sound else doc.Tone.BAD, headline(case), told
        ),
        sections=(
            *((doc.Section(None, causes),) if causes else ()),
            *residual_sections(answer, words.many, fit_blocks(case)),
            doc.Section(
                parameters_title(case),
                (
                    parameters_grid(case),
                    *((doc.Paragraph(widened),) if widened else ()),
                    *open_blocks(case),
                    *(alone_block(case) if answer.sensitivity else ()),
                    *note_blocks(case),
                ),
            ),
        ),
    )


def _verdict(case: Case) -> tuple[doc.Tone, str]:
    answer = case.answer
    if answer.verdict is Verdict.CONSISTENT and answer.lack_of_fit is not None:
        if not answer.lack_of_fit.dof:
            return _NOTHING_TO_SPARE
        if answer.lack_of_fit.p_value < UNUSUAL:
            return _UNUSUAL
    return _VERDICTS[answer.verdict or Verdict.UNEXPLAINED]


def headline(case: Case) -> str:
    """The verdict in one sentence."""
    answer, words = case.answer, case.words
    titles = " and ".join(CAUSES[cause.id].words(case.machine).title for cause in answer.causes)
    sentence = _verdict(case)[1]
    best, nothing = answer.causes[:1], answer.nothing_wrong or 0.0
    if answer.verdict is Verdict.AMBIGUOUS and any(nothing > each.probability for each in best):
        sentence = "Ambiguous: these data leave open what is wrong, and whether anything is."
    return sentence.format(causes=titles, noise=words.noise, also=words.also)


def cause_blocks(case: Case) -> Iterator[doc.Block]:
    """Each cause with place, size and remedy, and what all of them together are worth."""
    answer, machine = case.answer, case.machine
    if not answer.causes:
        return
    gain = tuple(_gain(case))
    for cause in answer.causes:
        own = tuple(_cause(case, cause))
        yield doc.Paragraph((doc.Strong(cause.id), f": {CAUSES[cause.id].words(machine).title}"))
        yield doc.Facts((*own, *gain) if len(answer.causes) == 1 else own)
    if len(answer.causes) > 1:
        yield from (doc.Paragraph(doc.Strong("Both together")), doc.Facts(gain))
    if answer.verdict is Verdict.AMBIGUOUS:
        yield doc.Paragraph("These data are explained as well by")
        yield doc.Facts(
            tuple(
                (" with ".join(ids), " and ".join(CAUSES[id].words(machine).title for id in ids))
                for ids in answer.rivals
            )
        )


def _cause(case: Case, cause: FoundCause) -> Iterator[tuple[str, doc.Blank]]:
    if cause.where:
        yield "where", cause.where
    if cause.parameters:
        yield "size", _size(case, cause)
    yield "remedy", cause.remedy
    doubt = case.machine.companions.get(cause.id)
    if doubt is not None:
        yield "doubt", doubt
    if cause.recommended:
        yield "or accept", doc.Typed(case.typed("diagnose", f"--accept {cause.id}"))
    elif not cause.in_machine:
        yield "note", "It lies in the measurement: nothing for the controller to correct."
    else:
        yield "note", "Making it part of the machine's model is not recommended."
    if cause.aliases and case.answer.verdict is not Verdict.AMBIGUOUS:
        yield "looks like", ", ".join(cause.aliases)


def _size(case: Case, cause: FoundCause) -> str:
    """Its parameters, each with U."""
    sizes = []
    for each in cause.parameters:
        # A single parameter needs no name.
        place = case.words.axes.get(each.name) or _PLACES.get(each.name, each.name)
        size = with_uncertainty(each.value, each.expanded) if each.std else f"{each.value:+g}"
        named = f"{place} {size}" if len(cause.parameters) > 1 else size
        sizes.append(f"{named} {unit_words(each.unit)}".rstrip())
    uncertain = any(each.std for each in cause.parameters)
    return "; ".join(sizes) + (" (± U, 95 %)" if uncertain else "")


def _gain(case: Case) -> Iterator[tuple[str, doc.Blank]]:
    """What all accepted causes together are worth."""
    answer, first = case.answer, case.answer.causes[0]
    with_it = "with them" if len(answer.causes) > 1 else "with it"

    def gain(before: float, after: float, what: str) -> str:
        return (
            f"{plain(before, 4)} mm {what}with {case.words.many} only,"
            f" {plain(after, 4)} mm {with_it}"
        )

    yield "probability", percent(first.probability, 1)
    if answer.nothing_wrong is not None:
        yield "", f"{percent(answer.nothing_wrong, 1)} that nothing is wrong at all"
    yield "residual", gain(first.rms_before_mm, first.rms_after_mm, "r.m.s. ")
    before, after = first.heldout_before_mm, first.heldout_after_mm
    if before is None or after is None:
        return
    where = "the later readings" if answer.holdout else "readings left out of the fit"
    off = f"of {where}: off by {gain(before, after, '')}."
    if after >= before:
        off += " It does not predict better: not recommended as an extension."
    yield "prediction", off


def next_blocks(answer: Answer) -> Iterator[doc.Block]:
    """The measurement that would decide what is open."""
    following = answer.next_measurement
    if following is not None and following.between:
        first, second = between_words(following)
        yield doc.Paragraph((doc.Strong("Measure next: "), following.what))
        yield doc.Paragraph(
            f"It takes about {following.minutes:.0f} min and distinguishes {first} from {second} by"
            f" {following.separation_sigma:.1f} standard deviations."
        )
    elif answer.verdict is Verdict.AMBIGUOUS:
        open_ids = {*answer.ambiguous_with, *(each.id for each in answer.causes if each.aliases)}
        again = (
            " What is open lies in the measurement: measure there again, and leave the old"
            " readings out. Then it does not matter which it was."
        )
        passing = all(not CAUSES[id].in_machine for id in open_ids)
        told = f"No further reading of this kind is likely to decide.{again if passing else ''}"
        yield doc.Paragraph(told)


def between_words(each: NextMeasurement) -> tuple[str, str]:
    """The two explanations that it distinguishes, in words."""
    first, second = (" with ".join(ids) or "a sound machine" for ids in each.between)
    return first, second


def ranking_grid(case: Case) -> doc.Grid:
    """The best of all explanations that were tried."""
    rows = []
    for each in case.answer.explanations[:_BEST]:
        titles = " and ".join(CAUSES[id].words(case.machine).title for id in each.ids)
        words = each.pattern if each.pattern is not None else titles or "no cause"
        rows.append((words if len(each.ids) < 2 else " and ".join(each.ids), each.probability))
    return doc.Grid(
        ("explanation", "probability"),
        tuple((words, percent(share)) for words, share in rows),
        caption="The best explanations of all that were tried.",
    )


def note_blocks(case: Case) -> tuple[doc.Block, ...]:
    """Remarks, the sizes that were assumed, and how the answer depends on the tolerances."""
    answer = case.answer
    notes = list(answer.notes)
    if answer.assumed_sizes:
        # Without its size where the cause has none: it happens or it does not.
        sizes = ", ".join(
            f"{each.id} {each.size:g} {unit_words(each.unit)}" if each.unit else each.id
            for each in answer.assumed_sizes
        )
        notes.append(f"Assumed sizes (not in the machine file): {sizes}.")
    found = answer.verdict, {cause.id for cause in answer.causes}
    changed = answer.sensitivity or {}
    if changed and all((each.verdict, set(each.ids)) == found for each in changed.values()):
        notes.append("Stable when tolerances are halved or doubled.")
    else:
        for how, each in changed.items():
            ids = f": {' and '.join(sorted(each.ids))}" if each.ids else ""
            notes.append(f"With all tolerances {how} the answer is {each.verdict}{ids}.")
    return tuple(doc.Paragraph(note, small=True) for note in notes)


def fit_blocks(case: Case) -> tuple[doc.Block, ...]:
    """Do the parameters alone explain the data?"""
    lack, words = case.answer.lack_of_fit, case.words
    if lack is None:
        return ()
    if not lack.dof:
        told = f"As many {words.many} as readings: they fit exactly, whatever is wrong."
        return (doc.Paragraph(told),)
    said = [
        f"{words.many.capitalize()} only leave {plain(lack.left_mm, 4)} mm"
        f" r.m.s.{case.given.measured.weighing}; this {words.noise}'s noise{words.also} would leave"
        f" {plain(lack.expected_mm, 4)} mm ({chance(lack.p_value)},"
        f" {counted(lack.dof, 'degree')} of freedom)."
    ]
    if lack.repeats_mm is not None:
        judged = ""
        if lack.repeats_p_value is not None:
            judged = f" Judged by them, {chance(lack.repeats_p_value)}."
        said.append(f"Repeats scatter by {plain(lack.repeats_mm, 4)} mm.{judged} {words.repeats}")
    return tuple(map(doc.Paragraph, said))
