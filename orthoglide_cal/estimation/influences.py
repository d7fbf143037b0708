"""What readings hold beside noise that nobody knows exactly, and hardly any reading shows.

Each influence is a set of unknowns of plausible size: what one standard deviation of each adds to
the readings. They are unknowns of every fit, as the gauges' zeros are, and sources of the
uncertainty budget.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model import (
    Floats,
    Model,
    Plan,
    carried_uncertainty,
    differentiate,
    simulate,
)
from orthoglide_cal.model.influence import Influence


def influences(model: Model, offsets: Floats, plan: Plan) -> tuple[Influence, ...]:
    """All that act on these readings.

    Args:
        model: its machine and gauge give the sizes, its accepted causes their own uncertainty.
        offsets: Δρ, shape (3,) [mm].
        plan: n readings.
    """
    found = list(model.machine.uncertain(plan, lambda other: simulate(model, offsets, other)))
    found += _of_causes(model.machine.unobservable, model, offsets, plan)
    if model.accepted:
        carried = carried_uncertainty(model, offsets, plan)
        found += [
            Influence(effect.cause.id, None, "", False, columns)
            for effect, columns in zip(model.accepted, carried, strict=True)
        ]
    return tuple(found)


def held(model: Model, offsets: Floats, plan: Plan) -> tuple[Influence, ...]:
    """What is taken as the controller has it, although nobody knows it exactly.

    A diagnosis asks whether the readings speak against it; what is found of the parameters is as
    unsure as it is, whatever they say. Arguments as of `influences`.
    """
    return tuple(_of_causes(model.machine.fixed_parameters, model, offsets, plan))


def _of_causes(
    ids: Iterable[str], model: Model, offsets: Floats, plan: Plan
) -> Iterator[Influence]:
    """Causes at their plausible size; not those that the model knows of."""
    machine, known = model.machine, {effect.cause.id for effect in model.accepted}
    for cause in (CAUSES[id] for id in ids if id not in known):
        size = cause.size(machine)
        if size > 0.0:
            _, slopes = differentiate(model, offsets, plan, [cause.at(np.zeros(cause.unknowns))])
            columns = slopes[:, offsets.size :] * cause.prior_std(machine)
            yield Influence(cause.id, size, cause.unit, cause.assumed(machine), columns)
