"""What readings hold beside noise that nobody knows exactly, and hardly any reading shows.

Each influence is a set of unknowns of plausible size: what one standard deviation of each adds to
the readings. They are unknowns of every fit, as the gauges' zeros are, and sources of the
uncertainty budget.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model import (
    Contact,
    Floats,
    Model,
    Plan,
    carried_uncertainty,
    differentiate,
    freeze,
    simulate,
)


class Origin(StrEnum):
    """Sources that are no causes; those are named by their cause id."""

    NOISE = "noise"
    RESOLUTION = "resolution"
    GAUGE_SCALE = "gauge_scale"
    GAUGE_PLACEMENT = "gauge_placement"
    TEMPERATURE = "temperature"
    EXPLANATIONS = "explanations"  # that the data leave open


@dataclass(frozen=True, eq=False)
class Influence:
    """Unknowns of one source.

    Attributes:
        source: an `Origin` or a cause id.
        size: one standard deviation, in `unit`; None where the unknowns differ.
        unit: of the size; "" without one.
        assumed: True if nobody stated the size: a default.
        columns: what one standard deviation of each unknown adds to the data, shape (n, p) [mm].
    """

    source: str
    size: float | None
    unit: str
    assumed: bool
    columns: Floats

    def __post_init__(self) -> None:
        freeze(self, "columns")

    def reduced(self, matrix: Floats) -> Influence:
        """The same in data R·readings, R of shape (k, n)."""
        return replace(self, columns=matrix @ self.columns)


def influences(model: Model, offsets: Floats, plan: Plan) -> tuple[Influence, ...]:
    """All that act on these readings.

    Args:
        model: its machine and gauge give the sizes, its accepted causes their own uncertainty.
        offsets: Δρ, shape (3,) [mm].
        plan: n readings.
    """
    machine, gauge = model.machine, model.machine.gauge
    predicted = simulate(model, offsets, plan)
    found = [
        Influence(
            Origin.GAUGE_SCALE,
            gauge.scale_std,
            "",
            gauge.scale_u is None,
            gauge.scale_std * predicted[:, None],
        )
    ]
    if np.any(plan.contact == Contact.FIXED):
        # As far along the leg as the stand plausibly is from where it was meant to be.
        moved = replace(
            plan, gauge_at=plan.gauge_at + gauge.placement_std_mm / machine.leg_length_mm
        )
        shift = simulate(model, offsets, moved) - predicted
        found.append(
            Influence(
                Origin.GAUGE_PLACEMENT,
                gauge.placement_std_mm,
                "mm",
                gauge.placement_mm is None,
                shift[:, None] * plan.zeros,
            )
        )
    known = {effect.cause.id for effect in model.accepted}
    for id in (id for id in model.kind.unseen if id not in known):
        cause = CAUSES[id]
        size = cause.size(machine)
        if size > 0.0:
            _, slopes = differentiate(model, offsets, plan, [cause.at(np.zeros(cause.unknowns))])
            columns = slopes[:, offsets.size :] * cause.prior_std(machine)
            found.append(Influence(id, size, cause.unit, cause.assumed(machine), columns))
    carried = carried_uncertainty(model, offsets, plan)
    found += [
        Influence(effect.cause.id, None, "", False, columns)
        for effect, columns in zip(model.accepted, carried, strict=True)
    ]
    return tuple(found)
