"""Effects beyond the list by one grammar: how they act, and where; and how far apart these are.

An effect adds columns times sizes to the readings. A gauge has sizes of its own; moment, period and
time constant are common. The same columns, with a plausible size, are the rivals of an effect.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from .effects import CAUSES, write_down
from .forward import Disturbance, prior_sd, signals
from .machines import PLACEMENT, SCALE, Gauge, Machine
from .plan import AXIS_NAMES, CYCLE, SETUPS, Floats, Plan, frozen
from .separation import STANDS_OUT, Neighbourhood, undone
from .session import Session, make_session

SIZES = np.array([4.0, 12.0, 36.0])
"""Plausible sizes of a rival, in standard deviations of one reading."""
SHAPES = {"drifts": (2.0, 3.0, 4.5, 7.0, 11.0), "settles": (0.5, 1.0, 2.0, 4.0)}
"""Periods and time constants of the rivals, in addition to the true one [min]."""
RARE = 2.0 * np.log(100.0)
"""Twice the log odds against a listed cause: one session in a hundred has it."""
SAME = 0.1
"""Twice the log odds below which two claims are the same one on this plan."""


class Where(NamedTuple):
    """Readings of a leg, a direction, a gauge (both), or a posture; all if none is given."""

    leg: int | None = None
    direction: int | None = None
    posture: str | None = None

    def rows(self, plan: Plan) -> np.ndarray:
        """Mask of the readings concerned, shape (N,)."""
        columns = plan.leg, plan.direction, np.array(plan.posture)
        pairs = zip(columns, self, strict=True)
        asked = [values == wanted for values, wanted in pairs if wanted is not None]
        return np.logical_and.reduce(asked, axis=0) | np.zeros(plan.count, dtype=bool)

    @property
    def kind(self) -> str:
        """Key of `PLACES`."""
        given = [name for name, value in self._asdict().items() if value is not None]
        return {0: "everything", 2: "gauge"}.get(len(given)) or given[0]

    @property
    def names(self) -> dict[str, str]:
        """As the answer has it; empty for everything."""
        given = ((name, value) for name, value in self._asdict().items() if value is not None)
        return {name: value if name == "posture" else AXIS_NAMES[value] for name, value in given}


PLACES = {
    "everything": (Where(),),
    "leg": tuple(Where(leg=axis) for axis in range(3)),
    "direction": tuple(Where(direction=axis) for axis in range(3)),
    "gauge": tuple(Where(*pair) for pair in SETUPS),
    "posture": tuple(Where(posture=name) for name in CYCLE),
}
OF_GAUGES = ("everything", "leg", "direction", "gauge")
# One stand at a time is in use: a step of everything is one of a leg, and of a gauge it is listed.
KINDS = {
    "repeats": tuple(PLACES), "drifts": OF_GAUGES, "settles": OF_GAUGES, "steps": ("leg",),
    "scatters": tuple(PLACES), "hysteresis": OF_GAUGES, "temperature": OF_GAUGES,
}  # fmt: skip
"""The kinds of place at which each effect makes sense."""
HOWS = tuple(KINDS)


class Seen(NamedTuple):
    """The readings of a session that effects may depend on."""

    plan: Plan
    moved: Floats
    """Each plunger's last movement, 0 before its first, shape (N,), [mm]."""
    warm: Floats  # what the thermometer shows, shape (N,), [deg C]


def movements(plan: Plan, surface: Floats) -> Floats:
    """The last movement of each reading's plunger, 0 before its first, shape (N,), [mm]."""
    moved = np.zeros(plan.count)
    for zero in np.unique(plan.zero):
        rows = np.flatnonzero(plan.zero == zero)
        moved[rows[1:]] = np.diff(surface[rows])
    return moved


