"""`python -m tests.benchmark`: how fast, as ratios measured in the same run.

Absolute times depend on the machine; a ratio of two medians taken alternately does not much, and
one of processor times hardly depends on what else the machine does, nor on its disk. All rows but
the batched solves go through the command line; what those need of the package is named in
`solving` alone.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.journeys import run_quietly

ROOT = Path(__file__).parents[1]
SESSION = "sample_data/double_posture_session.csv"
IMPORTS = "typer, rich, yaml, pydantic, scipy.special"
MEASURE = ("measure", "--gauge", "simulated", "--seed", "1")
SESSIONS = 20_000
FILES = 200
SAMPLE = 20
ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@dataclass(frozen=True)
class Cost:
    """Time of day, and processor time of this process and its children, both in seconds."""

    passed: float
    computed: float

    def each(self, count: int) -> "Cost":
        """One of so many."""
        return Cost(self.passed / count, self.computed / count)


@dataclass(frozen=True)
class Comparison:
    """Two medians, taken alternately."""

    what: str
    ours: Cost
    theirs: Cost


def spent() -> tuple[float, float]:
    """Time of day and processor time so far [s]; a child counts from its end on."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.perf_counter(), time.process_time() + children.ru_utime + children.ru_stime


def alternately(
    ours: Callable[[], object], theirs: Callable[[], object], rounds: int
) -> tuple[Cost, Cost]:
    """Median cost of each, warm."""
    costs: tuple[list[list[float]], list[list[float]]] = ([], [])
    ours()
    theirs()
    for _ in range(rounds):
        for taken, run in zip(costs, (ours, theirs), strict=True):
            before = spent()
            run()
            taken.append([b - a for a, b in zip(before, spent(), strict=True)])
    mine, other = (Cost(*map(statistics.median, zip(*taken, strict=True))) for taken in costs)
    return mine, other


def solving(method: str) -> Comparison:
    """Batched solves against scipy's least squares, per session, with the same derivatives."""
    import numpy as np
    from scipy.optimize import least_squares

    from orthoglide_cal.estimation import Problem, fit_offsets
    from orthoglide_cal.files import default_machine
    from orthoglide_cal.model import (
        DIFFERENCES,
        DataKind,
        double_posture,
        ideal_plan,
        reduction,
        simulate,
        zero_free,
    )

    model, kind = default_machine(), DataKind(method)
    if kind is DataKind.READINGS:
        plan = double_posture(model.machine)
        matrix = zero_free(plan)
    else:
        plan = ideal_plan(kind, model.machine)
        matrix = reduction(kind, DIFFERENCES[kind], model.machine, plan)
    problem = Problem(model, plan, matrix)
    rng = np.random.default_rng(1)
    signal = simulate(model, rng.uniform(-1.0, 1.0, (SESSIONS, 3)), plan)
    data = (signal + 0.01 * rng.standard_normal(signal.shape)) @ problem.matrix.T

    def ours() -> object:
        return fit_offsets(problem, data)

    def theirs() -> object:
        return [
            least_squares(
                lambda x, row=row: problem.predict(x) - row,
                np.zeros(3),
                jac=lambda x: problem.predict_with_jacobian(x)[1],
            )
            for row in data[:SAMPLE]
        ]

    batched, single = alternately(ours, theirs, 5)
    return Comparison(f"one solve, {method}", batched.each(SESSIONS), single.each(SAMPLE))


def process(*arguments: str, cwd: Path = ROOT) -> Callable[[], object]:
    """Runs an interpreter with these arguments, nothing typed and nothing shown."""
    return lambda: subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        check=True,
    )


def command(*arguments: str, imports: str = IMPORTS, rounds: int = 7) -> Comparison:
    """A command as a process, against a process that only imports what the command needs."""
    with tempfile.TemporaryDirectory() as folder:
        # `measure` leaves its sessions where it runs.
        cwd = Path(folder) if arguments[0] == "measure" else ROOT
        costs = alternately(
            process("-m", "orthoglide_cal", *arguments, cwd=cwd),
            process("-c", f"import {imports}"),
            rounds,
        )
    return Comparison(f"orthocal {' '.join(arguments)}", *costs)


def many_files() -> Comparison:
    """One more file in a `diagnose` of many, against the start of a bare interpreter."""
    with tempfile.TemporaryDirectory() as folder:
        files = [f"{folder}/{seed}.csv" for seed in range(FILES)]
        for seed, path in enumerate(files):
            run_quietly("simulate", "--seed", str(seed), "--output", path)
        call = ("-m", "orthoglide_cal", "diagnose", "--json")
        many, one = alternately(process(*call, *files), process(*call, files[0]), 3)
        bare, _ = alternately(process("-c", "pass"), process("-c", "pass"), 5)
    more = Cost(many.passed - one.passed, many.computed - one.computed)
    return Comparison("one more file", more.each(FILES - 1), bare)


def main() -> None:
    """Measure and print."""
    os.environ.update(ONE_CORE)  # before numpy is imported
    solves = [solving(method) for method in ("six", "twelve", "readings")]
    print(f"{'':34}{'batched':>12}{'scipy':>12}{'times faster':>14}")
    for row in solves:
        ours, theirs = row.ours.computed, row.theirs.computed
        print(f"{row.what:34}{ours * 1e6:>9.1f} µs{theirs * 1e6:>9.1f} µs{theirs / ours:>14.0f}")
    commands = [
        command("--version", imports="typer"),
        command("--help", imports="typer"),
        command("solve", "sample_data/experiment2.csv"),
        command("diagnose", "--help", imports="typer"),
        command("diagnose", SESSION),
        command("measure", "--gauge", "simulated", "--seed", "1"),
        command("plan"),
    ]
    print(f"\n{'':58}{'time of day':^30}{'processor time':^30}")
    print(f"{'':58}{'command   imports  ratio':>30}{'command   imports  ratio':>30}")
    for row in commands:
        pairs = (
            (row.ours.passed, row.theirs.passed),
            (row.ours.computed, row.theirs.computed),
        )
        cells = (f"{a:>11.2f} s{b:>8.2f} s{a / b:>7.2f}" for a, b in pairs)
        print(f"{row.what:58}{'  '.join(cells)}")
    row = many_files()
    ours, bare = row.ours.computed, row.theirs.computed
    print(
        f"\ndiagnose of {FILES} healthy files, one core: {ours * 1e3:.1f} ms each"
        f" ({1.0 / ours:.0f} per second), {ours / bare:.1f} starts of a bare interpreter"
    )
    both = solves[0].ours.computed + solves[1].ours.computed
    print(f"\nTable 3 (800,000 solves) at this pace: {400_000 * both:.0f} s")


if __name__ == "__main__":
    main()
