"""`orthocal validate`."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from orthoglide_cal.cli.app import app

ROOT = Path(__file__).parents[2]
GOOD = str(ROOT / "sample_data" / "experiment2.csv")
MACHINE = str(ROOT / "configs" / "orthoglide_large.yaml")
BAD = "leg,posture,direction,reading_mm\nq,iso,y,0.1\nx,iso,x,\n"


def run(*args, stdin=None):
    return CliRunner().invoke(app, ["validate", *args], input=stdin)


@pytest.fixture
def bad(tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text(BAD)
    return str(path)


def test_fine_files():
    result = run(GOOD, MACHINE)
    assert result.exit_code == 0
    assert "6 differences, max − min, fine" in result.stdout
    assert "machine 'Orthoglide large', fine" in result.stdout


def test_all_faults_are_shown_in_lines_that_are_not_wrapped(bad):
    result = run(bad)
    assert result.exit_code == 3
    for words in (
        "bad.csv: 3 faults",
        "  line 2, column leg: This is not an axis. ('q')\n    → Write x, y or z.",
        "line 3, column direction",
        "line 3, column reading_mm",
    ):
        assert words in result.stdout
    Path(bad).write_text("difference,value_mm\nfoo,1\n")
    assert max(len(line) for line in run(bad).stdout.split("\n")) > 150
    Path(bad).write_text("leg,posture,direction,reading_mm,colour\nx,iso,y,0.1,red\n")
    result = run(bad)
    assert result.exit_code == 4
    assert "1 reading, which give no offsets" in result.stdout
    assert "note: Columns are not known and were not used: colour." in result.stdout
    Path(bad).write_text(Path(MACHINE).read_text().replace("420", "-420"))
    assert run(GOOD, "--machine", bad).exit_code == 3


def test_json_one_object_per_file_in_order(bad):
    result = run("--json", GOOD, bad, "/none/there", MACHINE, "-", stdin=BAD)
    assert result.exit_code == 3
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    good, wrong, missing, machine, stdin = lines
    assert good["valid"] is True
    assert good["problems"] == []
    assert good["input"]["path"] == GOOD
    assert good["input"]["kind"] == "six"
    assert wrong["valid"] is False
    assert wrong["problems"][0] == {
        "line": 2, "column": "leg", "value": "q", "what": "This is not an axis.",
        "remedy": "Write x, y or z.",
    }  # fmt: skip
    assert len(wrong["problems"]) == 3
    assert len(wrong["input"]["sha256"]) == 64
    assert missing["input"]["path"] == "/none/there"
    assert "no such file" in missing["error"]
    assert machine["input"]["kind"] == "machine"
    assert stdin["input"]["path"] == "-"
    assert stdin["problems"] == wrong["problems"]


def test_the_machine_decides_what_is_within_limits(tmp_path):
    path = tmp_path / "far.csv"
    path.write_text("leg,posture,direction,reading_mm\nx,85,y,0.1\n")
    assert run(str(path)).exit_code == 3
    assert run(str(path), "--machine", MACHINE).exit_code == 4
