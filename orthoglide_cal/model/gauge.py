"""The dial indicator, and what it can hardly have shown, before any model is asked.

A gauge that is held, and inches written as millimetres, look like excellent data to a fit. Healthy
readings of a gauge twice as good as stated are hardly ever doubted.
"""

import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.special import ndtr

from orthoglide_cal.losses import SESSIONS_A_QUESTION
from orthoglide_cal.model.machine import Instrument
from orthoglide_cal.model.measured import Measured, Readings
from orthoglide_cal.model.plan import Floats, Ints
from orthoglide_cal.schema import Number, Reason, ask
from orthoglide_cal.words import MM, MM_PER_INCH

OFF_SCALE = 0.02  # of a division, by which a value may miss it through rounding alone
# Readings in mm that were converted from inches are whole multiples of this step, exactly so if
# they are written to six decimals. Others come within this fraction of a step 1 time in 50.
_INCH_STEP, _OFF_INCHES = 1e-5 * MM_PER_INCH, 0.01
# A printed difference may be one of means; readings that each of them can have.
_MEANS_OF = (*range(1, 11), 12, 20, 30)
_TOO_MUCH = 2.0  # times the stated noise: readings that scatter more are in no such unit
_MEDIAN = 0.6745  # of |x| of a normal x, in standard deviations
_RESERVE = 2.0  # so many times better than their maker states gauges may repeat
_EQUAL_MM = 1e-9  # readings that differ by less are equal but for the rounding of a computer

# Dial indicators repeat within five divisions; the coarsest have tenths, the longest 100 mm.
_MOST_DIVISIONS, _FEWEST_DIVISIONS = 5.0, 20.0
_COARSEST_MM, _LONGEST_MM = 0.1, 100.0

# A unit that may have been taken for millimetres [mm] → what happened, and the remedy.
UNITS: Mapping[float, tuple[str, str]] = MappingProxyType(
    {
        MM_PER_INCH: ("inches written as mm", "Name the column reading_in."),
        1.0 / MM_PER_INCH: ("mm written as inches", "Name the column reading_mm."),
        MM["um"]: ("micrometres written as mm", "Divide them by 1000."),
        MM["m"]: ("metres written as mm", "Multiply them by 1000."),
    }
)

# Where the machine file says nothing: a stand put by eye or with a rule; dial indicators are off by
# up to 15 µm in 10 mm, and a plunger that leans by 2° reads 0.06 % short.
PLACEMENT_MM, SCALE_U = 1.0, 0.001
Fine = Annotated[Number, Field(ge=1e-6, le=100.0)]
Travel = Annotated[Number, Field(ge=1e-3, le=1e3)]


