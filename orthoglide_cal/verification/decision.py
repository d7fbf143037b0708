"""Pass or fail against a stated limit, in the manner of ISO 14253-1."""

from __future__ import annotations

from collections.abc import Sequence

from orthoglide_cal.verification.result import FAIL, PASS, UNDECIDED, Decision, Deviation

RULE = (
    "Pass if |deviation| + U is within the limit for every difference; fail if |deviation| - U is"
    " beyond it for any; otherwise undecided (guard band U on both sides, as in ISO 14253-1)."
)


def decide(deviations: Sequence[Deviation], limit_mm: float) -> Decision:
    """Compare every deviation measured after the correction with the limit.

    Args:
        deviations: at least one.
        limit_mm: largest size of a deviation that is allowed.
    """
    largest = max(deviations, key=lambda d: abs(d.after_mm))
    if any(abs(d.after_mm) - d.expanded_mm > limit_mm for d in deviations):
        outcome = FAIL
    elif all(abs(d.after_mm) + d.expanded_mm <= limit_mm for d in deviations):
        outcome = PASS
    else:
        outcome = UNDECIDED
    return Decision(limit_mm, outcome, abs(largest.after_mm), largest.name, largest.expanded_mm)
