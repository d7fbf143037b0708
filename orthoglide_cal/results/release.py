"""May the offsets be entered in the controller? One rule for every command that says so."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import (
    Diagnosis,
    NextMeasurement,
    UnshownFault,
    Verdict,
    nothing_wrong,
)
from orthoglide_cal.estimation import Solution
from orthoglide_cal.estimation.accuracy import half_width
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.results.answer import Release, Remedy
from orthoglide_cal.words import counted, percent

_NAMED = 1  # rivals, in one sentence


def release(
    solution: Solution, diagnosis: Diagnosis | None, following: NextMeasurement | None = None
) -> Release:
    """Whether the solution's offsets may be entered, from its own check and the diagnosis.

    Readings that this gauge can hardly have shown prevent it, whatever fits them. A named cause
    prevents it only if it moves the offsets by more than their uncertainty.

    Args:
        solution: of the offsets alone, with the accepted causes; it checks itself again here.
        diagnosis: of the same data; None if it was not or could not be made.
        following: what would distinguish the explanations that it leaves open; None without.
    """
    failures = tuple(_failures(solution, diagnosis))
    vocabulary = solution.model.machine.vocabulary
    if diagnosis is None or diagnosis.verdict is Verdict.CONSISTENT:
        judged = Release()
    elif diagnosis.verdict is Verdict.NAMED:
        judged = _named(solution, diagnosis)
    elif diagnosis.verdict is Verdict.AMBIGUOUS:
        judged = _ambiguous(solution, diagnosis, following)
    elif failures:
        # What the check found is the explanation.
        judged = Release()
    else:
        usual = " of usual size" if diagnosis.beyond_tolerance else ""
        lack = diagnosis.lack_of_fit
        reason = (
            f"No listed cause{usual} explains these data: they leave {lack.left_mm:.3f} mm r.m.s.,"
            f" where the {vocabulary.noise}'s noise{vocabulary.also} would leave"
            f" {lack.expected_mm:.3f} mm."
        )
        judged = Release(reasons=(reason,), remedies=(Remedy(sentence=vocabulary.again),))
    if not failures:
        more = tuple(_cautions(solution, diagnosis)) if judged.usable else ()
        return judged.changed(cautions=(*judged.cautions, *more))
    return Release(
        reasons=(*(reason for reason, _ in failures), *judged.reasons),
        remedies=(*(remedy for _, remedy in failures), *judged.remedies),
        sound=False,
    )


def _cautions(solution: Solution, diagnosis: Diagnosis | None) -> Iterator[str]:
    """What to know of offsets that are released."""
    rough = 1.0 if diagnosis is None else diagnosis.left_open[0][1].scale_factor
    if solution.suspicious and rough > 1.0:
        yield (
            f"The bed's local shape is about {rough:.1f} times as large as is stated or usual, and"
            " U does not cover all of that. State it as texture_mm of the probe."
        )
    elif not solution.dof or (
        solution.suspicious and (diagnosis is None or diagnosis.verdict is Verdict.CONSISTENT)
    ):
        # Without spare readings nothing can contradict or support the offsets. What a named
        # cause explains does not.
        yield solution.judgement


def _failures(solution: Solution, diagnosis: Diagnosis | None) -> Iterator[tuple[str, Remedy]]:
    """What the solution's own check has against it, each with what to do."""
    machine, vocabulary = solution.model.machine, solution.model.machine.vocabulary
    if not solution.converged:
        what = f"The search for the {vocabulary.many} did not converge."
        yield what, Remedy(sentence="Check the file:", verb="validate")
        return
    columns = machine.parameter_names, machine.parameter_units, solution.offsets_mm.tolist()
    parameters = zip(*columns, machine.plausible, strict=True)
    beyond = [each for each in parameters if abs(each[2]) > each[3]]
    if beyond:
        listed = ", ".join(f"{name} {value:+.1f} {unit}" for name, unit, value, _ in beyond)
        limit = ", ".join(dict.fromkeys(f"{most:g} {unit}" for _, unit, _, most in beyond))
        why = vocabulary.beyond.format(limit=limit)
        yield f"{vocabulary.one.capitalize()} {listed}: {why}", Remedy(sentence=vocabulary.recheck)
    pairs = zip(machine.parameter_names, solution.determined, strict=True)
    open_ = [name for name, known in pairs if not known]
    if open_:
        yield (
            f"These readings do not determine {', '.join(open_)}: they add nothing to what is"
            " known without them.",
            Remedy(sentence=vocabulary.more),
        )
    for doubt in solution.doubts:
        yield doubt.what, Remedy(sentence=doubt.remedy)
    if diagnosis is None and solution.suspicious:
        yield solution.judgement, Remedy(sentence=vocabulary.more)


