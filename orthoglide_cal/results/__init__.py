"""What a technician is told: may the offsets be entered, which, how sure, what is left."""

from orthoglide_cal.results.adjustment import Adjustment, CheckPosture, JointOffset
from orthoglide_cal.results.answer import Answer, Release, Remedy
from orthoglide_cal.results.application import Application, Recording, apply, recording, take_back
from orthoglide_cal.results.calibration import (
    Calibration,
    Export,
    Identity,
    calibrate,
    export,
    identify,
)
from orthoglide_cal.results.making import answer_to
from orthoglide_cal.results.release import release
from orthoglide_cal.results.residuals import Explained, Residuals

__all__ = [
    "Adjustment",
    "Answer",
    "Application",
    "Calibration",
    "CheckPosture",
    "Explained",
    "Export",
    "Identity",
    "JointOffset",
    "Recording",
    "Release",
    "Remedy",
    "Residuals",
    "answer_to",
    "apply",
    "calibrate",
    "export",
    "identify",
    "recording",
    "release",
    "take_back",
]
