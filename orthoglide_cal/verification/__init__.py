"""Did the correction do what was promised? Two sessions and what was entered between them."""

from orthoglide_cal.verification.remeasured import Remeasured, remeasure
from orthoglide_cal.verification.response import AxisResponse, Behaviour, Coefficient
from orthoglide_cal.verification.verify import (
    RULE,
    Outcome,
    Size,
    Verification,
    require_limit,
    verify,
)

__all__ = [
    "RULE",
    "AxisResponse",
    "Behaviour",
    "Coefficient",
    "Outcome",
    "Remeasured",
    "Size",
    "Verification",
    "remeasure",
    "require_limit",
    "verify",
]
