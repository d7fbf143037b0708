"""Running the program inside this process."""

import functools
import json
import shlex
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from orthoglide_cal.cli.app import app
from tests import truth
from tests.machines import ROOT, SAMPLES

SIX = str(SAMPLES / "experiment2.csv")
DOUBLE = str(SAMPLES / "double_posture_session.csv")
SINGLE = str(SAMPLES / "single_posture_session.csv")
SESSION = str(SAMPLES / "session.yaml")
FILES = {
    "SIX": SIX, "DOUBLE": DOUBLE, "SINGLE": SINGLE, "SESSION": SESSION, "LONG": "a" * 300,
    "EXPERIMENT1": str(SAMPLES / "experiment1.csv"),
    "EXPERIMENT3": str(SAMPLES / "experiment3.csv"),
    "PRINTER": str(ROOT / "configs" / "linear_delta.yaml"),
    "PROTOTYPE": str(ROOT / "configs" / "orthoglide_prototype.yaml"),
    "LARGE": str(ROOT / "configs" / "orthoglide_large.yaml"),
}  # fmt: skip
READINGS, MACHINE = "my readings.csv", "my machine.yaml"
COMMENT = "# of the foundry, not to be lost\n"
FIRST = truth.make_session(31, truth.LARGE, truth.MICRON)
UNDETERMINED = "difference,value_mm\ndx_y,0.1\ndy_x,0.2\n"


def run(*arguments: object, text: str = "") -> Result:
    """One command in this process; `text` is its standard input."""
    return CliRunner().invoke(app, [*map(str, arguments)], input=text)


@functools.cache
def once(*arguments: object) -> Result:
    """What a command shows that no test changes anything for."""
    return run(*arguments)


def done(*arguments: object, text: str = "") -> str:
    """Standard output of a command that succeeds."""
    result = run(*arguments, text=text)
    assert result.exit_code == 0, result.output
    return result.stdout


def refused(code: int, *arguments: object) -> str:
    """What is said by a command that gives nothing but an exit code; without breaks of lines."""
    result = run(*arguments)
    said, nothing = result.stderr, result.stdout
    if "--json" in arguments:
        said, nothing = lines(result)[0]["error"], said
    assert (result.exit_code, nothing) == (code, ""), result.output
    return words(said)


def lines(result: Result) -> list[dict[str, Any]]:
    """The JSON objects on standard output, one per line; NaN and Infinity are refused."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    return [json.loads(line, parse_constant=refuse) for line in result.stdout.splitlines()]


def answer(*arguments: object, text: str = "") -> dict[str, Any]:
    """The JSON object that one command prints about one file."""
    (found,) = lines(run(*arguments, "--json", text=text))
    return found


def parameters(found: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The parameters of an answer by their names."""
    return {parameter["name"]: parameter for parameter in found["parameters"]}


def words(text: str) -> str:
    return " ".join(text.replace("│", " ").split())


def worded(command: str) -> list[str]:
    """The words of a command; those in capitals stand for files that ship."""
    return [FILES.get(word, word) for word in shlex.split(command)]


def refusals(table: Path) -> list[str]:
    """Lines of a table of commands: exit code, command, what is said (see the tables)."""
    lines = table.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def holds(said: str, parts: list[str]) -> None:
    """Assert that a text has these parts, and not those behind "not:"."""
    for part in parts:
        text = part.removeprefix("not:")
        assert (text in said) == (text == part), f"{part}\n{said}"


def tells(line: str) -> None:
    """Assert one of them that prints something: its screen, whatever else it does."""
    code, command, *parts = map(str.strip, line.split("|"))
    shown = once(*worded(command))
    assert shown.exit_code == int(code), shown.output
    holds(words(shown.stdout), parts)


def refuses(line: str, *before: str) -> None:
    """Assert one of them, plainly and as JSON; `before` are the first words of the command."""
    code, command, path, *parts = map(str.strip, line.split("|"))
    typed = [*before, *worded(command)]
    said = refused(int(code), *typed)
    holds(said, parts)
    assert "Input should" not in said, "no words of a library"
    if path != "?":
        result, path = run(*typed, "--json"), FILES.get(path, path)
        assert (result.exit_code, result.stderr) == (int(code), "")
        (told,) = lines(result)
        assert told["input"] == ({"path": path} if path else None)
        error = words(told["error"])
        assert said in (error, f"{path}: {error}")


def written(session: truth.Session) -> tuple[str, ...]:
    """A session of the truth and its machine in the present folder; its arguments."""
    written_in(Path(), session, READINGS, MACHINE)
    return READINGS, "--machine", MACHINE


def written_in(
    folder: Path, session: truth.Session, name: str = "readings.csv", machine: str = "machine.yaml"
) -> tuple[Path, Path]:
    """Record and machine file of a session of the truth."""
    text = truth.machine_yaml(session.machine, session.gauge)
    (folder / machine).write_text(text, encoding="utf-8")
    return truth.write_readings(session, folder / name), folder / machine


def as_measured(name: str) -> None:
    """Take out of a simulated table that it is simulated: what no machine would take, one may."""
    path = Path(name)
    path.write_text(path.read_text(encoding="utf-8").replace("yes", ""), encoding="utf-8")
