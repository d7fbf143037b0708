"""`orthocal export`: one format at a time, refusals with their exit code."""

import shlex
from pathlib import Path

import pytest

from orthoglide_cal.files import machine_text
from tests.cli.program import DOUBLE, SESSION, SIX, UNDETERMINED, lines, refused, run
from tests.machines import NOMINAL


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


def test_json_beside_another_format_is_refused() -> None:
    said = refused(2, "export", DOUBLE, "--json", "--format", "table")
    assert "--json does not go with --format table" in said


def test_what_must_not_be_used_is_marked_if_forced() -> None:
    said = refused(4, "export", SIX)
    assert "Export refused." in said
    assert "To export all the same, marked as forced: --force" in said
    forced = run("export", SIX, "--force", "--format", "linuxcnc")
    assert forced.exit_code == 0
    assert "# FORCED: this result must not be used." in forced.stdout
    assert forced.stdout.count("HOME_OFFSET = ") == 3
    assert forced.stderr.startswith("FORCED: ")
    nothing = run("export", "-", "--force", text=UNDETERMINED)
    assert (nothing.exit_code, nothing.stdout) == (4, "")
    assert "--force" not in nothing.stderr
