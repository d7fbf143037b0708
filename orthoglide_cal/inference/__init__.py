"""Inference: hypothesis → fit → belief → decision; what the simulation gets wrong and why."""

from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.inference.result import (
    AssumedSize,
    Baselines,
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
