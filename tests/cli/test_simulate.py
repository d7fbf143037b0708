"""`orthocal simulate`: synthetic sessions that every other command can read."""

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml

from orthoglide_cal.files.input import read_input
from orthoglide_cal.model.measured import Readings
from tests.cli.program import DOUBLE, SAMPLES, SESSION, SINGLE, lines, refused, run
from tests.machines import LARGE, NOMINAL, NOMINAL_LARGE, ROOT

LARGE_FILE = str(ROOT / "configs" / "orthoglide_large.yaml")
CAUSES = (
    "axis_gap=0.1,0.2,-0.1", "axis_squareness=1,-1,0.5", "leg_length=0.01,0,-0.02",
    "encoder_scale=1,-1,2", "backlash=0.02,0.01,0.03", "thermal_drift=0.05,0.1,-0.1",
    "bar_skew=1,2,-1,0.5,0.2,-2", "gauge_drift=0.05", "stand_shift=0.1", "gauge_slip=1",
    "gauge_slip=-1", "misread=0.1", "sign_flip", "swapped_gauges", "exchanged_columns",
)  # fmt: skip


def session(*arguments: str) -> Readings:
    shown = run("simulate", "--seed", "5", *arguments)
    assert shown.exit_code == 0, shown.stderr
    path = Path("session.csv")
    path.write_text(shown.stdout, encoding="utf-8")
    return read_input(str(path), NOMINAL).measured


def test_the_seed_decides_and_is_told() -> None:
    shown = run("simulate")
    seed = shown.stderr.split()[-1]
    assert shown.stderr == f"seed {seed}\n"
    assert run("simulate", "--seed", seed).stdout == shown.stdout
    assert run("simulate", "--seed", "4").stdout != shown.stdout


def test_every_cause_changes_the_readings_and_a_placed_one_nowhere_else() -> None:
    """By more than zeros of the gauges, and by themselves, would."""
    exact = ("--noise", "0", "--resolution", "0", "--offsets", "0.5", "-0.4", "0.3")
    healthy = session(*exact)
    zeros = np.stack([healthy.plan.setup == k for k in range(6)]).astype(float)
    zeros /= zeros.sum(axis=1, keepdims=True)

    def change(*causes: str) -> np.ndarray:
        given = [word for cause in causes for word in ("--cause", cause)]
        return session(*exact, *given).value - healthy.value

    for cause in CAUSES:
        changed = change(cause)
        assert np.abs(changed - (zeros @ changed)[healthy.plan.setup]).max() > 1e-4, cause

    shown = run("simulate", "--seed", "5", "--cause", "misread=0.1").stderr
    assert shown.startswith("misread: leg ")
    row = int(shown.split("(reading ")[1].rstrip(")\n"))
    assert (np.flatnonzero(np.abs(change("misread=0.1")) > 1e-6) + 1).tolist() == [row]


def test_output_is_written_but_never_over_a_file(tmp_path: Path) -> None:
    target = tmp_path / "made.csv"
    shown = run("simulate", "--seed", "3", "--output", str(target))
    assert shown.exit_code == 0
    assert shown.stdout == ""
    assert str(target) in shown.stderr
    written = target.read_text(encoding="utf-8")
    assert written == run("simulate", "--seed", "3").stdout
    assert "is not overwritten" in refused(2, "simulate", "--output", str(target))
    # Nor is the JSON of a file shown that was not written.
    (found,) = lines(run("simulate", "--seed", "4", "--json", "--output", str(target)))
    assert list(found) == ["input", "error"]
    assert target.read_text(encoding="utf-8") == written


@pytest.mark.parametrize("form", ["yaml", "json"])
def test_a_session_holds_the_machine_and_the_same_readings(form: str) -> None:
    arguments = ("simulate", "--seed", "3", "--machine", LARGE_FILE, "--cycles", "2")
    plain, target = run(*arguments, "--gauge-at", "0.4").stdout, Path(f"made.{form}")
    as_session = ("--output", str(target)) if form == "yaml" else ("--json",)
    shown = run(*arguments, "--gauge-at", "0.4", *as_session)
    assert shown.exit_code == 0
    if form == "json":
        assert lines(shown)[0]["environment"]["source"] == "simulated, seed 3"
        target.write_text(shown.stdout, encoding="utf-8")
    Path("made.csv").write_text(plain, encoding="utf-8")
    made, table = read_input(str(target)), read_input("made.csv", NOMINAL_LARGE).measured
    assert made.model.machine == LARGE
    assert np.array_equal(made.measured.value, table.value)
    assert len(table) == 6 * (3 * 2 + 1)
    assert set(table.plan.gauge_at.tolist()) == {0.4}
    assert np.array_equal(made.measured.plan.setup, table.plan.setup)
    assert made.measured.plan.hours == pytest.approx(table.plan.hours, abs=1e-9)
    told = made.conditions
    assert (told.protocol, told.operator, told.started) == ("double-posture", None, None)


def test_the_sample_sessions_are_what_their_readme_says(tmp_path: Path) -> None:
    text = (SAMPLES / "README.md").read_text(encoding="utf-8")
    commands = [line.split() for line in text.splitlines() if line.startswith("orthocal simulate")]
    assert len(commands) == 3
    for command in commands:
        assert run(*command[1:]).exit_code == 0
    for file in (DOUBLE, SINGLE):
        texts = ((tmp_path / Path(file).name).read_text("utf-8"), Path(file).read_text("utf-8"))
        made, kept = (list(csv.DictReader(text.splitlines())) for text in texts)
        assert [row.pop("simulated") for row in made] == ["yes"] * len(kept)
        assert made == kept
    made, kept = (
        yaml.safe_load(Path(file).read_text()) for file in (tmp_path / "session.yaml", SESSION)
    )
    assert [row.pop("simulated") for row in made["readings"]] == ["yes"] * 60
    assert made["readings"] == kept["readings"]