class Gauge(Instrument):
    """A dial indicator."""

    resolution_mm: Annotated[Fine, ask("Gauge: one division", "the smallest step that it shows")]
    range_mm: Annotated[Travel, ask("Gauge: range", "travel of its plunger")]
    revolution_mm: Annotated[
        Travel | None, ask("Gauge: one turn", "travel of one turn; 0 without a dial")
    ] = None
    repeatability_mm: Annotated[
        Fine, ask("Gauge: repeatability", "standard deviation of one reading")
    ]
    # Standard uncertainty of its place along the leg, and of its scale (1); None: not stated.
    placement_mm: Annotated[Number, Field(ge=0.0, le=1e3)] | None = None
    scale_u: Annotated[Number, Field(ge=0.0, le=1.0)] | None = None

    @property
    def most_mm(self) -> float:
        return self.range_mm

    @property
    def turn_mm(self) -> float:
        return self.revolution_mm or 0.0

    def doubts(self, measured: Measured) -> tuple[Reason, ...]:
        """Doubts about differences: neither readings nor means of them have such decimals."""
        if isinstance(measured, Readings):
            return tuple(_doubt_readings(measured, self))
        value, step = measured.value, self.resolution_mm
        written = max(len(f"{v:.9f}".rstrip("0").partition(".")[2]) for v in value.tolist())
        means = (np.rint(value * count / step) * step / count for count in _MEANS_OF)
        near = any(np.all(np.abs(value - m) <= 0.5 * 10.0**-written + 1e-9) for m in means)
        return () if near else (Reason.of("fine_differences", step_mm=step),)

    def implausible(self) -> dict[str, Reason]:
        step, travel = self.resolution_mm, self.range_mm
        wrong = {
            "repeatability_mm": self.repeatability_mm > _MOST_DIVISIONS * step,
            "resolution_mm": step > _COARSEST_MM,
            "range_mm": not _FEWEST_DIVISIONS * step <= travel <= _LONGEST_MM,
            "revolution_mm": self.turn_mm > travel,
        }
        values = self.model_dump()
        return {name: Reason.of(f"gauge_{name}", **values) for name in wrong if wrong[name]}

    def mistaken_unit(self, measured: Measured) -> float | None:
        """Unit as of any instrument; differences do not show it."""
        if not isinstance(measured, Readings) or _ordinary(measured, 1.0, self):
            return None
        for unit in UNITS:
            between = off_scale(measured.value * unit, self.resolution_mm)
            # The divisions of an inch gauge are not those of the machine file.
            on_scale = unit == MM_PER_INCH or not np.any(between)
            if on_scale and _ordinary(measured, unit, self):
                return unit
        return None


def _doubt_readings(readings: Readings, gauge: Gauge) -> Iterator[Reason]:
    """Repeats that differ too little, decimals that it does not show, travel that it has not."""
    if unit := gauge.mistaken_unit(readings):
        # Where another unit makes all of it ordinary, the rest need not be said.
        mistake, remedy = UNITS[unit]
        yield Reason.of("other_unit", mistake=mistake, remedy=remedy)
        return
    plan, value, step = readings.plan, readings.value, gauge.resolution_mm
    ordinary = _ordinary(readings, 1.0, gauge)
    steady = None if ordinary else too_steady(value, plan.shared, plan.cells, gauge)
    if steady is not None:
        setup, scatter = steady
        where = None if setup is None else plan.entry(int(np.argmax(plan.shared == setup)))
        sizes = {"scatter_mm": scatter, "repeatability_mm": gauge.repeatability_mm}
        yield Reason.of("steady" if scatter else "stuck", where=where, **sizes)
    between = np.flatnonzero(off_scale(value, step))
    # An inch gauge's divisions need not be those of the machine file.
    if off_scale(value[between], _INCH_STEP, _OFF_INCHES).any():
        line, first = int(readings.line[between[0]]), float(value[between[0]])
        counts = {"count": between.size, "readings": len(readings)}
        yield Reason.of("off_scale", **counts, step_mm=step, line=line, value_mm=first)
    for setup in () if ordinary else range(plan.setups):
        rows = np.flatnonzero(plan.shared == setup)
        span = float(np.ptp(value[rows]))
        if span > gauge.range_mm * (1.0 + 1e-9):
            far = int(rows[np.argmax(np.abs(value[rows] - np.median(value[rows])))])
            line, farthest = int(readings.line[far]), float(value[far])
            sizes = {"span_mm": span, "range_mm": gauge.range_mm, "value_mm": farthest}
            yield Reason.of("too_far_apart", where=plan.entry(far), line=line, **sizes)
            return


def too_steady(
    value: Floats, setup: Ints, cell: Ints, gauge: Instrument
) -> tuple[int | None, float] | None:
    """Readings whose repeats differ less than this gauge does; None if there are none.

    Of n values [mm] those of one set-up and cell repeat each other. Returns the set-up, None for
    all together, and the standard deviation of the repeats [mm], exactly 0 if they never differ.
    """
    (left, repeat), setups = _about_means(value, setup, cell), np.unique(setup)
    for chosen in (None, *setups.tolist()):
        mine = np.full(len(value), True) if chosen is None else setup == chosen
        size = np.bincount(repeat[mine])
        squares = np.asarray(np.bincount(repeat[mine], left[mine] ** 2), np.float64)
        chance = 2.0 * chance_of_less_scatter(squares, size, gauge)
        if chance * (1 if chosen is None else setups.size) * SESSIONS_A_QUESTION < 1.0:
            scatter = math.sqrt(squares.sum() / np.maximum(size - 1, 0).sum())
            return chosen, scatter if scatter > _EQUAL_MM else 0.0
    return None


