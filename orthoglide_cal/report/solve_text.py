"""A solution as text for a terminal of 80 columns."""

from __future__ import annotations

from orthoglide_cal.estimation import Solution
from orthoglide_cal.machine import Machine


def render(solution: Solution, machine: Machine) -> str:
    """The whole answer."""
    return str(solution.offsets_mm)
