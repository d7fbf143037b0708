"""How far the hidden truth of a printer stands from everything else that could be claimed.

As for the Orthoglide: the root of the least cost of a rival's fit to the record without noise, with
the calibrated parameters free and the rival's own at one tolerance each. What is noise here are the
touches' own scatter and the local shape of the bed, which neighbours share: exp(-d / GRAIN). All
is linear around the machine without its hidden cause; derivatives are differences of exact touches.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .delta import TOLERANCES, DeltaSession, Surface, Truth, touches
from .plan import Floats, frozen
from .separation import HEALTHY, Separation

GRAIN = 20.0
"""Over which the local shape of a bed is forgotten [mm]."""

Change = Callable[[Truth, Floats], Truth]

_BED = ((2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
_TILT = ((2, 0), (1, 1), (0, 2))


def _surface(radius: float, powers: tuple[tuple[int, int], ...], sizes: Floats) -> Surface:
    return Surface(radius, dict(zip(powers, sizes.tolist(), strict=True)))


def _families(radius: float) -> dict[str, tuple[int, Change]]:
    """Of each cause of the machine or the contact: number of parameters, and what they change."""
    return {
        "tower_lean": (6, lambda t, v: replace(t, leans=frozen(v.reshape(3, 2)))),
        "tower_radius": (3, lambda t, v: replace(t, radii=frozen(v))),
        "leg_length": (3, lambda t, v: replace(t, arms=frozen(v))),
        "encoder_scale": (3, lambda t, v: replace(t, scales=frozen(v))),
        "backlash": (3, lambda t, v: replace(t, lost=frozen(v))),
        "thermal_drift": (3, lambda t, v: replace(t, rates=frozen(v))),
        "bed_shape": (7, lambda t, v: replace(t, bed=_surface(radius, _BED, v))),
        "probe_tilt": (3, lambda t, v: replace(t, tilt=_surface(radius, _TILT, v))),
        "probe_drift": (1, lambda t, v: replace(t, drift=float(v[0]))),
    }


DELTA_CAUSES = (*_families(1.0), "misread")


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


def delta_separation(session: DeltaSession) -> Separation:
    """Distances of a session's truth from every single cause and from a sound machine."""
    hidden, machine = session.truth, session.machine
    bare = Truth(hidden.endstops, hidden.radius, hidden.angles)
    bed = Surface(machine.bed, hidden.bed.terms) if hidden.bed else None
    hours = session.minutes / 60.0
    record, sound = (
        touches(machine, truth, session.x, session.y, session.block, hours)
        for truth in (replace(hidden, bed=bed), bare)
    )
    left = record - sound
    if session.misread is not None:
        left[session.misread[0]] += session.misread[1]
    root = noise_root(session)

    def white(values: Floats) -> Floats:
        return np.linalg.solve(root, values)

    free, _ = np.linalg.qr(white(_columns(session, bare, 6, _calibrated, 1e-3)))

    def seen(values: Floats) -> Floats:
        values = white(values)
        return values - free @ (free.T @ values)

    residual = seen(left)
    costs = {HEALTHY: float(residual @ residual)}
    for cause, (count, change) in _families(machine.bed).items():
        tolerance = TOLERANCES[cause]
        own = seen(_columns(session, bare, count, change, 1e-2 * tolerance)) * tolerance
        match = own.T @ residual
        inner = np.eye(count) + own.T @ own
        costs[cause] = costs[HEALTHY] - float(match @ np.linalg.solve(inner, match))
    patterns = seen(np.eye(len(left)) * TOLERANCES["misread"])
    gain = (patterns.T @ residual) ** 2 / (1.0 + (patterns**2).sum(axis=0))
    costs["misread"] = costs[HEALTHY] - float(gain.max())
    distances = {name: float(np.sqrt(max(cost, 0.0))) for name, cost in costs.items()}
    own_name = session.hidden or (HEALTHY,)
    order = sorted(distances, key=lambda name: distances[name])
    single = own_name if len(own_name) == 1 else ()
    return Separation(
        session.hidden, distances, tuple(name for name in order if name not in single)
    )
