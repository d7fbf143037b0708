"""Running `orthocal diagnose` inside this process."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from orthoglide_cal.cli.app import app
from tests import truth
from tests.machines import SAMPLES
from tests.truth.session import Session

HEALTHY = SAMPLES / "double_posture_session.csv"
GAP = SAMPLES / "session.yaml"
SECOND, THIRD = SAMPLES / "experiment2.csv", SAMPLES / "experiment3.csv"


@dataclass(frozen=True)
class Ran:
    code: int
    out: str
    err: str

    def lines(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.out.splitlines()]


def diagnose(*arguments: object, text: str | None = None) -> Ran:
    done = CliRunner().invoke(app, ["diagnose", *map(str, arguments)], input=text)
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert "Traceback" not in done.output
    return Ran(done.exit_code, done.stdout, done.stderr)


@cache
def shown(path: Path, *options: str) -> str:
    """The text for one of the samples."""
    ran = diagnose(path, *options)
    assert ran.code == 0
    return ran.out


@cache
def one(*arguments: object) -> dict[str, Any]:
    ran = diagnose(*arguments, "--json")
    assert ran.code == 0
    assert ran.err == ""
    (answer,) = ran.lines()
    return answer


def written(folder: Path, session: Session, name: str = "readings.csv") -> tuple[Path, Path]:
    """Record and machine file of a session."""
    machine = folder / "machine.yaml"
    machine.write_text(truth.machine_yaml(session.machine, session.gauge), encoding="utf-8")
    return truth.write_readings(session, folder / name), machine
