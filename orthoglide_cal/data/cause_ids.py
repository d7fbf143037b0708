"""The contract's cause ids and the unit that each one's size is written in."""

from __future__ import annotations

CAUSE_UNITS = {
    "axis_gap": "mm",
    "axis_squareness": "mrad",
    "leg_length": "mm",
    "encoder_scale": "1e-3",
    "backlash": "mm",
    "thermal_drift": "mm/h",
    "bar_skew": "mrad",
    "gauge_drift": "mm/h",
    "stand_shift": "mm",
    "gauge_slip": "turns",
    "misread": "mm",
    "sign_flip": "",
    "swapped_gauges": "",
}
CAUSE_IDS = tuple(CAUSE_UNITS)
