"""Touches of a bed before and after new parameters were entered in the firmware."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation import Solution, solve
from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.files import Input
from orthoglide_cal.model import Model, Source, View

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
    """

    before: Solution
    after: Solution
    parameters: tuple[Parameter, ...]

    options = ()

    @property
    def inputs(self) -> tuple[tuple[Source, Model], ...]:
        """The two files and the machines that they are judged by."""
        return tuple((each.source, each.model) for each in (self.before, self.after))

    @property
    def found_mm(self) -> float:
        """r.m.s. of the heights with the old parameters."""
        return _heights(self.before)

    @property
    def promised_mm(self) -> float:
        """r.m.s. that the parameters found would have left of them."""
        return _heights(self.before, fitted=True)

    @property
    def left_mm(self) -> float:
        """r.m.s. of the heights measured afterwards."""
        return _heights(self.after)

    @property
    def reachable_mm(self) -> float:
        """r.m.s. that other parameters would leave of those."""
        return _heights(self.after, fitted=True)


def _heights(solution: Solution, fitted: bool = False) -> float:
    """r.m.s. of the touches, without their mean: the first layer's height is set apart [mm]."""
    touched = ~solution.measured.plan.distance  # type: ignore[union-attr]
    left = solution.measured.value - (solution.predicted_mm if fitted else 0.0)
    return rms(left[touched] - left[touched].mean())


def remeasure(before: Input, after: Input) -> Remeasured:
    """Compare touches before and after.

    Args:
        before, after: each with the parameters that were in the firmware then.

    Raises:
        UsageError: one of them holds no touches of a bed.
        UnusableResultError: one of them determines no parameters.
    """
    if {each.measured.view for each in (before, after)} != {View.BED}:
        raise UsageError("Only one of the two files holds touches of a bed.", "Name two that do.")
    first, second = (solve(each.measured, each.model) for each in (before, after))
    kind = first.model.kind
    old, new = (np.array(kind.active(each.model.machine)) for each in (first, second))
    # A table says nothing of the firmware: with one machine file for both nobody knows.
    stated = before.model.machine != after.model.machine
    entered = (new - old).round(9).tolist() if stated else [None] * len(old)
    columns = (
        *(kind.calibrated, kind.units, first.offsets_mm.tolist(), first.expanded_mm.tolist()),
        *(entered, second.offsets_mm.tolist(), second.expanded_mm.tolist()),
    )
    return Remeasured(first, second, tuple(Parameter(*row) for row in zip(*columns, strict=True)))
