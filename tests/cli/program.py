"""Running the program: inside this process where that is enough, as a process of its own else."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from orthoglide_cal.cli.app import app
from tests.machines import ROOT

SAMPLES = ROOT / "sample_data"
SIX = str(SAMPLES / "experiment2.csv")
DOUBLE = str(SAMPLES / "double_posture_session.csv")
SINGLE = str(SAMPLES / "single_posture_session.csv")
SESSION = str(SAMPLES / "session.yaml")
UNDETERMINED = "difference,value_mm\ndx_y,0.1\ndy_x,0.2\n"


def run(*arguments: str, text: str = "") -> Result:
    """One command in this process; `text` is its standard input."""
    return CliRunner().invoke(app, list(arguments), input=text)


def done(*arguments: str, text: str = "") -> str:
    """Standard output of a command that succeeds."""
    result = run(*arguments, text=text)
    assert result.exit_code == 0, result.output
    return result.stdout


def refused(code: int, *arguments: str, text: str = "") -> str:
    """What is said by a command that gives nothing but an exit code; without breaks of lines."""
    result = run(*arguments, text=text)
    assert (result.exit_code, result.stdout) == (code, ""), result.output
    return words(result.stderr)


def lines(result: Result) -> list[dict[str, Any]]:
    """The JSON objects on standard output, one per line; NaN and Infinity are refused."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    return [json.loads(line, parse_constant=refuse) for line in result.stdout.splitlines()]


def answer(*arguments: str, text: str = "") -> dict[str, Any]:
    """The JSON object that one command prints about one file."""
    (found,) = lines(run(*arguments, "--json", text=text))
    return found


def parameters(found: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The parameters of an answer by their names."""
    return {each["name"]: each for each in found["parameters"]}


def words(text: str) -> str:
    """What is said, without the breaks of its lines."""
    return " ".join(text.replace("│", " ").split())


def process(
    *arguments: str, text: str = "", environment: dict[str, str] | None = None, cwd: Path = ROOT
) -> subprocess.CompletedProcess[str]:
    """One command as a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "orthoglide_cal", *arguments],
        input=text,
        capture_output=True,
        text=True,
        encoding="utf-8",
        env={**os.environ, **(environment or {})},
        cwd=cwd,
        timeout=120,
        check=False,
    )


def modules_after(*arguments: str) -> set[str]:
    """Modules that a command leaves loaded."""
    script = (
        "import sys\n"
        f"sys.argv = {['orthocal', *arguments]!r}\n"
        "from orthoglide_cal.cli import main\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code, end.code\n"
        "print('\\n'.join(sys.modules), file=sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=120,
        check=True,
    )
    return set(done.stderr.split())
