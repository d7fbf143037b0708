"""Diagnosis: what the simulation gets wrong, by which cause, and what an extension gains."""

from orthoglide_cal.diagnosis.diagnose import diagnose, extend
from orthoglide_cal.diagnosis.result import (
    Diagnosis,
    Explanation,
    NamedCause,
    NextMeasurement,
    Verdict,
)
