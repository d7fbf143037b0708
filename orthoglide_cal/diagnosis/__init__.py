"""Diagnosis: what the simulation gets wrong, by which cause, and what an extension gains."""

from orthoglide_cal.diagnosis.baselines import Baselines
from orthoglide_cal.diagnosis.diagnose import diagnose, extend
from orthoglide_cal.diagnosis.result import (
    AssumedSize,
    Diagnosis,
    Explanation,
    FoundCause,
    LackOfFit,
    NextMeasurement,
    Otherwise,
    TimesStated,
    UnshownFault,
    Verdict,
    nothing_wrong,
)