def _ambiguous(
    solution: Solution, diagnosis: Diagnosis, following: NextMeasurement | None
) -> Release:
    vocabulary = solution.model.machine.vocabulary
    answer = " with ".join(cause.id for cause in diagnosis.causes) or "a cause"
    open_ = [answer, *map(" with ".join, diagnosis.rivals[:_NAMED])]
    if len(diagnosis.rivals) > _NAMED:
        open_.append(counted(len(diagnosis.rivals) - _NAMED, "other"))
    either = " or ".join(filter(None, (", ".join(open_[:-1]), open_[-1])))
    sound = nothing_wrong(diagnosis.explanations) is not None
    reasons = [
        f"Something {'may be' if sound else 'is'} wrong besides the {vocabulary.many}: {either}."
        f" These data do not distinguish {'them' if diagnosis.rivals else 'it'}"
        f"{', nor from a sound machine' if sound else ''}."
    ]
    advice = [cause.remedy for cause in diagnosis.causes] or [vocabulary.more]
    if following is not None:
        advice = [following.what]
    if diagnosis.measured.kind is DataKind.READINGS and diagnosis.spare <= 0:
        reasons.append("With so few readings nearly anything fits.")
        advice = [vocabulary.more]
    remedies = tuple(Remedy(sentence=each) for each in dict.fromkeys(advice))
    return Release(reasons=tuple(reasons), remedies=remedies)


def _to_check(diagnosis: Diagnosis, names: str, faults: Sequence[UnshownFault]) -> Release:
    """What these readings would not show must be looked at before anything is entered."""
    machine, reasons, remedies = diagnosis.model.machine, [f"{names} was found."], []
    for fault in faults:
        title = CAUSES[fault.id].words(machine).title
        where = f" ({fault.where})" if fault.where else ""
        reasons.append(
            f"If {title} as well{where}, which these readings would not show, the"
            f" {machine.vocabulary.many} change by up to {fault.change:.3f} {fault.unit}."
        )
        look = f"Check whether {title}{where}. What shows it: {fault.check}. If all is in order,"
        ruled_out = f"--rule-out {fault.id}"
        remedies.append(Remedy(sentence=f"{look} say so:", verb="diagnose", options=ruled_out))
    return Release(reasons=tuple(reasons), remedies=tuple(remedies))


def _named(solution: Solution, diagnosis: Diagnosis) -> Release:
    machine = solution.model.machine
    one, many = machine.vocabulary.one, machine.vocabulary.many
    ids = " and ".join(cause.id for cause in diagnosis.causes)
    titles = " and ".join(CAUSES[cause.id].words(machine).title for cause in diagnosis.causes)
    shift = np.abs(solution.offsets_mm - diagnosis.offsets_mm)
    largest = f"{float(shift.max()):.3f} {machine.parameter_units[int(np.argmax(shift))]}"
    check = [fault for fault in diagnosis.unshown if fault.matters]
    if check:
        return _to_check(diagnosis, ids, check)
    if np.all(shift <= half_width(np.inf) * diagnosis.std_mm):
        moves = "moves" if len(diagnosis.causes) == 1 else "move"
        within = f"{ids} {moves} no {one} by more than {largest}, which is within U."
        return Release(cautions=(within,))
    # A slip in the record is looked for sooner than a machine is taken apart.
    remedies = [
        Remedy(
            sentence=f"Correct it, or make {cause.id} part of the machine and use the new machine"
            " file:",
            verb="diagnose",
            options=f"--accept {cause.id}",
        )
        if cause.recommended
        else Remedy(sentence=cause.remedy)
        for cause in sorted(diagnosis.causes, key=lambda cause: cause.in_machine)
    ]
    sure = f"{titles[0].upper()}{titles[1:]} ({ids}, {percent(diagnosis.causes[0].probability, 1)})"
    reason = f"{sure}: {many} alone would be wrong by up to {largest}."
    return Release(reasons=(reason,), remedies=tuple(dict.fromkeys(remedies)))
