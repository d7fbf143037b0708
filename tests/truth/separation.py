"""How far a hidden truth stands from everything else that could be claimed, in sigma.

The distance to a rival is the square root of the least cost of the rival's fit to the truth's
record without noise: squared residuals over the gauge's variance plus squared parameters over
their tolerances, with zeros and offsets free. Places are found by linearisation; the best place
of each rival is then refined with the full forward model.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import TypeVar

import numpy as np

from .effects import state_with, swapped_rows
from .forward import MACHINE_CAUSES, PARTS, jacobian, prior_sd, signals
from .machines import TOLERANCES, Gauge, Machine
from .plan import CYCLE, SETUPS, Floats, Plan
from .session import Session, make_session

Drawn = TypeVar("Drawn")
HEALTHY = "healthy"
STANDS_OUT = 4.0
"""Sigma from which a truth counts as distinguished from a rival."""
CLEAR_OF_ONE, CLEAR_OF_TWO = 10.0, 8.0
"""Least sigma of an effect outside the list from each cause and the healthy machine, and from each
pair. At 8 the best pair leaves a chi-square 64 too large, over 6 standard deviations of it."""
TRIES = 60
MAX_TURNS = 3
FREE = 9  # six zeros, then three offsets


@dataclass(frozen=True)
class Separation:
    """Distances of one session's truth from single hypotheses.

    Attributes:
        truth: hidden cause ids.
        distances: sigma from the best fit of each cause id and of `healthy`, its own id included.
        rivals: hypotheses other than a single truth, nearest first.
        bound: sigma from which the truth counts as distinguished from another.
    """

    truth: tuple[str, ...]
    distances: dict[str, float]
    rivals: tuple[str, ...]
    bound: float = STANDS_OUT

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


class Neighbourhood:
    """Linear model around a session's machine without its causes; N readings.

    Patterns are in standard deviations of one reading. Zeros and offsets are free: their span is
    projected out. The other parameters are counted in tolerances, each with a unit penalty, so
    that a fit's cost is |residual|^2 + |parameters|^2.

    Attributes:
        session: whose plan, machine and gauge these are.
        state: healthy condition in the centre, shape (30,).
        centre: its signals, shape (N,), [mm].
        free: patterns of six zeros and three offsets, shape (N, 9).
        families: of each machine cause, one column per parameter, shape (N, k), not projected.
        places: of each cause with a place, one column per place, by one tolerance or turn.
    """

    def __init__(self, session: Session) -> None:
        plan, machine, sigma = session.plan, session.machine, session.gauge.sigma
        self.session = session
        self.state = state_with(session.offsets, ())
        self.centre = signals(plan, machine, self.state[None])[0]
        slopes = jacobian(plan, machine, self.state) / sigma
        zeros = np.eye(len(SETUPS))[plan.setup] / sigma
        self.free = np.concatenate((zeros, slopes[:, PARTS["offsets"]]), axis=1)
        self._basis = np.linalg.qr(self.free)[0]
        self.families = {part: slopes[:, PARTS[part]] * prior_sd(part) for part in MACHINE_CAUSES}
        every, setups = np.arange(plan.count), np.arange(len(SETUPS))
        mine = plan.setup[:, None] == setups
        later = np.setdiff1d(every, [np.flatnonzero(plan.setup == s)[0] for s in setups])
        shift = (plan.setup[:, None] == plan.setup[later]) & (every[:, None] >= later)
        self.places = {
            "gauge_drift": mine * plan.hours[:, None] * TOLERANCES["gauge_drift"] / sigma,
            "stand_shift": shift * TOLERANCES["stand_shift"] / sigma,
            "misread": np.eye(plan.count) * TOLERANCES["misread"] / sigma,
            "gauge_slip": np.eye(plan.count) * session.gauge.revolution / sigma,
        }

    def project(self, patterns: Floats) -> Floats:
        """Take out what zeros and offsets can imitate; shape (N, ...) in and out."""
        out: Floats = patterns - self._basis @ (self._basis.T @ patterns)
        return out

    def residual(self, record: Floats) -> Floats:
        """A noise-free record [mm] as its projected distance from the centre, shape (N,)."""
        return self.project((record - self.centre) / self.session.gauge.sigma)


def undone(plan: Plan, record: Floats) -> dict[str, Floats]:
    """The record as it would be without a flip or swap that a rival claims.

    Returns:
        `sign_flip`: shape (6, N), one per set-up; `swapped_gauges`: shape (3, N), one per leg.
    """
    flips = np.where(plan.setup == np.arange(len(SETUPS))[:, None], -record, record)
    swaps = np.stack([record[swapped_rows(plan, leg)] for leg in range(3)])
    return {"sign_flip": flips, "swapped_gauges": swaps}


def marginal(patterns: Floats) -> Floats:
    """Weight matrix W, shape (N, N), with r W r = min over t of |r - patterns t|^2 + |t|^2."""
    inner = np.eye(patterns.shape[1]) + patterns.T @ patterns
    weight: Floats = np.eye(patterns.shape[0]) - patterns @ np.linalg.solve(inner, patterns.T)
    return weight


def backlash_cost(patterns: Floats, residual: Floats) -> tuple[float, tuple[int, ...]]:
    """The same for backlash, whose three widths must not be negative.

    The best of the eight choices of carriages with lost motion that gives no negative width.

    Returns:
        The cost and the columns in use.
    """
    best = float(residual @ residual)
    chosen: tuple[int, ...] = ()
    gram, overlap = patterns.T @ patterns, patterns.T @ residual
    for subset in range(1, 8):
        carriages = [c for c in range(3) if subset >> c & 1]
        columns = (*carriages, *(c + 3 for c in carriages))
        inner = gram[np.ix_(columns, columns)] + np.eye(len(columns))
        sizes = np.linalg.solve(inner, overlap[list(columns)])
        cost = float(residual @ residual - overlap[list(columns)] @ sizes)
        if cost < best and np.all(sizes[: len(carriages)] >= 0.0):
            best, chosen = cost, columns
    return best, chosen


def place_costs(
    cause: str, overlap: Floats, square: Floats, total: Floats | float
) -> tuple[Floats, Floats]:
    """Cost of the best size at each place, by the rank-one formula.

    Args:
        cause: slips come in whole turns, everything else in any size.
        overlap: c . r per place, shape (..., M).
        square: c . c per place, shape (..., M).
        total: r . r, broadcastable.

    Returns:
        Costs and sizes (tolerances or turns), each shape (..., M).
    """
    if cause != "gauge_slip":
        sizes = overlap / (1.0 + square)
        return total - overlap * sizes, sizes
    turns = np.clip(np.round(overlap / (1.0 + square)), -MAX_TURNS, MAX_TURNS)
    # No turn at all is not a slip: the nearest whole turn is then one.
    turns = np.where(turns == 0.0, np.where(overlap < 0.0, -1.0, 1.0), turns)
    return total - 2.0 * turns * overlap + turns**2 * (1.0 + square), turns


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One claim at its best place, ready to be refined.

    Attributes:
        record: what is to be explained, with a claimed flip or swap undone, shape (N,), [mm].
        columns: numbers of the condition vector that may differ from healthy.
        pattern: in the record, shape (N,), in sigma.
        turns: fixed size of the pattern, for slips.
    """

    cause: str
    record: Floats
    columns: tuple[int, ...] = ()
    pattern: Floats | None = None
    turns: float | None = None

    def penalised(self, near: Neighbourhood) -> Floats:
        """Patterns of the parameters with a penalty, (N, k): condition numbers, then pattern."""
        everything = np.concatenate([near.families[part] for part in MACHINE_CAUSES], axis=1)
        chosen = everything[:, [c - PARTS["offsets"].stop for c in self.columns]]
        if self.pattern is None or self.turns is not None:
            return chosen
        return np.concatenate((chosen, self.pattern[:, None]), axis=1)


