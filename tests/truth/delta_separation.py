"""How far the hidden truth of a printer stands from everything else that could be claimed.

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

from .delta import TOLERANCES, Change, DeltaSession, Surface, Truth, changes, touches
from .plan import Floats, frozen
from .separation import HEALTHY, STANDS_OUT, Separation

GRAIN = 20.0
"""Over which the local shape of a bed is forgotten [mm]."""

DELTA_CAUSES = (*changes(1.0), "misread")
DELTA_PAIRS = tuple(product(DELTA_CAUSES[6:], DELTA_CAUSES[:6]))
"""What is measured wrong, and what is wrong in the machine."""


def _calibrated(truth: Truth, values: Floats) -> Truth:
    return replace(
        truth,
        endstops=frozen(truth.endstops + values[:3]),
        radius=truth.radius + values[3],
        angles=frozen(truth.angles + np.append(values[4:], 0.0)),
    )


def _columns(session: DeltaSession, at: Truth, count: int, change: Change, step: float) -> Floats:
    """Derivatives of the touches by some parameters, shape (N, count)."""

    def read(values: Floats) -> Floats:
        truth = change(at, values)
        return touches(
            session.machine, truth, session.x, session.y, session.block, session.minutes / 60.0
        )

    steps = step * np.eye(count)
    return np.stack([(read(one) - read(-one)) / (2.0 * step) for one in steps], axis=1)


def noise_root(session: DeltaSession) -> Floats:
    """Cholesky factor of the covariance of what is no error, shape (N, N)."""
    places = np.stack((session.x, session.y), axis=1)
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    machine = session.machine
    local = machine.texture**2 * np.exp(-apart / GRAIN)
    return np.linalg.cholesky(local + machine.noise**2 * np.eye(len(places)))


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
        root = noise_root(session)
        free, _ = np.linalg.qr(np.linalg.solve(root, _columns(session, bare, 6, _calibrated, 1e-3)))

        def seen(values: Floats) -> Floats:
            values = np.linalg.solve(root, values)
            return values - free @ (free.T @ values)

        self.residual = seen(record - sound + session.contact)
        self.own = {
            cause: seen(_columns(session, bare, count, change, 1e-2 * tolerance)) * tolerance
            for cause, (count, change) in changes(machine.bed).items()
            for tolerance in (TOLERANCES[cause],)
        }
        self.wrong = seen(np.eye(len(session.x)) * TOLERANCES["misread"])

    def distance(self, *causes: str) -> float:
        """Root of the least cost of a fit by some causes together [sigma]."""
        own = np.hstack(
            [self.wrong[:, :0], *(self.own[cause] for cause in causes if cause != "misread")]
        )
        inner = np.eye(own.shape[1]) + own.T @ own
        left = self.residual - own @ np.linalg.solve(inner, own.T @ self.residual)
        cost = float(left @ self.residual)
        if "misread" in causes:
            wrong = self.wrong - own @ np.linalg.solve(inner, own.T @ self.wrong)
            gain = (wrong.T @ self.residual) ** 2 / (1.0 + (wrong * self.wrong).sum(axis=0))
            cost -= float(gain.max())
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


def delta_clear(session: DeltaSession, single: float = 10.0, pair: float = 8.0) -> bool:
    """Whether an effect outside the list is that far from each cause and each pair [sigma]."""
    rivals = _Rivals(session)
    return all(rivals.distance(cause) >= single for cause in DELTA_CAUSES) and all(
        rivals.distance(*causes) >= pair for causes in DELTA_PAIRS
    )
