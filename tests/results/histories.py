"""Histories of a machine with a known story, from the independent truth: shared by the tests.

Each session is measured by `tests.truth` on the same machine (legs and gauge scale stay), with its
stands placed again; the program sees the text of the tables and nothing else.
"""

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from orthoglide_cal.files.input import Input, read_input
from orthoglide_cal.files.text import document_from_bytes
from tests import truth
from tests.inference.sessions import model_of
from tests.truth.effects import draw_machine_cause
from tests.truth.machines import PLACEMENT, SCALE, TOLERANCES
from tests.truth.session import Setting

START = datetime(2026, 3, 2, 9, tzinfo=UTC)
# What one date knows of an offset beside what all share, one standard deviation [mm].
SIGMA = {"dial": 0.0077, "micron": 0.0037}
STORIES = ("unchanged", "step", "steps", "drift", "scatter", "step and drift", "adjusted", "warm",
           "cause")  # fmt: skip
# Story → verdict; the others are "changed".
WANTED = {
    "unchanged": "unchanged",
    "warm": "unchanged",
    "drift": "drifting",
    "scatter": "scattering",
}
GROWTH = 11.5e-6  # of legs, per kelvin


@dataclass(frozen=True, eq=False)
class Drawn:
    """A history and the truth behind it.

    `path` is how the offsets move, (n, 3) [mm]; `gaps` before which sessions, `size` of the steps.
    """

    story: str
    inputs: list[Input]
    path: np.ndarray
    gaps: tuple[int, ...]
    size: np.ndarray
    days: np.ndarray
    sigma: float

    @property
    def sigmas(self) -> float:
        """How far the path is from the nearest one of another story [standard deviations]."""
        n = len(self.path)
        one, line = np.ones(n), self.days / self.days[-1]
        steps = [(np.arange(n) > gap).astype(float) for gap in range(n - 1)]
        other = {
            **{story: [[one, line]] for story in ("step", "adjusted", "steps")},
            "drift": [[one, step] for step in steps],
            "scatter": [[one, line], *([one, step] for step in steps)],
            "step and drift": [[one, line], *([one, step] for step in steps)],
        }.get(self.story, [])
        left = [
            float(np.linalg.norm(self.path - base @ np.linalg.lstsq(base, self.path)[0]))
            for base in map(np.column_stack, other)
        ]
        return min(left, default=np.inf) / self.sigma


def draw(story: str, seed: int, count: int | None = None) -> Drawn:
    """A history of 3 to 12 sessions.

    Steps and drifts are 3 to 20 U of one or all offsets, U = 2 σ of one date.
    """
    rng = np.random.default_rng([seed, STORIES.index(story)])
    machine = truth.PROTOTYPE if rng.random() < 0.7 else truth.LARGE
    gauge = truth.DIAL if rng.random() < 0.7 else truth.MICRON
    sigma = SIGMA[gauge.name]
    n = count or int(rng.integers(4 if story in ("steps", "step and drift") else 3, 13))
    days = np.concatenate([[0.0], np.cumsum(rng.uniform(5.0, 40.0, n - 1))])

    def size() -> np.ndarray:
        one = rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 20.0) * 2.0 * sigma
        if rng.random() < 0.6:
            return one * np.eye(3)[rng.integers(3)]
        turn = rng.normal(size=3)
        return abs(one) * np.sqrt(3.0) * turn / np.linalg.norm(turn)

    path, gaps, step = np.zeros((n, 3)), (), np.zeros(3)
    entered = np.zeros((n, 3))
    if story in ("step", "step and drift", "adjusted"):
        gaps, step = (int(rng.integers(n - 1)),), size()
        path[gaps[0] + 1 :] += step
    if story == "steps":
        gaps = tuple(sorted(rng.choice(n - 1, 2, replace=False).tolist()))
        for gap in gaps:
            path[gap + 1 :] += size()
    if story in ("drift", "step and drift"):
        path += np.outer(days / days[-1], size())
    if story == "scatter":
        path += rng.normal(scale=rng.uniform(3.0, 20.0) * sigma, size=(n, 3))
    if story == "unchanged" and rng.random() < 0.5:
        # Entered and recorded.
        entered[int(rng.integers(1, n)) :] = rng.normal(scale=0.3, size=3).round(3)
    warm = 20.0 + rng.uniform(-1.0, 1.0, n)
    if story == "warm":
        warm = 20.0 + rng.uniform(-8.0, 12.0, n)
        path += rng.uniform(0.0, 1.0) * GROWTH * machine.leg * (warm - 20.0)[:, None]
    fault, cause_from = None, n
    if story == "cause":
        cause_from = int(rng.integers(1, n))
        fault = draw_machine_cause(str(rng.choice(["axis_gap", "axis_squareness"])), rng)
        gaps = (cause_from - 1,)
    legs, scale = rng.normal(scale=TOLERANCES["leg_length"], size=3), rng.normal(scale=SCALE)
    start, inputs = rng.normal(scale=0.5, size=3), []
    for k in range(n):
        inputs.append(
            measured(
                machine,
                gauge,
                start + path[k] - entered[k],
                (fault,) if fault and k >= cause_from else (),
                Setting(legs, rng.normal(scale=PLACEMENT, size=6), float(scale)),
                rng,
                f"{k}.csv",
                active=entered[k],
                started=(START + timedelta(days=float(days[k]))).isoformat(),
                temperature_c=(float(warm[k]), float(warm[k])),
            )
        )
    return Drawn(story, inputs, path, gaps, step, days, sigma)


def measured(
    machine: truth.Machine,
    gauge: truth.Gauge,
    offsets: np.ndarray,
    effects: tuple[truth.Effect, ...],
    setting: Setting,
    rng: np.random.Generator,
    name: str,
    active: np.ndarray | None = None,
    **conditions: object,
) -> Input:
    """One session as the program reads it; `offsets` are beyond the active ones."""
    plan = truth.standard_plan(machine, rng)
    session = truth.measure(machine, gauge, plan, offsets, effects, rng, setting=setting)
    model = model_of(machine, gauge)
    if active is not None and active.any():
        model = model.holding(tuple(active.tolist()))
    document = document_from_bytes(truth.readings_csv(session).encode(), name)
    given = read_input(document, model)
    return replace(given, conditions=given.conditions.changed(**conditions))
