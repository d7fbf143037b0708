"""Diagnosis: what the simulation gets wrong, by which cause, and what an extension gains."""

from orthoglide_cal.diagnosis.accept import extend
from orthoglide_cal.diagnosis.diagnose import diagnose
from orthoglide_cal.diagnosis.result import Diagnosis, LackOfFit, NamedCause, NextMeasurement

__all__ = ["Diagnosis", "LackOfFit", "NamedCause", "NextMeasurement", "diagnose", "extend"]