def refined_costs(near: Neighbourhood, claims: list[Hypothesis], rounds: int = 4) -> Floats:
    """Least costs of the claims with the full forward model, shape (len(claims),).

    Gauss-Newton with the centre's derivatives: over the way they change by about way/300 mm, so
    each round leaves a few per cent of the error at most. The least cost seen is returned.
    """
    sigma = near.session.gauge.sigma
    # One tolerance of each number of the condition vector, behind the three offsets.
    unit = np.concatenate((np.ones(3), *(prior_sd(part) for part in MACHINE_CAUSES)))
    zeros = near.free[:, :6]
    solvers, sizes = [], []
    for claim in claims:
        penalised = claim.penalised(near)
        count = penalised.shape[1]
        whole = np.block([[near.free, penalised], [np.zeros((count, FREE)), np.eye(count)]])
        # From (misfit, -sizes) to a step of all parameters.
        solvers.append(np.linalg.solve(whole.T @ whole, whole.T))
        sizes.append(np.zeros(count))
    states = np.tile(near.state, (len(claims), 1))
    costs = np.full(len(claims), np.inf)
    for _ in range(rounds):
        modelled = signals(near.session.plan, near.session.machine, states)
        for k, claim in enumerate(claims):
            misfit = (claim.record - modelled[k]) / sigma
            turns = claim.turns or 0.0
            if claim.pattern is not None:
                misfit = misfit - claim.pattern * (turns if claim.turns else sizes[k][-1])
            level = misfit - zeros @ ((zeros.T @ misfit) / (zeros * zeros).sum(axis=0))
            cost = float(level @ level + sizes[k] @ sizes[k]) + turns**2
            costs[k] = min(costs[k], cost)
            step = solvers[k] @ np.concatenate((misfit, -sizes[k]))
            states[k, PARTS["offsets"]] += step[6:FREE]
            sizes[k] = sizes[k] + step[FREE:]
            columns = list(claim.columns)
            states[k, columns] = sizes[k][: len(columns)] * unit[columns]
    return costs


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
    residual, tail, columns = near.residual(record), "", ()
    free = np.zeros((len(record), 0))
    if machine_cause:
        free, tail = near.project(near.families[machine_cause]), f"+{machine_cause}"
        columns = _family_columns(near, machine_cause, residual)
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
    for cause, records in undone(near.session.plan, record).items():
        misfits = near.project(((records - near.centre) / near.session.gauge.sigma).T)
        best = int(np.argmin((misfits * (weight @ misfits)).sum(axis=0)))
        found.append(Hypothesis(cause + tail, records[best], columns))
    return found