def columns(how: str, where: Where, seen: Seen, shape: float = 0.0) -> Floats:
    """What an effect of size one adds to the readings, one column per size, shape (N, k).

    Args:
        shape: period of a drift, time constant of settling, or moment of a step [min].
    """
    plan = seen.plan
    since, turn = plan.minutes - plan.minutes[plan.stand], 2.0 * np.pi * plan.minutes / (shape or 1)
    if how == "scatters":
        every = np.eye(plan.count)
    elif how == "repeats":
        cells = plan.setup * len(CYCLE) + np.array([CYCLE.index(name) for name in plan.posture])
        every = np.eye(len(CYCLE) * len(SETUPS))[cells]
    else:
        courses = {
            "drifts": (np.sin(turn), np.cos(turn)),
            "settles": (np.exp(-since / (shape or 1)),),
            "steps": (plan.minutes >= shape,),
            "hysteresis": (-0.5 * np.sign(seen.moved),),
            "temperature": (seen.warm - seen.warm[0],),
        }[how]
        gauges = np.eye(len(SETUPS))[plan.setup]
        every = np.hstack([gauges * course[:, None] for course in courses])
    every = every * where.rows(plan)[:, None]
    return every[:, every.any(axis=0)]


@dataclass(frozen=True, eq=False)
class Beyond:
    """A session with an effect beyond the list.

    Attributes:
        session: the record, maybe with a listed cause, too.
        twin: the same without the effect.
        how: one of `HOWS`.
        where: the readings concerned.
        seen: what the effect depends on.
        shape: see `columns`.
    """

    session: Session
    twin: Session
    how: str
    where: Where
    seen: Seen
    shape: float


def thermometer(plan: Plan, rng: np.random.Generator) -> Floats:
    """A hall that warms up and swings irregularly, shape (N,), [deg C], to a tenth of a kelvin."""
    hall = 20.0 + rng.uniform(1.0, 3.0) * (1.0 - np.exp(-plan.minutes / rng.uniform(3.0, 10.0)))
    for _ in range(3):
        turn = 2.0 * np.pi * plan.minutes / rng.uniform(2.0, 8.0)
        hall += rng.uniform(0.3, 1.2) * np.sin(turn + rng.uniform(0.0, 2.0 * np.pi))
    return np.round(hall, 1)


def _sizes(how: str, count: int, rng: np.random.Generator) -> Floats:
    """Sizes of an effect's columns in standard deviations of one reading, shape (count,)."""
    if how == "scatters":
        return rng.uniform(3.0, 9.0) * rng.normal(size=count)
    if how == "repeats":
        return rng.uniform(5.0, 20.0) * rng.normal(size=count)
    sizes = rng.uniform(8.0, 40.0) * rng.uniform(0.5, 1.0, size=count)
    # A plunger lags, and never leads.
    return sizes if how == "hysteresis" else sizes * rng.choice([-1.0, 1.0], size=count)


def draw_beyond(
    seed: int, machine: Machine, gauge: Gauge, how: str, kind: str, beside: bool = False
) -> Beyond:
    """Draw a session with an effect at a place of this kind. The same arguments give the same.

    Args:
        how: one of `HOWS`.
        kind: one of `KINDS[how]`.
        beside: hide a listed cause, too.
    """
    rng = np.random.default_rng([seed, 6])
    hidden = (str(rng.choice(CAUSES)),) if beside else ()
    pace = float(rng.uniform(0.3, 0.9))
    twin = make_session(seed, machine, gauge, hidden, pace=pace)
    plan, where = twin.plan, PLACES[kind][rng.integers(len(PLACES[kind]))]
    recorded = how == "temperature" or rng.random() < 0.5
    warm = thermometer(plan, rng) if recorded else np.zeros(plan.count)
    seen = Seen(plan, movements(plan, twin.gauges_show(plan, rng)[0]), warm)
    later = where.rows(plan) & (plan.minutes > plan.minutes[plan.stand] + 2.0 * pace)
    # What one reading of each gauge knows is no step, but wrong readings.
    later &= plan.minutes <= np.sort(plan.minutes[where.rows(plan)])[-4]
    shape = {
        "drifts": pace * rng.uniform(6.0, 20.0), "settles": rng.uniform(0.5, 3.0),
        "steps": rng.choice(plan.minutes[later]),
    }.get(how, 0.0)  # fmt: skip
    pattern = columns(how, where, seen, shape)
    sizes = _sizes(how, pattern.shape[1], rng)
    if how == "temperature":
        sizes /= np.ptp(warm)
    if how == "hysteresis":
        # A plunger lags by less than it moves.
        moves = np.ma.masked_equal(np.abs(pattern * seen.moved[:, None]), 0.0).min(axis=0)
        sizes = np.minimum(sizes, 1.6 * moves.filled(0.0) / gauge.sigma)
    contact = frozen(gauge.sigma * pattern @ sizes)
    disturbed = replace(
        twin, outside=f"{how} {kind}", disturbance=Disturbance.of(plan, contact=contact),
        warm=frozen(warm) if recorded else None,
    )  # fmt: skip
    clean, shown = (
        write_down(plan, gauge, values, twin.effects) for values in disturbed.gauges_show(plan, rng)
    )
    session = replace(
        disturbed, clean=frozen(clean), readings=frozen(np.round(shown, gauge.decimals))
    )
    twin = replace(twin, warm=session.warm)
    return Beyond(session, twin, how, where, seen, float(shape))


