"""Ask the program: write records to a folder and run `diagnose` on them as its users do."""

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.truth import Gauge, Machine, Session, machine_yaml, write_readings

from .answers import Answer, parse_answer

ROOT = Path(__file__).parents[2]
MACHINE_FILE = "machine.yaml"
ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class RunError(RuntimeError):
    """The program did not answer for every file; carries what it said instead."""


@dataclass(frozen=True)
class Run:
    """What one call answered."""

    answers: tuple[Answer, ...]
    cpu_seconds: float
    """Processor time of the call, start-up included."""
    output: str
    """The answers as they were printed."""


def program() -> list[str]:
    """The command line of this checkout's `orthocal`, whatever else is installed."""
    return [sys.executable, "-m", "orthoglide_cal"]


@contextmanager
def folder(keep: Path | None) -> Iterator[Path]:
    """A folder for records: the one to keep, made if need be, or a temporary one."""
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        yield keep
        return
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def write_group(
    where: Path, machine: Machine, gauge: Gauge, sessions: Sequence[tuple[str, Session]]
) -> list[str]:
    """Write the machine file and one record per (name, session); returns the file names."""
    (where / MACHINE_FILE).write_text(machine_yaml(machine, gauge), encoding="utf-8")
    return [write_readings(session, where / f"{name}.csv").name for name, session in sessions]


def diagnose(where: Path, files: Sequence[str], extra: Sequence[str] = ()) -> Run:
    """Run `diagnose --json` once on all files of a folder, on one thread.

    Raises:
        RunError: there is not one answer per file.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [*program(), "diagnose", "--machine", MACHINE_FILE, "--json", *extra, *files],
        cwd=where,
        env={**os.environ, "PYTHONPATH": str(ROOT), **ONE_CORE},
        capture_output=True,
        text=True,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    lines = [line for line in done.stdout.splitlines() if line.strip()]
    if len(lines) != len(files):
        raise RunError(
            f"{len(lines)} answers for {len(files)} files, exit code {done.returncode}: "
            f"{done.stderr[-2000:]}"
        )
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(tuple(parse_answer(line) for line in lines), cpu, done.stdout)
