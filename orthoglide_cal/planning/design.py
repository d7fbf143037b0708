"""The best design: the fewest readings for an accuracy.

The offsets show in differences of readings that share a gauge zero. With w_d readings at posture d
of each gauge, the precision of the offsets is

    Σ_gauges Σ_d w_d (J_d − J̄)ᵀ (J_d − J̄) / σ²,   J̄ = Σ w_d J_d / Σ w_d

Searched are all whole numbers w_d up to a few readings per cycle, and the places of the gauges,
for the smallest product of the largest variance and the number of readings: so many readings a
wanted accuracy takes. Postures that displace other carriages, too, as far as the plunger follows
(5 mm), would save 3 to 5 % more: not worth a stand that has to be watched.
"""

import functools
from dataclasses import replace
from itertools import product

import numpy as np

from orthoglide_cal.errors import PostureError, UnusableResultError
from orthoglide_cal.model.machine import Machine, Suspicion
from orthoglide_cal.model.model import Model, simulate_with_jacobian
from orthoglide_cal.model.orthoglide import MARGIN, ROUNDING, visiting
from orthoglide_cal.model.plan import Floats, Ints, Plan

# Postures that are tried, as shares of the lower and of the upper joint limit.
SHARES = np.array([(0.0, 0.0), (0.0, 1.0), (0.0, 0.5), (0.5, 0.0), (1.0, 0.0)])
# A gauge is read at most so often in a cycle.
MOST_VISITS = 5
# Places along the leg that are tried, half-way first: a rule is enough to find a twentieth.
PLACES = sorted((k / 20 for k in range(21)), key=lambda place: abs(place - 0.5))
# Precision [1] of an offset that no reading sees.
NOTHING = 1e-12
# What it shows less well than the double-posture protocol: with two postures a track that is bent
# looks like one that leans.
GIVES_UP = (
    "rails that do not meet, axes out of square and a tilted bar look alike; a wrong scale, lost"
    " motion and a creeping stand show much less, a knocked stand a little less"
)


# A plan asks for it once for each number of cycles.
@functools.lru_cache(maxsize=8)
def design_of(machine: Machine) -> tuple[tuple[float, ...], float]:
    """The postures and the gauge place that reach any accuracy with the fewest readings.

    Displacements [mm] of one cycle in their order, and a place along the leg, as of `visiting`.

    Subject to: postures within the joint limits; each plunger on the bar at all of them,
    `MARGIN` from both joints; one place of the stand per leg and direction.

    Raises:
        UnusableResultError: no such postures determine the offsets.
    """
    postures = SHARES @ np.array(machine.limits_mm)
    every = np.array(list(product(range(MOST_VISITS + 1), repeat=len(postures))), dtype=np.intp)
    every = every[np.isin(every.sum(axis=1), range(2, MOST_VISITS + 1))]
    # Of designs that are equally good the shortest comes first.
    every = every[np.argsort(every.sum(axis=1), kind="stable")]
    # All readings with the gauges at each of the places; ∂readings/∂Δρ, (places, 6, postures, 3).
    plan = visiting(tuple(postures.tolist()))
    everywhere = replace(
        plan.subset(np.tile(np.argsort(plan.setup, kind="stable"), len(PLACES))),
        gauge_at=np.repeat(PLACES, len(plan)),
    )
    slopes = simulate_with_jacobian(Model(machine), np.zeros(3), everywhere)[1]
    jacobians = slopes.reshape(len(PLACES), plan.setups, len(postures), 3)
    least, best = 1.0 / NOTHING**0.5, None
    for place, jacobian in zip(PLACES, jacobians, strict=True):
        near_joint = np.abs(place + postures / machine.leg_mm - 0.5) > 0.5 - MARGIN + ROUNDING
        count = every[~np.any(every[:, near_joint], axis=1)]
        needed = _cost(jacobian, count)
        if needed.min(initial=least) < least * (1.0 - ROUNDING):
            least = float(needed.min())
            chosen = count[int(np.argmax(needed <= least * (1.0 + ROUNDING)))]
            # In turn: what is alike stands apart in time.
            turns = np.concatenate([np.flatnonzero(chosen > turn) for turn in range(MOST_VISITS)])
            best = tuple(postures[turns].tolist()), place
    if best is None:
        raise UnusableResultError(
            "No postures within the joint limits let the gauges see the joint offsets.",
            "Check joint_limits_mm and leg_length_mm in the machine file.",
        )
    return best


def _cost(jacobian: Floats, count: Ints) -> Floats:
    """Readings for a variance of σ² of c designs that visit postures (c, p), shape (c,)."""
    total = count.sum(axis=1)
    # Σ w J Jᵀ − (Σ w J)(Σ w J)ᵀ/Σ w, summed over the gauges.
    squares = np.tensordot(count, np.einsum("gpi,gpj->pij", jacobian, jacobian), axes=1)
    sums = np.tensordot(count, jacobian, axes=(1, 1))
    precision = squares - np.einsum("cgi,cgj->cij", sums, sums) / total[:, None, None]
    covariance = np.linalg.inv(precision + NOTHING * np.eye(3))
    largest = np.diagonal(covariance, axis1=1, axis2=2).max(axis=1)
    return np.asarray(largest * total * len(jacobian))


def require_on_bar(plan: Plan, machine: Machine) -> Suspicion | None:
    """The warning of a plan whose plungers stay on the bars, but barely; None without one.

    Raises:
        PostureError: a plunger leaves its bar.
    """
    warning = machine.bar_warning(plan)
    if warning is not None and warning.size > 0.0:
        raise PostureError(warning.what, warning.remedy)
    return warning