class Gaussian:
    """Readings as normally distributed: noise, uncertain set-ups, and columns that may act.

    Everything is free of zeros and offsets and counted in standard deviations of one reading.

    Attributes:
        root: whitens what was multiplied by it, shape (N - 9, N).
    """

    def __init__(self, free: Floats, noise: Floats, added: Floats) -> None:
        """`noise` acts in any case, `added` by this claim; columns (N, k)."""
        self._given = free, noise, added
        rest = np.linalg.qr(free, mode="complete")[0][:, free.shape[1] :].T
        true, more = (rest @ values @ values.T @ rest.T for values in (noise, added))
        true += np.eye(len(rest))
        lower = np.linalg.cholesky(true + more)
        self.root = np.linalg.solve(lower, rest)
        self._true = np.linalg.solve(lower, np.linalg.solve(lower, true).T)
        self._volume = 2.0 * float(np.log(np.diag(lower)).sum())

    def costs(self, record: Floats, added: Floats) -> Floats:
        """-2 ln density of a record without noise, expected over its noise, shape (B,).

        Args:
            record: shape (N,).
            added: columns that act in each of B further claims, shape (B, N, k).
        """
        white, more = self.root @ record, self.root @ added
        turned = np.swapaxes(more, -1, -2)
        inner = np.eye(more.shape[-1]) + turned @ more
        match = turned @ white
        spread = np.linalg.solve(inner, turned @ self._true @ more)
        taken = (match * np.linalg.solve(inner, match[..., None])[..., 0]).sum(axis=-1)
        missed = np.trace(self._true) - np.trace(spread, axis1=-2, axis2=-1)
        out: Floats = white @ white - taken + missed + np.linalg.slogdet(inner)[1] + self._volume
        return out

    def with_columns(self, added: Floats) -> "Gaussian":
        """The claim that these act, too."""
        free, noise, before = self._given
        return Gaussian(free, noise, np.hstack((before, added)))


Claim = tuple[str, Any]
"""How an effect acts, and where; of listed causes the first is empty."""


class Rival(NamedTuple):
    """The best other claim: an effect elsewhere or of another kind, or listed causes (no `how`)."""

    how: str
    where: Where
    sigma: float
    """Root of twice the log odds against it; doubled where its place holds the true one."""


@dataclass(frozen=True)
class Distinction:
    """How far a hidden effect stands from everything else that could be claimed.

    Attributes:
        same: (how, where) that are the hidden effect on this plan, itself included.
        nearest: the best other claim.
    """

    same: frozenset[tuple[str, Where]]
    nearest: Rival

    @staticmethod
    def among(
        costs: Mapping[Claim, float], key: Claim, doubled: Collection[Claim] = ()
    ) -> "Distinction":
        """Of what each claim costs; rivals that hold the true place stand twice as far."""
        own = costs[key]
        same = {claim for claim, cost in costs.items() if claim[0] and abs(cost - own) < SAME}
        same.add(key)
        rivals = [
            Rival(*claim, float(np.sqrt(max(cost - own, 0.0))) * (1 + (claim in doubled)))
            for claim, cost in costs.items()
            if claim not in same
        ]
        return Distinction(frozenset(same), min(rivals, key=lambda rival: rival.sigma))

    @property
    def clear(self) -> bool:
        """Whether the answer must describe the effect."""
        return self.nearest.sigma >= STANDS_OUT


