"""May the offsets be entered in the controller? One rule for every command that speaks of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.diagnosis import Diagnosis, Verdict
from orthoglide_cal.estimation import Solution
from orthoglide_cal.estimation.accuracy import half_width


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
        usable: True if the offsets may be entered.
        reasons: why not, in sentences; empty if usable.
        remedies: what to do instead.
        cautions: what to know although they may be entered.
    """

    usable: bool
    reasons: tuple[str, ...] = ()
    remedies: tuple[Remedy, ...] = ()
    cautions: tuple[str, ...] = ()


def release(solution: Solution, diagnosis: Diagnosis | None) -> Release:
    """Whether the solution's offsets may be entered, from its own check and the diagnosis.

    A cause that was named only bars them if it moves them by more than their uncertainty.

    Args:
        solution: of the offsets alone, with the accepted causes; it checks itself again here.
        diagnosis: of the same data; None if it was not or could not be made.
    """
    if not solution.converged:
        return Release(
            False,
            ("The search for the offsets did not converge.",),
            (Remedy("Check the readings:", "validate"),),
        )
    if diagnosis is None and solution.suspicious:
        return Release(False, (solution.judgement,), (Remedy("Find out what:", "diagnose"),))
    if diagnosis is None or diagnosis.verdict is Verdict.CONSISTENT:
        # Without spare readings nothing can speak against the offsets, nor for them.
        return Release(True, cautions=() if solution.dof else (solution.judgement,))
    if diagnosis.verdict is Verdict.NAMED:
        return _named(solution, diagnosis)
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        first = diagnosis.causes[0].id if diagnosis.causes else "a cause"
        rivals = ", ".join(diagnosis.ambiguous_with) or "another cause"
        return Release(
            False,
            (
                f"Something is wrong beside the offsets, and these data cannot tell {first}"
                f" from {rivals}.",
            ),
            _next(diagnosis) or (Remedy("Measure again with more postures."),),
        )
    return Release(
        False,
        (
            "The model leaves out something that no known cause explains: residuals of"
            f" {diagnosis.lack_of_fit.residual_mm:.3f} mm where the gauge's noise is"
            f" {diagnosis.lack_of_fit.noise_mm:.3f} mm.",
        ),
        (
            *_next(diagnosis),
            Remedy("Check the set-up, measure again, and compare the two sessions."),
        ),
    )


def _named(solution: Solution, diagnosis: Diagnosis) -> Release:
    names = " and ".join(cause.id for cause in diagnosis.causes)
    shift = np.abs(solution.offsets_mm - diagnosis.offsets_mm)
    largest = f"{float(shift.max()):.3f} mm"
    if np.all(shift <= half_width(np.inf) * diagnosis.std_mm):
        return Release(
            True,
            cautions=(
                f"{names} was found; it moves no offset by more than {largest}, which is within"
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
        False,
        (f"{names} was found: the offsets without it would be wrong by up to {largest}.",),
        tuple(dict.fromkeys(remedies)),
    )


def _next(diagnosis: Diagnosis) -> tuple[Remedy, ...]:
    return (Remedy(diagnosis.next_measurement.what),) if diagnosis.next_measurement else ()
