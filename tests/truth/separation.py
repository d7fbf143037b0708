"""How far a hidden truth stands from everything else that could be claimed, in sigma.

The distance to a rival is the square root of the least cost of the rival's fit to the truth's
record without noise: squared residuals over the gauge's variance plus squared parameters over
their tolerances, with zeros and offsets free. Places are found by linearisation; the best place
of each rival is then refined with the full forward model.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from .forward import MACHINE_CAUSES, PARTS
from .linear import Neighbourhood, backlash_cost, marginal, neighbourhood, place_costs, undone
from .machines import Gauge, Machine
from .plan import CYCLE, Floats
from .refine import Hypothesis, refined_costs
from .session import Session, make_session

HEALTHY = "healthy"
STANDS_OUT = 4.0
"""Sigma from which a truth counts as distinguished from a rival."""


@dataclass(frozen=True)
class Separation:
    """Distances of one session's truth from single hypotheses."""

    truth: tuple[str, ...]
    """Hidden cause ids."""
    distances: dict[str, float]
    """Sigma from the best fit of each cause id and of `healthy`; the truth's own id included."""
    rivals: tuple[str, ...]
    """Hypotheses other than a single truth, nearest first."""
    bound: float = STANDS_OUT
    """Sigma from which the truth counts as distinguished from another."""

    @property
    def nearest(self) -> str:
        """The nearest rival."""
        return self.rivals[0]

    @property
    def distance(self) -> float:
        """Sigma from the nearest rival."""
        return self.distances[self.nearest]

    @property
    def visible(self) -> float:
        """Sigma from the best healthy fit."""
        return self.distances[HEALTHY]

    @property
    def own(self) -> float:
        """Cost^(1/2) of a single truth's own best fit: how implausible its size is."""
        return self.distances[self.truth[0]] if len(self.truth) == 1 else 0.0


def _family_columns(near: Neighbourhood, cause: str, residual: Floats) -> tuple[int, ...]:
    """Numbers of the condition vector that a machine cause may change."""
    part = PARTS[cause]
    if cause != "backlash":
        return tuple(range(part.start, part.stop))
    chosen = backlash_cost(near.project(near.families[cause]), residual)[1]
    return tuple(part.start + column for column in chosen)


def _claims(near: Neighbourhood, record: Floats, machine_cause: str = "") -> list[Hypothesis]:
    """Each cause of the measurement at its best place by linearisation; or that and another one.

    Args:
        machine_cause: one of the machine that each is combined with.
    """
    residual, tail = near.residual(record), f"+{machine_cause}" if machine_cause else ""
    free = (
        near.project(near.families[machine_cause]) if machine_cause else np.zeros((len(record), 0))
    )
    columns = _family_columns(near, machine_cause, residual) if machine_cause else ()
    weight = marginal(free)
    found = []
    for cause, places in near.places.items():
        patterns = near.project(places)
        weighted = weight @ patterns
        costs, sizes = place_costs(
            cause,
            weighted.T @ residual,
            (patterns * weighted).sum(axis=0),
            float(residual @ weight @ residual),
        )
        best = int(np.argmin(costs))
        turns = float(sizes[best]) if cause == "gauge_slip" else None
        found.append(Hypothesis(cause + tail, record, columns, places[:, best], turns))
    for cause, records in undone(near.plan, record).items():
        misfits = near.project(((records - near.centre) / near.gauge.sigma).T)
        best = int(np.argmin((misfits * (weight @ misfits)).sum(axis=0)))
        found.append(Hypothesis(cause + tail, records[best], columns))
    return found


def _distances(near: Neighbourhood, claims: list[Hypothesis]) -> dict[str, float]:
    """Sigma of each claim's least cost, nearest first."""
    costs = np.sqrt(np.maximum(refined_costs(near, claims), 0.0))
    return {claims[k].cause: float(costs[k]) for k in np.argsort(costs, kind="stable")}


def _around(session: Session) -> Neighbourhood:
    return neighbourhood(session.machine, session.gauge, session.plan, session.offsets)


def separation(session: Session) -> Separation:
    """Distances of a session's truth from every single cause and from healthy."""
    near = _around(session)
    record, residual = session.clean, near.residual(session.clean)
    claims = [Hypothesis(HEALTHY, record)]
    claims += [Hypothesis(c, record, _family_columns(near, c, residual)) for c in MACHINE_CAUSES]
    distances = _distances(near, claims + _claims(near, record))
    own = session.causes if len(session.causes) == 1 else ()
    if not session.causes and session.outside is None:
        own = (HEALTHY,)
    return Separation(session.causes, distances, tuple(c for c in distances if c not in own))


def pair_distances(session: Session) -> dict[str, float]:
    """Sigma from the best fit of each pair `measurement+machine`, nearest first.

    Every cause of the machine and of the bars is combined with every cause of the measurement.
    """
    near = _around(session)
    return _distances(
        near, [each for cause in MACHINE_CAUSES for each in _claims(near, session.clean, cause)]
    )


def all_pairs() -> list[tuple[str, str]]:
    """The pairs a bench hides: one cause of the measurement, one of the machine."""
    measured = "misread", "gauge_slip", "stand_shift", "gauge_drift", "sign_flip", "swapped_gauges"
    return list(
        product(measured, (c for c in MACHINE_CAUSES if c not in ("leg_length", "bar_skew")))
    )


def clear_outside(
    seed: int,
    machine: Machine,
    gauge: Gauge,
    outside: str,
    single: float = 10.0,
    pair: float = 8.0,
    tries: int = 60,
) -> Session:
    """Redraw, each time 10 % larger, until the effect stands clear of everything listed.

    Args:
        single: least distance from every single cause and from healthy [sigma].
        pair: least distance from every pair of a measurement and a machine cause [sigma]. At 8
            the best pair leaves a chi-square 64 too large, over 6 standard deviations of it.
        tries: after so many the draw is given up.

    Raises:
        RuntimeError: the effect cannot be made clear.
    """
    for attempt in range(tries):
        scale = 1.1 ** min(attempt, 20)
        session = make_session(seed * tries + attempt, machine, gauge, outside=outside, scale=scale)
        if separation(session).distance < single:
            continue
        if next(iter(pair_distances(session).values())) >= pair:
            return session
    raise RuntimeError(f"{outside} does not stand out on {machine.name} with the {gauge.name}")


def expected_heldout(session: Session) -> float:
    """r.m.s. error expected when each cell is predicted from all the others [mm].

    A cell is all readings of one (leg, direction, posture). The model is the session's true one:
    zeros and offsets free, the hidden machine causes with their tolerances. Each held-out reading
    has the variance sigma^2 (1 + x C x') from noise and parameter uncertainty.
    """
    near = _around(session)
    hidden = [near.families[c] for c in session.causes if c in MACHINE_CAUSES]
    patterns = np.concatenate((near.free, *hidden), axis=1)
    penalty = np.diag([0.0] * near.free.shape[1] + [1.0] * (patterns.shape[1] - 9))
    postures = np.array([CYCLE.index(name) for name in session.plan.posture])
    cells = session.plan.setup * len(CYCLE) + postures
    variance = np.ones(session.plan.count)
    for cell in np.unique(cells):
        out = cells == cell
        kept = patterns[~out]
        spread = np.linalg.inv(kept.T @ kept + penalty)
        variance[out] += np.einsum("ni,ij,nj->n", patterns[out], spread, patterns[out])
    return float(session.gauge.sigma * np.sqrt(variance.mean()))