def _shapes(how: str, where: Where, hidden: Beyond) -> tuple[float, ...]:
    """Shapes of a rival: those of a step are the moments before each reading that it may move."""
    if how == "steps":
        return tuple(hidden.seen.plan.minutes[where.rows(hidden.seen.plan)].tolist())
    return *SHAPES.get(how, ()), hidden.shape


def _effects(
    at: Gaussian, record: Floats, hidden: Beyond
) -> Iterator[tuple[str, Where, float, Floats]]:
    """Each (how, where) at its best size and shape: its cost and its columns."""
    for how, kinds in KINDS.items():
        tried = dict.fromkeys((*OF_GAUGES, *kinds))
        for where in chain.from_iterable(PLACES[kind] for kind in tried):
            best, added = np.inf, np.zeros((len(record), 0))
            for shape in _shapes(how, where, hidden):
                pattern = columns(how, where, hidden.seen, shape)
                costs = at.costs(record, SIZES[:, None, None] * pattern)
                if pattern.size and costs.min() < best:
                    best, added = float(costs.min()), SIZES[costs.argmin()] * pattern
            if best < np.inf:  # else nothing was recorded that it could follow
                yield how, where, best, added


def _listed(at: Gaussian, record: Floats, near: Neighbourhood) -> float:
    """Least cost of nothing or one listed cause in addition; of its places each is as likely.

    All of its parameters act, or, of bars, any one.
    """
    nothing = float(at.costs(record, np.zeros((1, len(record), 0)))[0])
    costs = [at.costs(record, family[None])[0] for family in near.families.values()]
    for places in (*near.places.values(), near.families["bar_skew"]):
        moved = at.costs(record, places.T[:, :, None])
        costs.append(moved.min() + 2.0 * np.log(moved.size))
    return min(nothing, float(min(costs)) + RARE)


def distinguish(hidden: Beyond) -> Distinction:
    """Compare a hidden effect with all others, alone and beside a cause, and with listed causes."""
    session, plan = hidden.session, hidden.session.plan
    near, sigma = Neighbourhood(session), session.gauge.sigma
    moves = PLACEMENT * np.eye(len(SETUPS))
    placed = [signals(plan, session.machine, near.state[None], None, move)[0] for move in moves]
    setup = (np.array(placed).T - near.centre[:, None]) / sigma
    noise = np.column_stack((near.families["leg_length"], setup, SCALE * near.centre / sigma))
    alone = Gaussian(near.free, noise, np.zeros((plan.count, 0)))
    record = (session.clean - near.centre) / sigma
    inverted = undone(plan, session.clean)
    others = [(values - near.centre) / sigma for records in inverted.values() for values in records]

    true, truly = alone, session.disturbance.contact / sigma
    for effect in session.effects:
        if effect.id in near.families:
            true = true.with_columns(near.families[effect.id])
            truly = truly + near.families[effect.id] @ (effect.parameters / prior_sd(effect.id))
        elif effect.id not in inverted:
            own = (hidden.twin.clean - near.centre) / sigma
            true, truly = true.with_columns(own[:, None]), truly + own

    pairs = [alone.with_columns(family) for family in near.families.values()]
    listed = [_listed(alone, values, near) for values in (record, *others)]
    listed += [RARE + _listed(at, values, near) for at in pairs for values in (record, *others)]
    if session.effects:
        listed.append(RARE + _listed(true, truly, near))
    costs = {("", Where()): min(listed)}
    for how, where, _, added in _effects(alone, record, hidden):
        costs[how, where] = _listed(alone.with_columns(added), record, near)
    if session.effects:
        for how, where, cost, _ in _effects(true, truly, hidden):
            costs[how, where] = min(cost + RARE, costs[how, where])
    mine = hidden.where.rows(plan)
    holding = {
        (hidden.how, where)
        for how, where in costs
        if how == hidden.how and not np.any(mine & ~where.rows(plan))
    }
    return Distinction.among(costs, (hidden.how, hidden.where), holding)
