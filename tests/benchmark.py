"""`python -m tests.benchmark`: how fast, as ratios measured in the same run.

Absolute times depend on the machine; a ratio of two medians taken alternately does not much.
"""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from orthoglide_cal.estimation import Problem, fit_offsets
from orthoglide_cal.protocols import NAMES, double_posture, ideal_plan, reduction, zero_free
from orthoglide_cal.simulation import simulate
from tests.machines import PROTOTYPE, ROOT

SESSIONS = 20_000
SAMPLE = 20


@dataclass(frozen=True)
class Comparison:
    """Two medians in seconds, taken alternately."""

    what: str
    ours: float
    theirs: float

    @property
    def ratio(self) -> float:
        """How many times longer the other takes."""
        return self.theirs / self.ours


def alternately(
    ours: Callable[[], object], theirs: Callable[[], object], rounds: int
) -> tuple[float, float]:
    """Median time of each, warm [s]."""
    times: tuple[list[float], list[float]] = ([], [])
    ours()
    theirs()
    for _ in range(rounds):
        for taken, run in zip(times, (ours, theirs), strict=True):
            start = time.perf_counter()
            run()
            taken.append(time.perf_counter() - start)
    return statistics.median(times[0]), statistics.median(times[1])


def problem_of(method: str) -> Problem:
    """One estimation problem of the prototype."""
    if method == "readings":
        plan = double_posture(PROTOTYPE)
        return Problem(PROTOTYPE, plan, zero_free(plan))
    plan = ideal_plan(method, PROTOTYPE)
    return Problem(PROTOTYPE, plan, reduction(method, NAMES[method], PROTOTYPE, plan))


def solving(method: str) -> Comparison:
    """Batched solves against scipy's least squares, per session, with the same derivatives."""
    problem = problem_of(method)
    rng = np.random.default_rng(1)
    signal = simulate(PROTOTYPE, rng.uniform(-1.0, 1.0, (SESSIONS, 3)), problem.plan)
    data = (signal + 0.01 * rng.standard_normal(signal.shape)) @ problem.matrix.T

    def ours() -> object:
        return fit_offsets(problem, data)

    def theirs() -> object:
        return [
            least_squares(
                lambda x, row=row: problem.model(x) - row,
                np.zeros(3),
                jac=lambda x: problem.model_with_jacobian(x)[1],
            )
            for row in data[:SAMPLE]
        ]

    batched, single = alternately(ours, theirs, 5)
    return Comparison(f"one solve, {method}", batched / SESSIONS, single / SAMPLE)


def start(arguments: Sequence[str], imports: str) -> Comparison:
    """A command as a process, against a process that only imports what the command needs."""

    def run(command: Sequence[str]) -> Callable[[], object]:
        return lambda: subprocess.run(
            [sys.executable, *command],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.DEVNULL,
            check=True,
        )

    ours, theirs = alternately(
        run(["-m", "orthoglide_cal", *arguments]), run(["-c", f"import {imports}"]), 7
    )
    return Comparison(f"orthocal {' '.join(arguments)}", ours, theirs)


def main() -> None:
    """Measure and print."""
    solves = [solving(method) for method in ("six", "twelve", "readings")]
    print(f"{'':34}{'batched':>12}{'scipy':>12}{'times faster':>14}")
    for row in solves:
        print(
            f"{row.what:34}{row.ours * 1e6:>9.1f} µs{row.theirs * 1e6:>9.1f} µs{row.ratio:>14.0f}"
        )
    starts = [
        start(["--version"], "typer"),
        start(["--help"], "typer"),
        start(
            ["solve", "sample_data/experiment2.csv"], "typer, rich, yaml, pydantic, scipy.special"
        ),
        start(["diagnose", "--help"], "typer"),
    ]
    print(f"\n{'':48}{'command':>10}{'imports':>10}{'ratio':>10}")
    for row in starts:
        print(f"{row.what:48}{row.ours:>8.2f} s{row.theirs:>8.2f} s{row.ours / row.theirs:>10.2f}")
    both = solves[0].ours + solves[1].ours
    print(f"\nTable 3 (800,000 solves) at this pace: {400_000 * both:.0f} s")


if __name__ == "__main__":
    main()
