"""Ask the program: write records to a folder and run `diagnose` on them as its users do."""

import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.machines import ROOT
from tests.truth import Session, machine_yaml, readings_csv
from tests.truth.delta import DeltaSession, delta_csv, delta_yaml

from .accuracy import HeldOut, another_day
from .answers import Answer, parse_answer
from .cases import Case
from .scoring import Judged, judge

MACHINE_FILE = "machine.yaml"
ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class RunError(RuntimeError):
    """The program did not answer for every file; carries what it said instead."""


@dataclass(frozen=True)
class Bench:
    """All sessions, judged."""

    judged: tuple[Judged, ...]
    cpu_seconds: float
    """Processor time of the program, start-ups included."""
    later: tuple[HeldOut, ...] = ()
    """Predictions of second sessions."""

    @property
    def per_second(self) -> float:
        """Sessions per second of processor time."""
        return len(self.judged) / max(self.cpu_seconds, 1e-9)


def program() -> list[str]:
    """The command line of this checkout's `orthocal`, whatever else is installed."""
    return [sys.executable, "-m", "orthoglide_cal"]


def files_of(session: Session | DeltaSession) -> tuple[str, str]:
    """Text of its machine file and of its record."""
    if isinstance(session, DeltaSession):
        return delta_yaml(session.machine), delta_csv(session)
    return machine_yaml(session.machine, session.gauge), readings_csv(session)


def diagnose(
    where: Path, sessions: Iterable[tuple[str, Session | DeltaSession]], extra: Sequence[str] = ()
) -> list[Answer]:
    """Answers to records of one machine: one run of `diagnose --json` on all, on one thread.

    Raises:
        RunError: there is not one answer per file.
    """
    names = []
    for name, session in sessions:
        machine, record = files_of(session)
        (where / MACHINE_FILE).write_text(machine, encoding="utf-8")
        (where / f"{name}.csv").write_text(record, encoding="utf-8")
        names.append(f"{name}.csv")
    done = subprocess.run(
        [*program(), "diagnose", "--machine", MACHINE_FILE, "--json", *extra, *names],
        cwd=where,
        env={**os.environ, "PYTHONPATH": str(ROOT), **ONE_CORE},
        capture_output=True,
        text=True,
        check=False,
    )
    lines = [line for line in done.stdout.splitlines() if line.strip()]
    if len(lines) != len(names):
        raise RunError(
            f"{len(lines)} answers for {len(names)} files, exit code {done.returncode}: "
            f"{done.stderr[-2000:]}"
        )
    with (where / "answers.jsonl").open("a", encoding="utf-8") as kept:
        kept.write(done.stdout)
    return [parse_answer(line) for line in lines]


def run_bench(
    drawn: Iterable[Case],
    holdouts: int = 0,
    seed: int = 1,
    keep: Path | None = None,
) -> Bench:
    """Ask about all sessions, machine by machine, and judge the answers.

    Args:
        drawn: the sessions.
        holdouts: second sessions per cause, machine and gauge.
        seed: draws these.
        keep: folder in which the records, truths and answers stay.
    """
    with tempfile.TemporaryDirectory() as name:
        where = keep or Path(name)
        where.mkdir(parents=True, exist_ok=True)
        of_machine: dict[str, list[Case]] = {}
        for case in drawn:
            of_machine.setdefault(files_of(case.session)[0], []).append(case)
        judged: list[Judged] = []
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        for cases in of_machine.values():
            answers = diagnose(where, [(case.name, case.session) for case in cases])
            judged += judge(cases, answers)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        if keep:
            truths = (
                json.dumps({"name": item.case.name, **item.case.session.truth()})
                for item in judged
                if isinstance(item.case.session, Session)
            )
            (keep / "truths.jsonl").write_text("\n".join(truths) + "\n", encoding="utf-8")

        def ask(item: Judged, later: Session) -> Answer:
            (where / "later.csv").write_text(readings_csv(later), encoding="utf-8")
            extra = ("--holdout", "later.csv", "--applied", "0", "0", "0")
            return diagnose(where, [(item.case.name, item.case.session)], extra)[0]

        later = another_day(judged, holdouts, seed, ask) if holdouts else []
    return Bench(tuple(judged), cpu, tuple(later))
