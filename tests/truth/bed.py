"""Effects beyond the list on a probed bed: how they act in the order of touching, and in which
region of the bed; and how far apart these are, as in `beyond`.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from .beyond import RARE, SAME, SIZES, Gaussian
from .delta import (
    KOSSEL,
    TOLERANCES,
    V400,
    DeltaSession,
    Layout,
    Truth,
    changes,
    make_delta_session,
    places_of,
)
from .delta_separation import GRAIN, calibrated, local_shape, slopes
from .plan import Floats, Ints
from .separation import STANDS_OUT

HOWS = ("drifts", "settles", "steps", "scatters")
KINDS = {
    "everything": ("",), "half": ("left", "right", "front", "back"),
    "quarter": ("front left", "front right", "back left", "back right"), "ring": ("edge", "centre"),
}  # fmt: skip
REGIONS = tuple(region for regions in KINDS.values() for region in regions)
SHAPES = (0.08, 0.15, 0.3, 0.6, 1.2, 2.4)
"""Time constants and periods of rivals, in addition to the true one, in lengths of the session."""


def rows_of(region: str, x: Floats, y: Floats) -> np.ndarray:
    """Mask of the touches in a region as seen from the front, shape (N,)."""
    away2 = x**2 + y**2
    outside = away2 > away2.max() / 2.0
    masks = {"left": x < 0, "right": x > 0, "front": y < 0, "back": y > 0,
             "edge": outside, "centre": ~outside}  # fmt: skip
    asked = [masks[word] for word in region.split()]
    return np.logical_and.reduce(asked, axis=0) | np.zeros(len(x), dtype=bool)


def columns(how: str, rows: np.ndarray, minutes: Floats, shape: float) -> Floats:
    """What an effect of size one adds to the touches, one column per size, shape (N, k).

    `shape`: period of a drift, time constant of settling, or moment of a step [min].
    """
    turn = 2.0 * np.pi * minutes / (shape or 1.0)
    every = {
        "drifts": lambda: np.stack((np.sin(turn), np.cos(turn)), axis=1),
        "settles": lambda: np.exp(-minutes / shape)[:, None],
        "steps": lambda: 1.0 * (minutes >= shape)[:, None],
        "scatters": lambda: np.eye(len(minutes)),
    }[how]() * rows[:, None]
    return np.asarray(every[:, every.any(axis=0)])


@dataclass(frozen=True, eq=False)
class HiddenInBed:
    """A session with an effect in a region, the same without it, and what `columns` takes."""

    session: DeltaSession
    twin: DeltaSession
    how: str
    region: str
    shape: float


def draw_bed(seed: int, how: str, kind: str) -> HiddenInBed:
    """Draw three passes over a bed, and an effect somewhere; the same arguments give the same."""
    rng = np.random.default_rng([seed, 8])
    machine, region = (V400, KOSSEL)[rng.integers(2)], str(rng.choice(KINDS[kind]))
    layout, bumps = Layout(int(rng.choice((37, 61))), cycles=3), (machine.texture, GRAIN)
    rows = rows_of(region, *np.tile(places_of(layout, machine.bed), (3, 1)).T)
    drawn: list[float] = []

    def disturb(truth: Truth, minutes: Floats, _: np.random.Generator) -> tuple[Truth, Floats]:
        long = float(minutes[-1])
        drawn.append(float({
            "drifts": long * rng.uniform(0.2, 0.6), "settles": long * rng.uniform(0.1, 0.4),
            "steps": rng.choice(minutes[rows][len(minutes[rows]) // 6 : -3]),
        }.get(how, 0.0)))  # fmt: skip
        pattern = columns(how, rows, minutes, drawn[0])
        count = pattern.shape[1]
        sizes = rng.uniform(8.0, 40.0, size=count) * rng.choice([-1.0, 1.0], size=count)
        if how == "scatters":
            sizes = rng.uniform(4.0, 9.0) * rng.normal(size=count)
        return truth, machine.noise * pattern @ sizes

    session, twin = (
        make_delta_session(seed, machine, (), layout, bumps, outside)
        for outside in ((f"{how} {kind}", disturb), None)
    )
    return HiddenInBed(session, twin, how, region, drawn[0])


def distinguish_bed(hidden: HiddenInBed) -> tuple[frozenset[tuple[str, str]], bool]:
    """The (how, region) that are the hidden effect on this plan, and whether it is clear."""
    session, truth = hidden.session, hidden.session.truth
    machine, minutes = session.machine, session.minutes
    bare = Truth(truth.endstops, truth.radius, truth.angles)
    free = slopes(session, bare, 6, calibrated, 1e-3)
    local = local_shape(session) / machine.noise**2
    noise = np.linalg.cholesky(local + 1e-9 * np.eye(len(minutes)))
    at = Gaussian(free / machine.noise, noise, np.zeros((len(minutes), 0)))
    record = session.contact / machine.noise
    families = [
        slopes(session, bare, count, change, 1e-2 * size) * size / machine.noise
        for cause, (count, change) in changes(machine.bed).items()
        for size in [TOLERANCES[cause]]
    ]
    costs = {("", ""): min(RARE + float(at.costs(record, one[None])[0]) for one in families)}
    for how, region in product(HOWS, REGIONS):
        rows = rows_of(region, session.x, session.y)
        shapes: Ints | Floats = minutes[rows] if how == "steps" else np.array(SHAPES) * minutes[-1]
        tried = (columns(how, rows, minutes, shape) for shape in (*shapes, hidden.shape))
        costs[how, region] = min(
            float(at.costs(record, SIZES[:, None, None] * pattern).min()) for pattern in tried
        )
    own = costs.pop((hidden.how, hidden.region))
    same = {claim for claim, cost in costs.items() if claim[0] and abs(cost - own) < SAME}
    nearest = min(cost for claim, cost in costs.items() if claim not in same)
    return frozenset({(hidden.how, hidden.region), *same}), nearest - own >= STANDS_OUT**2
