"""Pictures as SVG: small functions that take plain arrays and return markup."""

from orthoglide_cal.report.figures.explained import residual_strips, share_bar
from orthoglide_cal.report.figures.history import drift_panels
from orthoglide_cal.report.figures.intervals import Bar, intervals
from orthoglide_cal.report.figures.machine import machine
from orthoglide_cal.report.figures.measured import difference_rows, reading_panels
from orthoglide_cal.report.figures.residuals import residual_panels
from orthoglide_cal.report.figures.workspace import legend, slices

__all__ = [
    "Bar",
    "difference_rows",
    "drift_panels",
    "intervals",
    "legend",
    "machine",
    "reading_panels",
    "residual_panels",
    "residual_strips",
    "share_bar",
    "slices",
]
