"""May the offsets be entered in the controller? One rule for every command that speaks of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from orthoglide_cal.diagnosis import Diagnosis, Verdict
from orthoglide_cal.estimation import Solution
from orthoglide_cal.estimation.accuracy import half_width
from orthoglide_cal.model import gauge_doubts
from orthoglide_cal.planning import Next


@dataclass(frozen=True)
class Remedy:
    """What to do instead.

    Attributes:
        sentence: in words; ends with a colon where a command follows.
        verb: of the command about the same file that does it; None without one.
        options: of that command, as they are typed.
    """

    sentence: str
    verb: str | None = None
    options: str = ""


@dataclass(frozen=True)
class Release:
    """The decision.

    Attributes:
        reasons: why the offsets must not be entered, in sentences; empty if they may be.
        remedies: what to do instead.
        cautions: what to know although they may be entered.
        sound: False if there are no offsets, or they fail their own check: whatever the diagnosis
            says, they are of no use.
    """

    reasons: tuple[str, ...] = ()
    remedies: tuple[Remedy, ...] = ()
    cautions: tuple[str, ...] = ()
    sound: bool = True

    @property
    def usable(self) -> bool:
        """True if the offsets may be entered."""
        return not self.reasons


def release(
    solution: Solution, diagnosis: Diagnosis | None, following: Next | None = None
) -> Release:
    """Whether the solution's offsets may be entered, from its own check and the diagnosis.

    Readings that this gauge can hardly have shown bar them, whatever fits them. A cause that was
    named only bars them if it moves them by more than their uncertainty.

    Args:
        solution: of the offsets alone, with the accepted causes; it checks itself again here.
        diagnosis: of the same data; None if it was not or could not be made.
        following: what would tell apart the explanations that it leaves open; None without.
    """
    failures = tuple(_failures(solution, diagnosis))
    judged = Release() if diagnosis is None else _judged(solution, diagnosis, following)
    if not failures:
        # Without spare readings nothing can speak against the offsets, nor for them.
        told = judged.usable and (not solution.dof or solution.suspicious)
        return replace(judged, cautions=(*judged.cautions, *[solution.judgement] * told))
    if diagnosis is not None and diagnosis.verdict is Verdict.UNEXPLAINED:
        # What the check found is the explanation.
        judged = Release()
    return Release(
        reasons=(*(reason for reason, _ in failures), *judged.reasons),
        remedies=(*(remedy for _, remedy in failures), *judged.remedies),
        sound=False,
    )


def _failures(solution: Solution, diagnosis: Diagnosis | None) -> Iterator[tuple[str, Remedy]]:
    """What the solution's own check has against it, each with what to do."""
    if not solution.converged:
        many = solution.model.kind.speech.many
        yield f"The search for the {many} did not converge.", Remedy("Check the file:", "validate")
        return
    kind, speech = solution.model.kind, solution.model.kind.speech
    limits = kind.plausible(solution.model.machine)
    columns = (kind.calibrated, kind.units, solution.offsets_mm.tolist(), limits)
    parameters = tuple(zip(*columns, strict=True))
    beyond = [each for each in parameters if abs(each[2]) > each[3]]
    if beyond:
        listed = ", ".join(f"{name} {value:+.1f} {unit}" for name, unit, value, _ in beyond)
        limit = ", ".join(dict.fromkeys(f"{most:g} {unit}" for _, unit, _, most in beyond))
        why = speech.beyond.format(limit=limit)
        yield f"{speech.one.capitalize()} {listed}: {why}", Remedy(speech.recheck)
    open_ = [
        name for name, known in zip(kind.calibrated, solution.determined, strict=True) if not known
    ]
    if open_:
        yield (
            f"These readings do not determine {' and '.join(open_)}: no better than what is known"
            " without them.",
            Remedy(speech.more),
        )
    for doubt in gauge_doubts(solution.measured, solution.model.machine.gauge):
        yield doubt.what, Remedy(doubt.remedy)
    if diagnosis is None and solution.suspicious:
        yield solution.judgement, Remedy(speech.more)


def _judged(solution: Solution, diagnosis: Diagnosis, following: Next | None) -> Release:
    """What the diagnosis has against the offsets."""
    speech = solution.model.kind.speech
    if diagnosis.verdict is Verdict.CONSISTENT:
        return Release()
    if diagnosis.verdict is Verdict.NAMED:
        return _named(solution, diagnosis)
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        first = diagnosis.causes[0].id if diagnosis.causes else "a cause"
        rivals = ", ".join(diagnosis.ambiguous_with) or "another cause"
        return Release(
            (
                f"Something is wrong beside the {speech.many}, and these data cannot tell {first}"
                f" from {rivals}.",
            ),
            ((Remedy(following.option.what),) if following else ())
            or tuple(dict.fromkeys(Remedy(cause.advice) for cause in diagnosis.causes))
            or (Remedy(speech.more),),
        )
    return Release(
        (
            "The model leaves out something that no known cause explains: readings scatter about"
            f" it by {diagnosis.lack_of_fit.residual_mm:.3f} mm where the {speech.noise}'s noise is"
            f" {diagnosis.lack_of_fit.noise_mm:.3f} mm (standard deviations).",
        ),
        (Remedy("Check the set-up, measure again, and compare the two sessions."),),
    )


def _named(solution: Solution, diagnosis: Diagnosis) -> Release:
    names = " and ".join(cause.id for cause in diagnosis.causes)
    kind = solution.model.kind
    one, many = kind.speech.one, kind.speech.many
    shift = np.abs(solution.offsets_mm - diagnosis.offsets_mm)
    largest = f"{float(shift.max()):.3f} {kind.units[int(np.argmax(shift))]}"
    if np.all(shift <= half_width(np.inf) * diagnosis.std_mm):
        return Release(
            cautions=(
                f"{names} was found; it moves no {one} by more than {largest}, which is within"
                " the uncertainty.",
            ),
        )
    remedies = [
        Remedy(
            f"Mend it, or make {cause.id} part of the machine and use the new machine file:",
            "diagnose",
            f"--accept {cause.id}",
        )
        if cause.in_machine and cause.recommended
        else Remedy(cause.advice)
        for cause in diagnosis.causes
    ]
    return Release(
        (f"{names} was found: the {many} without it would be wrong by up to {largest}.",),
        tuple(dict.fromkeys(remedies)),
    )
