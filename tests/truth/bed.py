"""Effects beyond the list on a probed bed: how they act in the order of touching, and in which
region of the bed; and how far apart these are, as in `beyond`.
"""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from .beyond import RARE, SIZES, Distinction, Gaussian
from .delta import KOSSEL, V400, DeltaSession, Layout, Truth, make_delta_session, places_of
from .delta_separation import GRAIN, calibrated, families, local_shape, slopes
from .plan import Floats

HOWS = ("drifts", "settles", "steps", "scatters")
KINDS = {
    "everything": ("",), "half": ("left", "right", "front", "back"),
    "quarter": ("front left", "front right", "back left", "back right"), "ring": ("edge", "centre"),
}  # fmt: skip
SHAPES = (0.08, 0.15, 0.3, 0.6, 1.2, 2.4)
"""Time constants and periods of rivals, in addition to the true one, in lengths of the session."""


class Region(NamedTuple):
    """A region of the bed, as seen from the front; all of it without a name."""

    name: str = ""

    def rows(self, x: Floats, y: Floats) -> np.ndarray:
        """Mask of the touches in it, shape (N,)."""
        away2 = x**2 + y**2
        outside = away2 > away2.max() / 2.0
        masks = {"left": x < 0, "right": x > 0, "front": y < 0, "back": y > 0,
                 "edge": outside, "centre": ~outside}  # fmt: skip
        asked = [masks[word] for word in self.name.split()]
        return np.logical_and.reduce(asked, axis=0) | np.zeros(len(x), dtype=bool)

    @property
    def kind(self) -> str:
        return next(kind for kind, names in KINDS.items() if self.name in names)

    @property
    def names(self) -> dict[str, str]:
        """As the answer has it; empty for the whole bed."""
        return {"region": self.name} if self.name else {}


REGIONS = tuple(Region(name) for names in KINDS.values() for name in names)


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
    where: Region
    shape: float


def draw_bed(seed: int, how: str, kind: str) -> HiddenInBed:
    """Draw three passes over a bed, and an effect somewhere; the same arguments give the same."""
    rng = np.random.default_rng([seed, 8])
    machine, region = (V400, KOSSEL)[rng.integers(2)], Region(str(rng.choice(KINDS[kind])))
    layout, bumps = Layout(int(rng.choice((37, 61))), cycles=3), (machine.texture, GRAIN)
    rows = region.rows(*np.tile(places_of(layout, machine.bed), (3, 1)).T)
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


def distinguish_bed(hidden: HiddenInBed) -> Distinction:
    """Compare a hidden effect with all others, and with one listed cause."""
    session, truth = hidden.session, hidden.session.truth
    machine, minutes = session.machine, session.minutes
    bare = Truth(truth.endstops, truth.radius, truth.angles)
    free = slopes(session, bare, 6, calibrated, 1e-3)
    local = local_shape(session) / machine.noise**2
    noise = np.linalg.cholesky(local + 1e-9 * np.eye(len(minutes)))
    at = Gaussian(free / machine.noise, noise, np.zeros((len(minutes), 0)))
    record = session.contact / machine.noise
    causes = families(session, bare).values()
    # Nothing, or a cause that one bed in a hundred has.
    listed = min(RARE + float(at.costs(record, one[None] / machine.noise)[0]) for one in causes)
    costs = {("", Region()): listed}
    for how, region in product(HOWS, REGIONS):
        rows = region.rows(session.x, session.y)
        shapes = minutes[rows] if how == "steps" else np.array(SHAPES) * minutes[-1]
        tried = [*shapes, hidden.shape] if hidden.shape else shapes
        costs[how, region] = min(
            float(at.costs(record, SIZES[:, None, None] * pattern).min())
            for pattern in (columns(how, rows, minutes, shape) for shape in tried)
        )
    return Distinction.among(costs, (hidden.how, hidden.where))