def _about_means(value: Floats, setup: Ints, cell: Ints) -> tuple[Floats, Ints]:
    """Readings less the mean of their repeats [mm], and the number of these; shape (n,)."""
    both = setup * (cell.max(initial=0) + 1) + cell
    _, repeat, count = np.unique(both, return_inverse=True, return_counts=True)
    return value - (np.bincount(repeat, weights=value) / count)[repeat], repeat


def chance_of_less_scatter(squares: Floats, size: Ints, gauge: Instrument) -> float:
    """Upper bound of the chance that repeats of a gauge twice as good as stated differ no more.

    n readings of noise σ, rounded to q, are equal if one division holds all. Only then is S < q²/2,
    the sum of squares about their mean. Rounding changes √S by at most √n·q/2, and S/σ² before it
    is χ² of ν degrees of freedom, where P(χ² ≤ a ν) ≤ (a e¹⁻ᵃ)^(ν/2). It is twice the smaller.

    Args:
        squares: S of each cell, shape (c,) [mm²].
        size: number of readings in each, (c,).
    """
    squares, size = squares[size > 1], size[size > 1]
    if not size.size:
        return 1.0
    noise, step, dof = gauge.repeatability_mm / _RESERVE, gauge.resolution_mm, (size - 1).sum()
    most = math.sqrt(squares.sum()) + 0.5 * step * math.sqrt(size.sum())
    ratio = min((most / noise) ** 2 / dof, 1.0)
    less = 0.5 * dof * (math.log(ratio) + 1.0 - ratio)
    # Rounding far below the noise counts as a quarter of it: repeats are equal more often.
    costs = np.sort([_cost_of_equal(max(step / noise, 0.25), count) for count in size.tolist()])
    equal = np.count_nonzero(squares < 0.5 * step**2)
    some = math.log(math.comb(size.size, equal)) - costs[:equal].sum()
    return min(2.0 * math.exp(min(less, some)), 1.0)


@lru_cache(maxsize=256)
def _cost_of_equal(width: float, count: int) -> float:
    """−ln of the chance that one division, so many σ wide, holds so many readings."""
    place, between = np.linspace(-6.0 - width / 2.0, 6.0 + width / 2.0, 500, retstep=True)
    held = ndtr(place + width / 2.0) - ndtr(place - width / 2.0)
    return -math.log(max(float((held**count).sum()) * between / width, 1e-300))


def off_scale(value: Floats, step: float, allowed: float = OFF_SCALE) -> np.ndarray:
    """Values [mm] that miss all divisions of `step` [mm] by more than this fraction of one."""
    return np.asarray(np.abs(value / step - np.rint(value / step)) > allowed)


@lru_cache(maxsize=8)
def _ordinary(readings: Readings, unit_mm: float, gauge: Gauge) -> bool:
    """True if readings in this unit [mm] repeat and range as of this gauge; not if none repeat."""
    value, plan = readings.value * unit_mm, readings.plan
    left, repeat = _about_means(value, plan.shared, plan.cells)
    again = np.bincount(repeat)[repeat] > 1
    if not again.any():
        return False
    # The median: one misread number does not hide the unit.
    scatter = float(np.median(np.abs(left[again]))) / _MEDIAN
    travel = max(np.ptp(value[plan.shared == k]) for k in range(plan.setups))
    return bool(
        scatter <= _TOO_MUCH * gauge.noise_mm
        and travel <= gauge.range_mm
        and too_steady(value, plan.shared, plan.cells, gauge) is None
    )
