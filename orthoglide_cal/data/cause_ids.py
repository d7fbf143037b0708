"""The known cause ids and the unit that each one's size is written in."""

from __future__ import annotations

from orthoglide_cal.causes import CAUSES

CAUSE_UNITS = {id: cause.unit for id, cause in CAUSES.items()}
CAUSE_IDS = tuple(CAUSE_UNITS)
