"""Baselines of an extension of a printer: a carried quartic surface, the earlier map.

Both need no cause: the surface is fitted together with the calibrated parameters, the map is what
these leave. An extension that predicts other readings no better has shown nothing.
"""

import math
from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import Field, computed_field

from orthoglide_cal.estimation import fit_offsets
from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.estimation.gaussian import unexplained
from orthoglide_cal.inference.data import Whitened
from orthoglide_cal.inference.fit import ENOUGH, left_out
from orthoglide_cal.model.model import differentiate
from orthoglide_cal.model.plan import Floats, Ints
from orthoglide_cal.schema import Schema

# Powers of x and y, in addition to what the calibrated parameters do.
QUARTIC = tuple((i, k - i) for k in (2, 3, 4) for i in range(k + 1))
TINY = 1e-30  # mm²
# Correlation from which maps of two dates are no noise; a definition: what repeats then has four
# times the variance, twice the size, of what does not.
REPEATS = 0.8


class Baselines(Schema):
    """Held-out errors of a printer: of its extension, and of what needs no cause."""

    parameters_mm: float = Field(description="of the calibrated parameters alone")
    extension_mm: float = Field(description="with the carried shape, or causes, and motions")
    quartic_mm: float | None = Field(None, description="with a carried quartic surface")
    earlier_map_mm: float | None = Field(None, description="with the map of the first date")
    repeats: float | None = Field(None, description="correlation of the maps of several dates")

    @computed_field(description="what predicts better than extension and parameters, if anything")
    @property
    def better(self) -> Literal["quartic", "earlier_map"] | None:
        best: Literal["quartic", "earlier_map"] | None = None
        least = min(self.parameters_mm, self.extension_mm)
        if self.quartic_mm is not None and self.quartic_mm < least:
            best, least = "quartic", self.quartic_mm
        return "earlier_map" if (self.earlier_map_mm or math.inf) < least else best


def baselines(
    white: Whitened, later: Whitened | None, entered: Floats, free: int
) -> dict[str, float]:
    """`quartic_mm` and `earlier_map_mm` of the touches of a printer, all alike, where known.

    Args:
        white: the data.
        later: other touches, to be predicted; None predicts each patch of the bed from the others.
        entered: taken off the parameters in between, shape (6,) [mm, deg].
        free: so many of the parameters, the first ones, are fitted to the later data.
    """
    offsets = fit_offsets(white.problem, white.data).offsets_mm
    place, left, jacobian, _ = _touches(white, offsets)
    touch = white.plan.touches
    columns = np.hstack((jacobian, white.plan.zeros[touch], _surface(white, place)))
    enough = len(left) > np.linalg.matrix_rank(columns) == columns.shape[1]
    if later is None:
        errors, number = [], np.cumsum(touch) - 1
        for patch in (patch for patches in left_out(white) for patch in patches):
            omitted = number[patch[touch[patch]]]
            rest = np.setdiff1d(np.arange(len(left)), omitted)
            if omitted.size and enough:
                terms = np.linalg.lstsq(columns[rest], left[rest])[0]
                errors.append(left[omitted] - columns[omitted] @ terms)
        return {"quartic_mm": rms(np.concatenate(errors))} if errors else {}
    anew = free == offsets.size
    there, error, then, _ = _touches(later, None if anew else offsets - entered)
    mapped = unexplained(then[:, :free], error - _interpolated(place, left, there))
    held = {"earlier_map_mm": rms(mapped)}
    if enough:
        terms = np.linalg.lstsq(columns, left)[0]
        fixed = terms[: jacobian.shape[1]] * (np.arange(jacobian.shape[1]) >= free)
        predicted = then @ fixed + _surface(white, there) @ terms[-len(QUARTIC) :]
        held["quartic_mm"] = rms(unexplained(then[:, :free], error - predicted))
    return held


def repeats(white: Whitened, later: Whitened | None = None) -> float | None:
    """Correlation of the residual maps of two dates, of more the smallest.

    What calibrated parameters leave of the touches of each date; None for few, or of one date.
    """
    maps = [
        (place[dated], left[dated], jacobian[dated])
        for white_data in (white, later)
        if white_data is not None and white_data.plan.touches.any()
        for place, left, jacobian, date in (_touches(white_data),)
        for day in np.unique(date)
        for dated in (date == day,)
    ]
    correlations = []
    for (place, left, _), (there, after, then) in pairwise(maps):
        if min(len(left), len(after)) < ENOUGH * then.shape[1]:
            return None
        both = unexplained(then, np.stack((_interpolated(place, left, there), after), axis=1))
        size = np.sqrt(np.prod((both**2).sum(axis=0)))
        correlations.append(float(np.prod(both, axis=1).sum() / max(size, TINY)))
    return min(correlations, default=None)


def _touches(white: Whitened, offsets: Floats | None = None) -> tuple[Floats, Floats, Floats, Ints]:
    """Places (n, 2), what parameters leave of the touches there (n,), derivatives (n, 6), dates.

    The parameters are those that fit best if None.
    """
    plan = white.plan
    if offsets is None:
        offsets = fit_offsets(white.problem, white.data).offsets_mm
    readings, jacobian = differentiate(white.problem.model, offsets, plan, ())
    left = white.plain(white.data) / plan.precision - readings
    touch = plan.touches
    return plan.spots[touch, :2], left[touch], jacobian[touch], plan.date[touch]


def _surface(white: Whitened, place: Floats) -> Floats:
    """Terms of a quartic surface at places (n, 2), shape (n, 12)."""
    x, y = (place / np.abs(white.plan.spots[:, :2]).max()).T
    return np.stack([x**across * y**along for across, along in QUARTIC], axis=1)


def _interpolated(place: Floats, value: Floats, there: Floats) -> Floats:
    """Values (n,) of places (n, 2), between them; outside that of the nearest, shape (m,)."""
    from scipy.interpolate import griddata

    nearest = griddata(place, value, there, "nearest")
    between = griddata(place, value, there, "linear") if len(place) > 3 else nearest
    return np.where(np.isnan(between), nearest, between)
