"""`orthocal export`: one format at a time, refusals with their exit code."""

import shlex
from pathlib import Path

import pytest

from orthoglide_cal.files import machine_text
from tests.cli.program import SESSION, SIX, UNDETERMINED, lines, run
from tests.machines import NOMINAL


@pytest.fixture
def sound(tmp_path: Path) -> str:
    """A session with nothing wrong but its offsets."""
    path = tmp_path / "sound.csv"
    made = run("simulate", "--offsets", "0.4", "-0.3", "0.9", "--seed", "3", "--output", str(path))
    assert made.exit_code == 0
    return str(path)


@pytest.mark.parametrize(("path", "code"), [("missing.csv", 3), (SIX, 4)])
def test_json_gives_an_error_in_its_place(path: str, code: int) -> None:
    shown = run("export", path, "--json")
    assert shown.exit_code == code
    (answer,) = lines(shown)
    assert answer["input"]["path"] == path
    assert answer["error"]
    assert shown.stderr == ""
    plain = run("export", path)
    assert plain.exit_code == code
    assert plain.stdout == ""
    assert plain.stderr.strip()


@pytest.mark.parametrize("form", [(), ("--json",)])
def test_a_refusal_tells_the_command_with_the_files_given(
    form: tuple[str, ...], tmp_path: Path
) -> None:
    machine = tmp_path / "mine.yaml"
    machine.write_text(machine_text(NOMINAL), encoding="utf-8")
    shown = run("export", SESSION, "--machine", str(machine), *form)
    assert shown.exit_code == 4
    typed = shlex.join(
        ("orthocal", "diagnose", SESSION, "--machine", str(machine), "--accept", "axis_gap")
    )
    assert typed in (lines(shown)[0]["error"] if form else shown.stderr)


def test_json_beside_another_format_is_refused(sound: str) -> None:
    shown = run("export", sound, "--json", "--format", "table")
    assert shown.exit_code == 2
    assert "--json does not go with --format table" in shown.stderr


def test_what_must_not_be_used_is_marked_if_forced() -> None:
    refused = run("export", SIX)
    assert refused.exit_code == 4
    assert "Export refused." in refused.stderr
    assert "To export all the same, marked as forced: --force" in refused.stderr
    forced = run("export", SIX, "--force", "--format", "linuxcnc")
    assert forced.exit_code == 0
    assert "# FORCED: this result must not be used." in forced.stdout
    assert forced.stdout.count("HOME_OFFSET = ") == 3
    assert forced.stderr.startswith("FORCED: ")
    nothing = run("export", "-", "--force", text=UNDETERMINED)
    assert (nothing.exit_code, nothing.stdout) == (4, "")
    assert "--force" not in nothing.stderr
