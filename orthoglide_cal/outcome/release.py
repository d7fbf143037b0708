"""May the offsets be entered in the controller? One rule for the report and for the export."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.diagnosis.result import AMBIGUOUS, CONSISTENT, NAMED, Diagnosis
from orthoglide_cal.estimation import Solution
from orthoglide_cal.outcome.answer import diagnosed_answer


@dataclass(frozen=True)
class Release:
    """The decision.

    Attributes:
        usable: True if the offsets may be entered.
        reasons: why not, in sentences; empty if usable.
        remedies: what to do instead, in sentences.
        cautions: what to know although they may be entered.
    """

    usable: bool
    reasons: tuple[str, ...] = ()
    remedies: tuple[str, ...] = ()
    cautions: tuple[str, ...] = ()


def release(solution: Solution, diagnosis: Diagnosis | None) -> Release:
    """Whether the solution's offsets may be entered, from its own check and the diagnosis.

    A cause that was named only bars them if it moves them by more than their uncertainty.
    """
    if not solution.converged:
        return Release(
            False,
            ("The search for the offsets did not converge.",),
            ("Check the readings: orthocal validate",),
        )
    if diagnosis is None and solution.suspicious:
        return Release(False, (solution.judgement,), ("Find out what: orthocal diagnose FILE",))
    if diagnosis is None or diagnosis.verdict == CONSISTENT:
        # Without spare readings nothing can speak against the offsets, nor for them.
        return Release(True, cautions=() if solution.dof else (solution.judgement,))
    if diagnosis.verdict == AMBIGUOUS:
        first = diagnosis.causes[0].id if diagnosis.causes else "a cause"
        rivals = ", ".join(diagnosis.ambiguous_with) or "another cause"
        return Release(
            False,
            (
                f"Something is wrong beside the offsets, and these data cannot tell {first}"
                f" from {rivals}.",
            ),
            _next(diagnosis) or ("Measure again with more postures.",),
        )
    if diagnosis.verdict == NAMED:
        return _named(solution, diagnosis)
    return Release(
        False,
        (
            "The model leaves out something that no known cause explains: residuals of"
            f" {diagnosis.lack_of_fit.residual_mm:.3f} mm where the gauge's noise is"
            f" {diagnosis.lack_of_fit.noise_mm:.3f} mm.",
        ),
        (*_next(diagnosis), "Check the set-up, measure again, and compare the two sessions."),
    )


def _named(solution: Solution, diagnosis: Diagnosis) -> Release:
    names = " and ".join(cause.id for cause in diagnosis.causes)
    corrected = diagnosed_answer(diagnosis)
    shift = np.abs(solution.offsets_mm - corrected.offsets_mm)
    largest = f"{float(shift.max()):.3f} mm"
    if np.all(shift <= corrected.expanded_mm):
        return Release(
            True,
            cautions=(
                f"{names} was found; it moves no offset by more than {largest}, which is within"
                " the uncertainty.",
            ),
        )
    remedies = []
    for cause in diagnosis.causes:
        if cause.in_machine and cause.recommended:
            remedies.append(
                f"Mend it, or make {cause.id} part of the machine and use the new machine file:"
                f" orthocal diagnose FILE --accept {cause.id}"
            )
        else:
            remedies.append(cause.advice)
    return Release(
        False,
        (f"{names} was found: the offsets without it would be wrong by up to {largest}.",),
        tuple(dict.fromkeys(remedies)),
    )


def _next(diagnosis: Diagnosis) -> tuple[str, ...]:
    return (diagnosis.next_measurement.what,) if diagnosis.next_measurement else ()
