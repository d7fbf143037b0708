"""How far the hidden truth of a printer stands from everything else that could be claimed.

And effects on its touches that stand in no list: the honest answer to them is `unexplained`.

As for the Orthoglide: the root of the least cost of a rival's fit to the record without noise, with
the calibrated parameters free and the rival's own at one tolerance each. What is noise here are the
touches' own scatter and the local shape of the bed, which neighbours share: exp(-d / GRAIN). All
is linear around the machine without its hidden cause; derivatives are differences of exact touches.

Four sigma of one parameter and of the seven of a bed are not equally rare: noise alone brings
seven that far twenty times a thousand. What stands out does so with the chance of four sigma.
"""

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.stats import chi2

from .delta import (
    TOLERANCES,
    Change,
    Delta,
    DeltaSession,
    Disturb,
    Layout,
    Surface,
    Truth,
    changes,
    make_delta_session,
    touches,
)
from .plan import Floats, frozen
from .separation import (
    CLEAR_OF_ONE,
    CLEAR_OF_TWO,
    HEALTHY,
    STANDS_OUT,
    Separation,
    marginal,
    place_costs,
    until_clear,
)

GRAIN = 20.0
"""Over which the local shape of a bed is forgotten [mm]."""

DELTA_CAUSES = (*changes(1.0), "misread")
DELTA_PAIRS = tuple(product(DELTA_CAUSES[6:], DELTA_CAUSES[:6]))
"""What is measured wrong, and what is wrong in the machine."""


def calibrated(truth: Truth, values: Floats) -> Truth:
    return replace(
        truth,
        endstops=frozen(truth.endstops + values[:3]),
        radius=truth.radius + values[3],
        angles=frozen(truth.angles + np.append(values[4:], 0.0)),
    )


def slopes(session: DeltaSession, at: Truth, count: int, change: Change, step: float) -> Floats:
    """Derivatives of the touches by some parameters, shape (N, count)."""

    def read(values: Floats) -> Floats:
        truth = change(at, values)
        return touches(
            session.machine, truth, session.x, session.y, session.block, session.minutes / 60.0
        )

    steps = step * np.eye(count)
    return np.stack([(read(one) - read(-one)) / (2.0 * step) for one in steps], axis=1)


def local_shape(session: DeltaSession) -> Floats:
    """Covariance of the bed's local shape under the touches, shape (N, N) [mm²]."""
    places = np.stack((session.x, session.y), axis=1)
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    return np.asarray(session.machine.texture**2 * np.exp(-apart / GRAIN))


def _stands_out(session: DeltaSession) -> float:
    """Sigma at which its hidden parameters are as unlikely to be noise as one at STANDS_OUT."""
    families, chance = changes(session.machine.bed), float(chi2.sf(STANDS_OUT**2, 1))
    count = sum(families[cause][0] if cause in families else 1 for cause in session.causes)
    places = len(session.x) if "misread" in session.causes else 1
    return float(np.sqrt(chi2.isf(chance / places, max(count, 1))))


class _Rivals:
    """What each cause, at one tolerance, could explain of a session's record without noise.

    Attributes:
        residual: of the best fit of the calibrated parameters, in sigma, shape (N,).
        own: cause -> its columns at one tolerance, shape (N, p), as far as these do not follow.
        wrong: one wrong touch each, shape (N, N).
    """

    def __init__(self, session: DeltaSession) -> None:
        hidden, machine = session.truth, session.machine
        bare = Truth(hidden.endstops, hidden.radius, hidden.angles)
        bed = Surface(machine.bed, hidden.bed.terms) if hidden.bed else None
        hours = session.minutes / 60.0
        record, sound = (
            touches(machine, truth, session.x, session.y, session.block, hours)
            for truth in (replace(hidden, bed=bed), bare)
        )
        noise = machine.noise**2 * np.eye(len(session.x))
        root = np.linalg.cholesky(local_shape(session) + noise)
        free, _ = np.linalg.qr(np.linalg.solve(root, slopes(session, bare, 6, calibrated, 1e-3)))

        def seen(values: Floats) -> Floats:
            values = np.linalg.solve(root, values)
            return values - free @ (free.T @ values)

        self.residual = seen(record - sound + session.contact)
        self.own = {
            cause: seen(slopes(session, bare, count, change, 1e-2 * tolerance)) * tolerance
            for cause, (count, change) in changes(machine.bed).items()
            for tolerance in (TOLERANCES[cause],)
        }
        self.wrong = seen(np.eye(len(session.x)) * TOLERANCES["misread"])

    def distance(self, *causes: str) -> float:
        """Root of the least cost of a fit by some causes together [sigma]."""
        own = np.hstack(
            [self.wrong[:, :0], *(self.own[cause] for cause in causes if cause != "misread")]
        )
        weight = marginal(own)
        cost = self.residual @ weight @ self.residual
        if "misread" in causes:
            weighted = weight @ self.wrong
            square = (weighted * self.wrong).sum(axis=0)
            cost = place_costs("misread", weighted.T @ self.residual, square, cost)[0].min()
        return float(np.sqrt(max(cost, 0.0)))


