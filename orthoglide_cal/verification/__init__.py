"""Did the correction do what was promised? Two sessions and what was entered between them."""

from orthoglide_cal.verification.decision import RULE, decide
from orthoglide_cal.verification.result import (
    AxisResponse,
    Change,
    Coefficient,
    Decision,
    Deviation,
    Verification,
)
from orthoglide_cal.verification.verify import verify

__all__ = [
    "RULE",
    "AxisResponse",
    "Change",
    "Coefficient",
    "Decision",
    "Deviation",
    "Verification",
    "decide",
    "verify",
]
