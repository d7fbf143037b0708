"""What a technician is told: may the offsets be entered, which, how sure, what is left, history."""

from orthoglide_cal.results.adjustment import Adjustment, CheckPosture, JointOffset
from orthoglide_cal.results.application import Application, Recording, apply, recording, take_back
from orthoglide_cal.results.calibration import (
    Calibration,
    Export,
    Identity,
    calibrate,
    export,
    identify,
)
from orthoglide_cal.results.history import Drift, Entry, History, history
from orthoglide_cal.results.release import Release, Remedy, release
from orthoglide_cal.results.residuals import Explained, Residuals
from orthoglide_cal.results.trend import Trend

__all__ = [
    "Adjustment",
    "Application",
    "Calibration",
    "CheckPosture",
    "Drift",
    "Entry",
    "Explained",
    "Export",
    "History",
    "Identity",
    "JointOffset",
    "Recording",
    "Release",
    "Remedy",
    "Residuals",
    "Trend",
    "apply",
    "calibrate",
    "export",
    "history",
    "identify",
    "recording",
    "release",
    "take_back",
]
