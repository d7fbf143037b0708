"""`python -m tests.benchmark`: how fast, as ratios of processor times measured in the same run.

Both sides are run in turn, on one thread, and the least of several is taken: other work on the
machine can only add to a processor time.
"""

import os
import subprocess
import sys
import tempfile
import time
import timeit
from pathlib import Path

from tests.bench import ONE_CORE
from tests.machines import ROOT

IMPORTS = "import numpy, scipy.linalg, scipy.special, scipy.optimize, typer, rich, yaml, pydantic"
"""What the dependencies cost that the program uses, and scipy.optimize as it was measured with."""
SESSION = "sample_data/double_posture_session.csv"
COMMANDS = (
    ("--help",),
    ("guide", "signs"),
    ("solve", SESSION),
    ("diagnose", SESSION),
    ("plan",),
    ("measure", "{folder}/{run}.yaml", "--gauge", "simulated", "--seed", "1"),
)
ROUNDS, FILES, SESSIONS, SAMPLE = 7, 40, 20_000, 20
MANY = (17, 167, 1667)  # cycles of some hundred, thousand and ten thousand readings


def needed(*arguments: str) -> tuple[float, float, int]:
    """Processor time [s] of one run of the interpreter, its largest memory [MB], and exit code.

    Nothing is typed and nothing shown.
    """
    with subprocess.Popen(
        [sys.executable, *arguments], cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": ""},
    ) as child:  # fmt: skip
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    # 4: one in a hundred sound sessions is not released.
    assert child.returncode in (0, 4), arguments
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0, child.returncode


def in_turn(*runs: tuple[str, ...], rounds: int = ROUNDS) -> list[float]:
    """Least processor time of each, warm [s]; each time with another number for "{run}"."""
    least = [float("inf")] * len(runs)
    for number in range(rounds + 1):
        for k, arguments in enumerate(runs):
            seconds, *_ = needed(*(word.replace("{run}", str(number)) for word in arguments))
            if number:
                least[k] = min(least[k], seconds)
    return least


def commands(folder: Path) -> None:
    """Each command against the bare imports."""
    for arguments in COMMANDS:
        words = [word.replace("{folder}", str(folder)) for word in arguments]
        ours, imports = in_turn(("-m", "orthoglide_cal", *words), ("-c", IMPORTS))
        row(f"orthocal {' '.join(word for word in arguments if '{' not in word)}", ours, imports)


def one_more_file(folder: Path) -> None:
    """Of many healthy files of `tests/truth` each beyond the first, on a screen and as values.

    They share machine and steps, as sessions of one workshop do; times and readings differ.
    Not of those that the program has in doubt: it also plans what to measure next of them.
    """
    from tests.inference.sessions import texts_of
    from tests.truth import DIAL, PROTOTYPE, make_session

    sessions = [make_session(seed, PROTOTYPE, DIAL) for seed in range(FILES)]
    machine, files = folder / "machine.yaml", []
    machine.write_text(texts_of(sessions[0])[0])
    for seed, session in enumerate(sessions):
        path = folder / f"{seed}.csv"
        path.write_text(texts_of(session)[1])
        if needed("-m", "orthoglide_cal", "solve", "--machine", str(machine), str(path))[2] == 0:
            files.append(str(path))
    for verb, form in (("solve", ()), ("diagnose", ()), ("diagnose", ("--json",))):
        call = ("-m", "orthoglide_cal", verb, "--machine", str(machine), *form)
        runs = (*call, *files), (*call, files[0]), ("-c", IMPORTS)
        many, one, imports = in_turn(*runs, rounds=3)
        seconds = (many - one) / (len(files) - 1)
        row(f"one more healthy file, {' '.join((verb, *form))}", seconds, imports)


def solves(method: str) -> None:
    """Batched solves against scipy's least squares, per session, with the same derivatives."""
    import numpy as np
    from scipy.optimize import least_squares

    from orthoglide_cal.estimation.solution import fit_offsets, pose_plan
    from orthoglide_cal.files.machine_file import default_machine
    from orthoglide_cal.model.measured import DataKind
    from orthoglide_cal.model.model import simulate
    from orthoglide_cal.model.orthoglide import double_posture
    from tests.estimation.sessions import problem_of

    model, kind = default_machine(), DataKind(method)
    if kind is DataKind.READINGS:
        problem = pose_plan(double_posture(model.machine), model, kind)
    else:
        problem = problem_of(kind, model)
    rng = np.random.default_rng(1)
    signal = simulate(model, rng.uniform(-1.0, 1.0, (SESSIONS, 3)), problem.plan)
    data = (signal + 0.01 * rng.standard_normal(signal.shape)) @ problem.matrix.T

    def single() -> None:
        for row in data[:SAMPLE]:
            least_squares(
                lambda x, row=row: problem.predict(x) - row,
                np.zeros(3),
                jac=lambda x: problem.predict_with_jacobian(x)[1],
            )

    batched, alone = (
        min(timeit.repeat(run, timer=time.process_time, number=1))
        for run in (lambda: fit_offsets(problem, data), single)
    )
    row(f"one of {SESSIONS} solves, {method}, against scipy", batched / SESSIONS, alone / SAMPLE)


def growth(folder: Path) -> None:
    """Seconds and memory of sessions of many cycles: healthy, and with a wrong reading.

    The demands: 3,000 readings in 3 s and 300 MB, 30,000 in 20 s and 1 GB, at most 12-fold.
    """
    import numpy as np

    from orthoglide_cal.causes import CAUSES
    from orthoglide_cal.files.machine_file import default_machine
    from orthoglide_cal.files.readings import readings_csv
    from orthoglide_cal.model.model import synthetic_session
    from orthoglide_cal.model.orthoglide import double_posture

    model = default_machine()
    print(f"{'many readings, solve --json':52}{'rows':>8}{'s':>8}{'MB':>8}{'growth':>8}")
    for what, effects in (
        ("healthy", ()),
        ("misread", (CAUSES["misread"].at(np.array([0.5]), (200,)),)),
    ):
        before = 0.0
        for cycles in MANY:
            plan = double_posture(model.machine, cycles)
            rng, offsets = np.random.default_rng(1), np.array([0.4, -0.3, 0.2])
            made = synthetic_session(model.extended(effects), plan, offsets, rng)
            path = folder / f"{what}{cycles}.csv"
            path.write_text(readings_csv(made))
            seconds, peak, _ = needed("-m", "orthoglide_cal", "solve", "--json", str(path))
            grown = f"{seconds / before:.1f}" if before else ""
            print(f"{what:52}{len(plan):>8}{seconds:>8.1f}{peak:>8.0f}{grown:>8}", flush=True)
            before = seconds


def row(what: str, ours: float, unit: float) -> None:
    print(f"{what:52}{1e3 * ours:>12.4f}{1e3 * unit:>12.3f}{ours / unit:>12.4f}", flush=True)


def main() -> None:
    os.environ.update(ONE_CORE)  # before numpy is imported
    print(f"The unit of commands and files: {IMPORTS}")
    print(f"{'processor time':52}{'ours, ms':>12}{'unit, ms':>12}{'ratio':>12}")
    with tempfile.TemporaryDirectory() as folder:
        commands(Path(folder))
        one_more_file(Path(folder))
        growth(Path(folder))
    for method in ("six", "twelve", "readings"):
        solves(method)


if __name__ == "__main__":
    main()
