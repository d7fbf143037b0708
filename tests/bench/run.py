"""Ask the program: write records to a folder and run `diagnose` on them as its users do."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from tests.bench import ONE_CORE
from tests.inference.sessions import texts_of
from tests.machines import ROOT
from tests.truth import Session, readings_csv

from .accuracy import HeldOut, another_day
from .cases import Case
from .scoring import Answer, Judged

MACHINE_FILE = "machine.yaml"
PROGRAM = [sys.executable, "-m", "orthoglide_cal"]
"""This checkout's `orthocal`, whatever else is installed."""


class Bench(NamedTuple):
    """All sessions, judged, and predictions of second sessions."""

    judged: Sequence[Judged]
    later: Sequence[HeldOut] = ()


def diagnose(where: Path, cases: Iterable[Case], extra: Sequence[str] = ()) -> list[Judged]:
    """Answers to records of one machine: one run of `diagnose --json` on all, on one thread."""
    asked = {f"{case.name}.csv": case for case in cases}
    for name, case in asked.items():
        machine, record = texts_of(case.session)
        (where / MACHINE_FILE).write_text(machine, encoding="utf-8")
        (where / name).write_text(record, encoding="utf-8")
    done = subprocess.run(
        [*PROGRAM, "diagnose", "--machine", MACHINE_FILE, "--json", *extra, *asked],
        cwd=where, env={**os.environ, "PYTHONPATH": str(ROOT), **ONE_CORE},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    assert len(lines) == len(asked), f"{len(lines)} answers for {len(asked)} files: {done.stderr}"
    with (where / "answers.jsonl").open("a", encoding="utf-8") as kept:
        kept.write(done.stdout)
    answers = [Answer(json.loads(line)) for line in lines]
    return [Judged(*pair) for pair in zip(asked.values(), answers, strict=True)]


def run_bench(
    drawn: Iterable[Case], holdouts: int = 0, seed: int = 1, keep: Path | None = None
) -> Bench:
    """Ask about all sessions, machine by machine, and judge the answers.

    Args:
        drawn: the sessions.
        holdouts: second sessions per cause, machine and gauge.
        seed: draws these.
        keep: folder in which the records and answers stay.
    """
    with tempfile.TemporaryDirectory() as name:
        where = keep or Path(name)
        where.mkdir(parents=True, exist_ok=True)
        of_machine: dict[str, list[Case]] = {}
        for case in drawn:
            of_machine.setdefault(texts_of(case.session)[0], []).append(case)
        judged = [item for cases in of_machine.values() for item in diagnose(where, cases)]

        def ask(item: Judged, later: Session) -> Answer:
            (where / "later.csv").write_text(readings_csv(later), encoding="utf-8")
            extra = ("--holdout", "later.csv", "--applied", "0", "0", "0")
            return diagnose(where, [item.case], extra)[0].answer

        return Bench(judged, another_day(judged, holdouts, seed, ask) if holdouts else ())
