"""Two sessions of one machine, before and after an adjustment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orthoglide_cal.causes import machine_effects
from orthoglide_cal.errors import UsageError
from orthoglide_cal.outcome.case import Case
from orthoglide_cal.verification import Verification, verify

_SAME = ("leg_length_mm", "joint_limits_mm", "identified")


def verify_cases(
    before: Case,
    after: Case,
    applied_mm: Sequence[float] | None = None,
    limit_mm: float | None = None,
) -> Verification:
    """Verify the adjustment between two inputs.

    Args:
        before, after: measured on the same machine.
        applied_mm: what was added to the controller's offsets; None takes the difference between
            the offsets that the two sessions record as active.
        limit_mm: largest deviation allowed; None for no decision.

    Raises:
        UsageError: different machines, or nobody says what was applied.
    """
    different = [
        name for name in _SAME if getattr(before.machine, name) != getattr(after.machine, name)
    ]
    if different:
        raise UsageError(
            f"The two sessions are of different machines: {', '.join(different)} differ.",
            "Give the machine that both are to be judged by: --machine FILE",
        )
    if applied_mm is None:
        applied_mm = _recorded(before, after)
    return verify(
        before.measured,
        after.measured,
        before.machine,
        applied_mm,
        limit_mm,
        machine_effects(before.machine),
    )


def _recorded(before: Case, after: Case) -> list[float]:
    """Difference of the active offsets of two sessions, rounded as offsets are entered [mm]."""
    change = np.array(after.machine.offsets_mm) - np.array(before.machine.offsets_mm)
    if not (before.session and after.session) or not np.any(change):
        raise UsageError(
            "The files do not say what was entered in the controller between them.",
            "Say it: --applied DX DY DZ",
        )
    rounded: list[float] = change.round(9).tolist()
    return rounded
