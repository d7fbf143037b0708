"""`report`, `verify` and `export` from the command line: exit codes and files."""

import json
from itertools import product
from pathlib import Path

import pytest

from tests.cli.program import SIX, UNDETERMINED, done, refused, run
from tests.machines import NOMINAL, SAMPLES
from tests.results import cases
from tests.results.sessions import FINE, TRUE, session, write

EXPERIMENTS = [str(SAMPLES / f"experiment{k}.csv") for k in (1, 2, 3)]


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("session") / "healthy.yaml"
    write(session(TRUE, 3), NOMINAL, path)
    return path


def test_report_takes_the_latest_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for day in (30, 10, 20):
        path = tmp_path / f"session-{day}.yaml"
        write(session(TRUE, day), NOMINAL, path, finished=f"2026-01-{day}T09:30:00+00:00")
    monkeypatch.chdir(tmp_path)
    found = run("report", "--json")
    assert json.loads(found.stdout)["answer"]["input"]["path"] == "session-30.yaml"
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    assert run("report").exit_code == 3


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


def test_report_as_left(healthy: Path, tmp_path: Path):
    after = tmp_path / "after.yaml"
    write(session(TRUE - TRUE, 4), NOMINAL, after)
    applied = ("--applied", *TRUE.tolist())
    found = json.loads(run("report", healthy, "--json", "--after", after, *applied).stdout)
    assert found["after"]["answer"] == "as modelled"
    page = run("report", healthy, "--after", after, *applied, "--limit", 0.05)
    assert "found  expected  as left" in page.stdout
    assert "Pass: limit 0.05 mm" in page.stdout
    assert "The correction worked as predicted" in page.stdout
    assert "Nothing more: keep this report with the machine." in page.stdout
    assert run("report", healthy, *applied).exit_code == 2
    # A limit is drawn, and decides nothing before the result is measured.
    limited = json.loads(run("report", healthy, "--limit", 0.1, "--json").stdout)
    assert (limited["limit_mm"], limited["after"]) == (0.1, None)
    # The map afterwards is that of the machine as it was measured then.
    errors = found["answer"]["workspace"], found["after"]["workspace"]
    assert errors[1]["before_mm"] < 0.1 * errors[0]["before_mm"]
    assert errors[1]["before_mm"] != errors[0]["after_mm"]


def test_the_same_inputs_and_options_give_the_same_number(healthy: Path, tmp_path: Path):
    numbers = [json.loads(run(*command, "--json").stdout)["identity"]["number"] for command in (
        ("report", healthy), ("report", healthy), ("report", healthy, "--method", "readings"),
        ("report", healthy, "--method", "six"),
    )]  # fmt: skip
    assert numbers[0] == numbers[1] == numbers[2] != numbers[3]
    assert numbers[0] in run("export", healthy).stdout


def test_verify_prints_what_the_paper_prints():
    """Predicted 0.20, measured 0.21, and a response that agrees with the model."""
    applied = ("--applied", -0.53, 0.59, -1.76)
    found = done("verify", *EXPERIMENTS[1:], *applied)
    assert "Predicted 0.20 mm, measured 0.21 mm (r.m.s.; before 0.62 mm)." in found
    assert "The machine moved by 1.03 [0.91, 1.14] times what was entered, as modelled." in found

    numbers = json.loads(run("verify", *EXPERIMENTS[1:], *applied, "--json").stdout)
    assert numbers["response"]["agrees"] is True
    assert numbers["decision"] is None
    page = run("verify", *EXPERIMENTS[1:], *applied, "--html", "-", "--limit", 0.36)
    assert "Decision rule: Pass if |deviation| + U is within the limit" in page.stdout


@pytest.mark.parametrize("form", ["text", "linuxcnc"])
def test_export_formats(healthy: Path, form: str, tmp_path: Path):
    found = done("export", healthy, "--format", form)
    assert "-0.5" in found
    target = tmp_path / "offsets"
    assert run("export", healthy, "--format", form, "--output", target).exit_code == 0
    assert len(target.read_text()) == pytest.approx(len(found), abs=3)
    assert run("export", healthy, "--format", form, "--output", target).exit_code == 2


def test_export_table_needs_an_accepted_cause(healthy: Path, tmp_path: Path):
    assert run("export", healthy, "--format", "table").exit_code == 2
    gap = tmp_path / "gap.yaml"
    write(cases.named_in_machine().given.measured, FINE, gap)
    extended = tmp_path / "extended.yaml"
    accept = run("diagnose", gap, "--accept", "axis_gap", "--output", extended)
    assert accept.exit_code == 0, accept.stderr
    assert run("export", gap).exit_code == 4
    table = run("export", gap, "--machine", extended, "--format", "table", "--points", 2)
    assert table.exit_code == 0, table.stderr
    assert len(table.stdout.splitlines()) == 9


def test_what_must_not_be_used_is_marked_if_forced() -> None:
    said = refused(4, "export", SIX)
    assert "Export refused." in said
    assert "To export it anyway, marked as FORCED: --force" in said
    forced = run("export", SIX, "--force", "--format", "linuxcnc")
    assert forced.exit_code == 0
    assert "# FORCED: this result must not be used." in forced.stdout
    assert forced.stdout.count("HOME_OFFSET = ") == 3
    assert forced.stderr.startswith("FORCED: ")
    nothing = run("export", "-", "--force", text=UNDETERMINED)
    assert (nothing.exit_code, nothing.stdout) == (4, "")
    assert "--force" not in nothing.stderr
