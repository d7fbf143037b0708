"""`python -m tests.benchmark`: how fast, as ratios measured in the same run.

Absolute times depend on the machine; a ratio of two medians taken alternately does not much.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from orthoglide_cal.data import readings_csv
from orthoglide_cal.estimation import Problem, fit_offsets
from orthoglide_cal.protocols import (
    NAMES,
    double_posture,
    ideal_plan,
    reduction,
    synthetic_session,
    zero_free,
)
from orthoglide_cal.simulation import simulate
from tests.machines import PROTOTYPE, ROOT

SESSION = "sample_data/double_posture_session.csv"
IMPORTS = "typer, rich, yaml, pydantic, scipy.special"
SESSIONS = 20_000
FILES = 200
SAMPLE = 20
ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


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


def many_files() -> Comparison:
    """One more file in a `diagnose` of many, against the start of a bare interpreter."""
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{seed}.csv" for seed in range(FILES)]
        for seed, path in enumerate(files):
            rng = np.random.default_rng(seed)
            made = synthetic_session(PROTOTYPE, double_posture(PROTOTYPE), np.zeros(3), rng)
            path.write_text(readings_csv(made), encoding="utf-8")

        def run(*arguments: str) -> Callable[[], object]:
            return lambda: subprocess.run(
                [sys.executable, *arguments],
                cwd=ROOT,
                env={**os.environ, "PYTHONPATH": str(ROOT), **ONE_CORE},
                stdout=subprocess.DEVNULL,
                check=True,
            )

        call = ("-m", "orthoglide_cal", "diagnose", "--json")
        many, one = alternately(run(*call, *map(str, files)), run(*call, str(files[0])), 3)
        bare, _ = alternately(run("-c", "pass"), run("-c", "pass"), 5)
    return Comparison("one more file", (many - one) / (FILES - 1), bare)


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
        start(["solve", "sample_data/experiment2.csv"], IMPORTS),
        start(["diagnose", "--help"], "typer"),
        start(["diagnose", SESSION], IMPORTS),
    ]
    print(f"\n{'':48}{'command':>10}{'imports':>10}{'ratio':>10}")
    for row in starts:
        print(f"{row.what:48}{row.ours:>8.2f} s{row.theirs:>8.2f} s{row.ours / row.theirs:>10.2f}")
    row = many_files()
    print(
        f"\ndiagnose of {FILES} healthy files, one core: {row.ours * 1e3:.1f} ms each"
        f" ({1.0 / row.ours:.0f} per second), {1.0 / row.ratio:.1f} starts of a bare interpreter"
    )
    both = solves[0].ours + solves[1].ours
    print(f"\nTable 3 (800,000 solves) at this pace: {400_000 * both:.0f} s")


if __name__ == "__main__":
    main()
