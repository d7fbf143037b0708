"""Inference: hypothesis → fit → belief → decision; what the simulation gets wrong and why."""

from orthoglide_cal.inference.diagnose import diagnose, extend
from orthoglide_cal.inference.result import (
    AssumedSize,
    Baselines,
    Diagnosis,
    Explanation,
    FoundCause,
    FoundPattern,
    LackOfFit,
    NextMeasurement,
    Otherwise,
    Parameter,
    TimesStated,
    UnshownFault,
    Verdict,
    nothing_wrong,
)
