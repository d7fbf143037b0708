"""Running `orthocal diagnose` inside this process."""

from functools import cache
from pathlib import Path
from typing import Any

from typer.testing import Result

from tests import truth
from tests.cli.program import done, lines, run
from tests.machines import SAMPLES
from tests.truth.session import Session

HEALTHY = SAMPLES / "double_posture_session.csv"
GAP = SAMPLES / "session.yaml"
SECOND, THIRD = SAMPLES / "experiment2.csv", SAMPLES / "experiment3.csv"


def diagnose(*arguments: object, text: str = "") -> Result:
    return run("diagnose", *map(str, arguments), text=text)


def told(*arguments: object) -> dict[str, Any]:
    """The object that is printed, without a word on standard error."""
    ran = diagnose(*arguments, "--json")
    assert (ran.exit_code, ran.stderr) == (0, "")
    (found,) = lines(ran)
    return found


@cache
def shown(path: Path, *options: str) -> str:
    """The text for one of the samples."""
    return done("diagnose", str(path), *options)


def written(folder: Path, session: Session, name: str = "readings.csv") -> tuple[Path, Path]:
    """Record and machine file of a session."""
    machine = folder / "machine.yaml"
    machine.write_text(truth.machine_yaml(session.machine, session.gauge), encoding="utf-8")
    return truth.write_readings(session, folder / name), machine