def _distances(near: Neighbourhood, claims: list[Hypothesis]) -> dict[str, float]:
    """Sigma of each claim's least cost, nearest first."""
    costs = np.sqrt(np.maximum(refined_costs(near, claims), 0.0))
    return {claims[k].cause: float(costs[k]) for k in np.argsort(costs, kind="stable")}


def separation(session: Session) -> Separation:
    """Distances of a session's truth from every single cause and from healthy."""
    near = Neighbourhood(session)
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
    near = Neighbourhood(session)
    return _distances(
        near, [each for cause in MACHINE_CAUSES for each in _claims(near, session.clean, cause)]
    )


def all_pairs() -> list[tuple[str, str]]:
    """The pairs a bench hides: one cause of the measurement, one of the machine."""
    measured = "misread", "gauge_slip", "stand_shift", "gauge_drift", "sign_flip", "swapped_gauges"
    return list(
        product(measured, (c for c in MACHINE_CAUSES if c not in ("leg_length", "bar_skew")))
    )


def until_clear(
    seed: int, draw: Callable[[int, float], Drawn], clear: Callable[[Drawn], bool]
) -> Drawn:
    """Redraw with other seeds, each time 10 % larger, until an effect stands clear.

    Raises:
        RuntimeError: the effect cannot be made clear.
    """
    for attempt in range(TRIES):
        drawn = draw(seed * TRIES + attempt, 1.1 ** min(attempt, 20))
        if clear(drawn):
            return drawn
    raise RuntimeError(f"an effect does not stand out from the list, from seed {seed} on")


def clear_outside(seed: int, machine: Machine, gauge: Gauge, outside: str) -> Session:
    """A session with an effect outside the list that stands clear of everything listed."""

    def draw(seed: int, scale: float) -> Session:
        return make_session(seed, machine, gauge, outside=outside, scale=scale)

    def clear(session: Session) -> bool:
        if separation(session).distance < CLEAR_OF_ONE:
            return False
        return next(iter(pair_distances(session).values())) >= CLEAR_OF_TWO

    return until_clear(seed, draw, clear)


def expected_heldout(session: Session) -> float:
    """r.m.s. error expected when each cell is predicted from all the others [mm].

    A cell is all readings of one (leg, direction, posture). The model is the session's true one:
    zeros and offsets free, the hidden machine causes with their tolerances. Each held-out reading
    has the variance sigma^2 (1 + x C x') from noise and parameter uncertainty.
    """
    near = Neighbourhood(session)
    hidden = [near.families[c] for c in session.causes if c in MACHINE_CAUSES]
    patterns = np.concatenate((near.free, *hidden), axis=1)
    penalty = np.diag([0.0] * near.free.shape[1] + [1.0] * (patterns.shape[1] - FREE))
    postures = np.array([CYCLE.index(name) for name in session.plan.posture])
    cells = session.plan.setup * len(CYCLE) + postures
    variance = np.ones(session.plan.count)
    for cell in np.unique(cells):
        out = cells == cell
        kept = patterns[~out]
        spread = np.linalg.inv(kept.T @ kept + penalty)
        variance[out] += np.einsum("ni,ij,nj->n", patterns[out], spread, patterns[out])
    return float(session.gauge.sigma * np.sqrt(variance.mean()))
