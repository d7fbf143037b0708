"""The parts of a calibration report, each made from the calibration's results."""

from orthoglide_cal.report.sections.answer import intervals, notice, offsets, to_do
from orthoglide_cal.report.sections.cause import diagnosis
from orthoglide_cal.report.sections.conditions import conditions, moment, origin
from orthoglide_cal.report.sections.fit import found_and_left, improvement, wrong
from orthoglide_cal.report.sections.workspace import workspace

__all__ = [
    "conditions",
    "diagnosis",
    "found_and_left",
    "improvement",
    "intervals",
    "moment",
    "notice",
    "offsets",
    "origin",
    "to_do",
    "workspace",
    "wrong",
]
