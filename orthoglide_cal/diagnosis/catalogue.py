"""Where on these data each cause may act, and what it would do there: made once, used by all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import Where
from orthoglide_cal.diagnosis.explanations import Menu
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.errors import NotConvergedError
from orthoglide_cal.estimation.problem import normal_step

# After a step this short the linear model is exact to less than a nanometre.
SHORT_STEP_MM = 1e-3
MAX_ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Catalogue:
    """Places of all extras on these data, made once.

    Attributes:
        places: cause id → its places.
        undone: id of a relabelling → those of its places where the data can undo it.
        columns: W·pattern of one unit at each place of each pattern cause, one after the other,
            shape (k, P) [mm per unit].
        own: cause id → its columns.
        offsets: fitted offsets with each relabelling undone, id → (undone, 3); "" → (3,).
        residuals: what is left then, id → (k, undone); "" → (k,).
        slope: derivative of the data by the offsets at the offsets-only fit, (k, 3).
        linear: broad cause id → derivative by its parameters there, where it is absent, (k, p).
        doubt: what one standard deviation of each accepted parameter adds, (k, p) [mm].
    """

    places: Mapping[str, tuple[Where, ...]]
    undone: Mapping[str, tuple[Where, ...]]
    columns: Floats
    own: Mapping[str, slice]
    offsets: Mapping[str, Floats]
    residuals: Mapping[str, Floats]
    slope: Floats
    linear: Mapping[str, Floats]
    doubt: Floats

    @classmethod
    def of(cls, frame: Frame, menu: Menu) -> Catalogue:
        """Enumerate the places and fit the offsets to each relabelled data set."""
        places = {
            c.id: c.places(frame.plan, frame.machine) for c in (*menu.patterns, *menu.relabels)
        }
        undone = {
            c.id: tuple(where for where in places[c.id] if c.reversible(frame.plan, where))
            for c in menu.relabels
        }
        patterns = [c.patterns(frame.plan, places[c.id]) for c in menu.patterns]
        ends = np.cumsum([0, *(pattern.shape[1] for pattern in patterns)])
        own = {c.id: slice(*pair) for c, pair in zip(menu.patterns, pairwise(ends), strict=True)}
        columns = frame.matrix @ np.hstack([np.zeros((len(frame.plan), 0)), *patterns])
        versions = [frame.data]
        for cause in menu.relabels:
            versions += [frame.relabelled(cause, where) for where in undone[cause.id]]
        fitted, left = _fit_all(frame, np.stack(versions))
        offsets: dict[str, Floats] = {"": fitted[0]}
        residuals: dict[str, Floats] = {"": left[0]}
        start = 1
        for cause in menu.relabels:
            stop = start + len(undone[cause.id])
            offsets[cause.id] = fitted[start:stop]
            residuals[cause.id] = left[start:stop].T
            start = stop
        absent = [(c, np.zeros(c.prior_std(frame.machine).size)) for c in menu.broad]
        _, slope, slopes = frame.linearised(offsets[""], absent)
        linear = {c.id: part for c, part in zip(menu.broad, slopes, strict=True)}
        doubt = frame.doubt(offsets[""])
        return cls(places, undone, columns, own, offsets, residuals, slope, linear, doubt)


def _fit_all(frame: Frame, versions: Floats) -> tuple[Floats, Floats]:
    """Offsets (v, 3) and residuals (v, k) of several versions of the data, by Gauss–Newton.

    Raises:
        NotConvergedError: the steps do not become short.
    """
    offsets = np.zeros((len(versions), 3))
    model, slope = frame.problem.at_zero
    for iteration in range(MAX_ITERATIONS):
        if iteration:
            model, slope = frame.problem.model_with_jacobian(offsets)
        step = normal_step(slope, versions - model)
        offsets = offsets + step
        if np.abs(step).max() < SHORT_STEP_MM:
            return offsets, versions - model - (slope @ step[..., None])[..., 0]
    raise NotConvergedError(
        "No offsets fit these data: the search does not settle.", "Run: orthocal validate"
    )
