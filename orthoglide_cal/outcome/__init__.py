"""What follows from a solution and a diagnosis: release, adjustment, workspace error, history."""

from orthoglide_cal.outcome.adjustment import Adjustment, CheckPosture, JointOffset
from orthoglide_cal.outcome.answer import Answer
from orthoglide_cal.outcome.calibration import Calibration, Findings, Identity, calibrate, identify
from orthoglide_cal.outcome.case import Case, Conditions, GaugeIdentity, read_case
from orthoglide_cal.outcome.compensation import Compensation, compensation
from orthoglide_cal.outcome.folder import latest_session
from orthoglide_cal.outcome.history import Drift, Entry, History, history
from orthoglide_cal.outcome.release import Release, release
from orthoglide_cal.outcome.traces import Traces
from orthoglide_cal.outcome.workspace import WorkspaceError

__all__ = [
    "Adjustment",
    "Answer",
    "Calibration",
    "Case",
    "CheckPosture",
    "Compensation",
    "Conditions",
    "Drift",
    "Entry",
    "Findings",
    "GaugeIdentity",
    "History",
    "Identity",
    "JointOffset",
    "Release",
    "Traces",
    "WorkspaceError",
    "calibrate",
    "compensation",
    "history",
    "identify",
    "latest_session",
    "read_case",
    "release",
]
