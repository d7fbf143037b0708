"""`report`, `verify` and `export` from the command line: exit codes and files."""

from itertools import product
from pathlib import Path

import pytest

from tests.cli.program import SIX, UNDETERMINED, answer, done, refused, run
from tests.machines import NOMINAL
from tests.results import cases
from tests.results.sessions import FINE, TRUE, session, write


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("session") / "healthy.yaml"
    write(session(TRUE, 3), NOMINAL, path)
    return path


def test_report_takes_the_latest_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert run("report").exit_code == 3
    for day in (30, 10):
        path = tmp_path / f"session-{day}.yaml"
        write(session(TRUE, day), NOMINAL, path, finished=f"2026-01-{day}T09:30:00+00:00")
    found = answer("report")
    assert found["answer"]["input"]["path"] == "session-30.yaml"
    # Also beside the default method by its name, and in what is exported.
    number = found["identity"]["number"]
    assert answer("report", "--method", "readings")["identity"]["number"] == number
    assert number in run("export", "session-30.yaml").stdout


def test_report_files_are_not_replaced_unasked(healthy: Path, tmp_path: Path):
    html, text = tmp_path / "r.html", tmp_path / "r.md"
    found = run("report", healthy, "--html", html, "--markdown", text)
    assert found.exit_code == 0
    assert found.stdout == ""
    assert "written to" in found.stderr
    assert html.read_text().startswith("<!DOCTYPE html>")
    assert text.read_text().startswith("# Calibration report")
    assert "--overwrite" in refused(2, "report", healthy, "--html", html)
    notes = tmp_path / "notes.txt"
    notes.write_text("mine")
    for own, form in product((healthy, notes), ("--html", "--markdown")):
        kept = own.read_bytes()
        said = refused(2, "report", healthy, form, own, "--overwrite")
        assert "not a page that orthocal wrote" in said
        assert own.read_bytes() == kept
    assert run("report", healthy, "--html", html, "--overwrite").exit_code == 0
    assert run("report", healthy, "--html", "-").stdout.startswith("<!DOCTYPE html>")


def test_report_says_what_to_do_about_a_cause_that_moves_nothing(tmp_path: Path):
    wrong = tmp_path / "wrong.csv"
    run("simulate", "--cause", "misread=0.3", "--seed", 1, "--output", wrong)
    page = run("report", wrong).stdout
    assert "Nothing to enter" in page
    assert "Read again: leg x, direction y, iso, cycle 1 (reading 1)." in page


def test_report_as_left(healthy: Path, tmp_path: Path):
    after = tmp_path / "after.yaml"
    write(session(TRUE - TRUE, 4), NOMINAL, after)
    applied = ("--applied", *TRUE.tolist())
    found = answer("report", healthy, "--after", after, *applied)
    assert found["after"]["answer"] == "as modelled"
    page = run("report", healthy, "--after", after, *applied, "--limit", 0.05)
    assert "found  expected  as left" in page.stdout
    assert "Pass: limit 0.05 mm" in page.stdout
    assert "uncertainty of the offsets left adds up to 0.0" in page.stdout
    assert "Nothing more to do: keep this report with the machine." in page.stdout
    assert run("report", healthy, *applied).exit_code == 2
    # A limit is drawn, and decides nothing before the result is measured.
    limited = answer("report", healthy, "--limit", 0.1)
    assert (limited["limit_mm"], limited["after"]) == (0.1, None)
    # The map afterwards is that of the machine as it was measured then.
    errors = found["answer"]["workspace"], found["as_left"]["workspace"]
    assert errors[1]["before_mm"] < 0.1 * errors[0]["before_mm"]
    assert errors[1]["before_mm"] != errors[0]["after_mm"]


def test_export_table_needs_an_accepted_cause(healthy: Path, tmp_path: Path):
    assert run("export", healthy, "--format", "table").exit_code == 2
    gap = tmp_path / "gap.yaml"
    write(cases.named_in_machine().given.measured, FINE, gap)
    extended = tmp_path / "extended.yaml"
    accept = run("diagnose", gap, "--accept", "axis_gap", "--output", extended)
    assert accept.exit_code == 0, accept.stderr
    assert run("export", gap).exit_code == 4
    table = tmp_path / "table.csv"
    form = ("--format", "table", "--output", table)
    assert done("export", gap, "--machine", extended, *form) == ""
    assert len(table.read_text().splitlines()) == 1 + 7**3


def test_what_must_not_be_used_is_marked_if_forced() -> None:
    forced = run("export", SIX, "--force", "--format", "linuxcnc")
    assert forced.exit_code == 0
    assert "# FORCED: this result must not be used." in forced.stdout
    assert forced.stdout.count("HOME_OFFSET = ") == 3
    assert forced.stderr.startswith("FORCED: ")
    nothing = run("export", "-", "--force", text=UNDETERMINED)
    assert (nothing.exit_code, nothing.stdout) == (4, "")
    assert "--force" not in nothing.stderr
