"""Touches of a bed before and after new parameters were entered in the firmware."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc

from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation import Solution, solve
from orthoglide_cal.estimation.accuracy import CONFIDENCE, rms
from orthoglide_cal.files import Input, check_same_printer
from orthoglide_cal.model import Floats, Model, Readings, Source, View
from orthoglide_cal.model.probe_plan import ProbePlan

# Firmwares print parameters to this many of their units.
_SAME = 1e-3


class Parameter(NamedTuple):
    """One parameter; all but the name in its unit.

    Attributes:
        name, unit: which.
        found: change that the touches before asked for.
        expanded: its expanded uncertainty.
        entered: change that was made in the firmware; None where the files do not say.
        left: change that the touches afterwards ask for.
        left_expanded: its expanded uncertainty.
    """

    name: str
    unit: str
    found: float
    expanded: float
    entered: float | None
    left: float
    left_expanded: float

    @property
    def as_found(self) -> bool | None:
        """Whether what was found is what was entered; None where nobody knows."""
        return None if self.entered is None else abs(self.entered - self.found) <= _SAME


@dataclass(frozen=True, eq=False)
class Remeasured:
    """The same bed, touched with the old parameters and with the new ones.

    Attributes:
        before, after: solutions of the two files.
        parameters: what was found, entered and left of each.
        touches: how many there are before, and afterwards.
        found_mm: r.m.s. of the heights with the old parameters.
        promised_mm: r.m.s. that the parameters found would have left of them.
        left_mm: r.m.s. of the heights measured afterwards.
        reachable_mm: r.m.s. that other parameters would leave of those.
    """

    before: Solution
    after: Solution
    parameters: tuple[Parameter, ...]
    touches: tuple[int, int]
    found_mm: float
    promised_mm: float
    left_mm: float
    reachable_mm: float

    @property
    def kept(self) -> bool:
        """Whether no more is left than was promised and noise makes of it (F test, 5 %)."""
        before, after = self.touches
        dof = max(before - len(self.parameters), 1), after - 1
        promised = self.promised_mm**2 * before / dof[0]
        left = self.left_mm**2 * after / dof[1]
        return left <= promised or bool(fdtrc(dof[1], dof[0], left / promised) >= 1.0 - CONFIDENCE)

    @property
    def inputs(self) -> tuple[tuple[Source, Model], ...]:
        """The two files and the machines that they are judged by."""
        return tuple((each.source, each.model) for each in (self.before, self.after))


def _heights(plan: ProbePlan, left: Floats) -> float:
    """r.m.s. of the touches, without their mean: the first layer's height is set apart [mm]."""
    touched = left[~plan.distance]
    return rms(touched - touched.mean())


def remeasure(before: Input, after: Input) -> Remeasured:
    """Compare touches before and after.

    Args:
        before, after: each with the parameters that were in the firmware then.

    Raises:
        UsageError: one of them holds no touches of a bed, or they are of two machines.
        UnusableResultError: one of them determines no parameters.
    """
    touched = [each.measured for each in (before, after) if isinstance(each.measured, Readings)]
    plans = [each.plan for each in touched if each.view is View.BED]
    if len(plans) < 2:
        raise UsageError("Only one of the two files holds touches of a bed.", "Name two that do.")
    check_same_printer(before.model.machine, after.model.machine)
    first, second = (solve(each.measured, each.model) for each in (before, after))
    machine = first.model.machine
    old, new = (np.array(each.model.machine.active) for each in (first, second))
    # A table says nothing of the firmware: with one machine file for both nobody knows.
    stated = before.model.machine != after.model.machine
    entered = (new - old).round(9).tolist() if stated else [None] * len(old)
    columns = (
        *(
            machine.parameter_names,
            machine.parameter_units,
            first.offsets_mm.tolist(),
            first.expanded_mm.tolist(),
        ),
        *(entered, second.offsets_mm.tolist(), second.expanded_mm.tolist()),
    )
    heights = (
        _heights(plan, left)
        for plan, each in zip(plans, (first, second), strict=True)
        for left in (each.measured.value, each.measured.value - each.predicted_mm)
    )
    rows = (Parameter(*row) for row in zip(*columns, strict=True))
    was, now = (int(np.sum(~plan.distance)) for plan in plans)
    return Remeasured(first, second, tuple(rows), (was, now), *heights)