def delta_separation(session: DeltaSession) -> Separation:
    """Distances of a session's truth from every single cause and from a sound machine."""
    each = _Rivals(session)
    distances = {cause: each.distance(cause) for cause in DELTA_CAUSES}
    distances[HEALTHY] = each.distance()
    order = sorted(distances, key=lambda name: distances[name])
    hidden = session.causes or (HEALTHY,)
    single = hidden if len(hidden) == 1 else ()
    rivals = tuple(name for name in order if name not in single)
    return Separation(session.causes, distances, rivals, _stands_out(session))


def delta_clear(session: DeltaSession) -> bool:
    """Whether an effect outside the list stands clear of each cause and each pair."""
    rivals = _Rivals(session)
    return all(rivals.distance(cause) >= CLEAR_OF_ONE for cause in DELTA_CAUSES) and all(
        rivals.distance(*causes) >= CLEAR_OF_TWO for causes in DELTA_PAIRS
    )


Rng = np.random.Generator


def knocked_probe(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
    """The probe is knocked, and sits higher or lower from then on."""
    when = rng.uniform(0.2, 0.8) * minutes[-1]
    size = rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.15)
    return truth, size * (minutes > when)


def warm_start(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
    """A heater is switched on: the probe's height moves, and settles."""
    begin = rng.uniform(0.1, 0.6) * minutes[-1]
    settle = rng.uniform(0.05, 0.15) * minutes[-1]
    size = rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.15)
    return truth, size * (1.0 - np.exp(-np.maximum(minutes - begin, 0.0) / settle))


def room_breathing(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
    """A bed heater switches on and off: its plate rises and falls."""
    period = rng.uniform(0.2, 0.5) * minutes[-1]
    swing = np.sin(2.0 * np.pi * minutes / period + rng.uniform(0.0, 2.0 * np.pi))
    return truth, rng.uniform(0.02, 0.06) * swing


def scattered_misreads(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
    """Dirt under four to six touches."""
    wrong = np.zeros(len(minutes))
    rows = rng.choice(len(minutes), size=int(rng.integers(4, 7)), replace=False)
    wrong[rows] = rng.choice([-1.0, 1.0], size=len(rows)) * rng.uniform(0.1, 0.3, size=len(rows))
    return truth, wrong


def eccentric_pulley(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
    """A pulley runs out of true: its carriage follows a sine of its height.

    On one height that is the same as a wavy bed.
    """
    pulleys = np.zeros((3, 2))
    pulleys[rng.integers(3)] = rng.uniform(0.05, 0.15), rng.uniform(0.0, 2.0 * np.pi)
    return replace(truth, pulleys=frozen(pulleys)), np.zeros(len(minutes))


DELTA_OUTSIDE: dict[str, tuple[Disturb, int]] = {
    disturb.__name__: (disturb, 3 if disturb is eccentric_pulley else 1)
    for disturb in (knocked_probe, warm_start, room_breathing, scattered_misreads, eccentric_pulley)
}
"""Each with the number of heights at which it can be told from a bed."""


def clear_delta_outside(seed: int, machine: Delta, layout: Layout, outside: str) -> DeltaSession:
    """A session with an effect outside the list that stands clear of everything listed."""
    effect, bumps = DELTA_OUTSIDE[outside][0], (machine.texture, GRAIN)

    def draw(seed: int, scale: float) -> DeltaSession:
        def enlarged(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
            truth, contact = effect(truth, minutes, rng)
            return replace(truth, pulleys=frozen(truth.pulleys * [scale, 1.0])), scale * contact

        return make_delta_session(seed, machine, (), layout, bumps, (outside, enlarged))

    return until_clear(seed, draw, delta_clear)
