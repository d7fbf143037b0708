"""Checks of a reading by itself: can this gauge show that number at all?"""

from __future__ import annotations

from collections.abc import Sequence

from orthoglide_cal.data.numbers import MM_PER_INCH
from orthoglide_cal.machine import Gauge
from orthoglide_cal.session.doubts import Doubt, Question
from orthoglide_cal.session.events import Questioned
from orthoglide_cal.session.history import History
from orthoglide_cal.session.state import State

# A reading may miss the gauge's scale by this fraction of a division through rounding alone.
_OFF_SCALE = 0.02


def check_entry(
    state: State, history: History, value: float, gauge: Gauge, inches: bool
) -> Question | None:
    """The question that the number itself raises; None if the gauge can show it.

    Args:
        state: the session so far: what was kept once is not questioned again.
        history: the readings so far.
        value: the reading [mm].
        gauge: the indicator.
        inches: the reading was given in inches.
    """
    earlier = history.value[history.series()].tolist()
    if _beyond(value, earlier, gauge.range_mm):
        return Question(Doubt.RANGE, _range_text(value, earlier, gauge))
    if _off_scale(value, gauge, inches) and not _kept(state, Doubt.GRID):
        return Question(
            Doubt.GRID,
            f"{value:g} mm lies between the gauge's divisions of {gauge.resolution_mm:g} mm:"
            " mistyped?",
        )
    return None


def _beyond(value: float, earlier: Sequence[float], travel: float) -> bool:
    """Further from zero, or later from the gauge's other readings, than its plunger travels."""
    if not earlier:
        return abs(value) > travel
    return max(abs(value - other) for other in earlier) > travel


def _range_text(value: float, earlier: Sequence[float], gauge: Gauge) -> str:
    if earlier:
        return (
            f"{value:+g} mm is further from {earlier[-1]:+g} mm than the gauge's travel of"
            f" {gauge.range_mm:g} mm: mistyped?"
        )
    return f"{value:+g} mm is beyond the gauge's travel of {gauge.range_mm:g} mm: mistyped?"


def _off_scale(value: float, gauge: Gauge, inches: bool) -> bool:
    division = gauge.resolution_mm
    if inches:
        # An inch gauge's divisions need not be those of the mm scale in the machine file.
        in_tenths = division / MM_PER_INCH * 1e5
        if abs(in_tenths - round(in_tenths)) > 1e-6:
            return False
    steps = value / division
    return abs(steps - round(steps)) > _OFF_SCALE


def _kept(state: State, doubt: Doubt) -> bool:
    return any(
        isinstance(item.take, Questioned) and item.take.doubt == doubt
        for item in state.accepted.values()
    )
