"""What read_input gives beside the readings, the sessions of a folder, and `orthocal validate`."""

import json
import os
import re
from datetime import UTC, datetime
from pathlib import Path

import pytest

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.input import check_file, read_input, sessions_in
from orthoglide_cal.files.machine_file import machine_text
from orthoglide_cal.files.readings import Conditions, GaugeIdentity, Session, session_text
from tests.cli.program import SESSION, SIX, run
from tests.machines import ROOT

from .helpers import MODEL

READINGS = [{"leg": "x", "posture": "iso", "direction": "y", "reading_mm": 0.1}]


def write(folder, name, **given):
    session = Session(machine=MODEL, readings=READINGS, **given)
    (folder / name).write_text(session_text(session))


def test_the_conditions_of_a_table_are_those_of_its_columns(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text(
        "leg,posture,direction,reading_mm,temperature_c,gauge,note\n"
        "x,iso,y,0.1,21.5,B,\nx,max,y,0.2,,A,shaken\nx,min,y,0.3,20.25,B,\n"
    )
    given = read_input(str(path))
    assert not given.is_session
    assert given.model is MODEL
    assert given.conditions == Conditions(
        temperature_c=(21.5, 20.25),
        gauges=(GaugeIdentity(id="B"), GaugeIdentity(id="A")),
        notes=((3, "shaken"),),
    )


def test_the_latest_session_by_content_and_time(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "no session" in run("report").output
    with pytest.raises(InputError, match="no such folder"):
        sessions_in(tmp_path / "nowhere")
    write(tmp_path, "old.yaml", started="2025-05-01T10:00:00+00:00")
    write(
        tmp_path, "new.yaml",
        started="2025-04-01T10:00:00+00:00", finished="2025-06-01T10:00:00+00:00",
    )  # fmt: skip
    write(tmp_path, "undated.yml")
    (tmp_path / "machine.yaml").write_text(machine_text(MODEL))
    (tmp_path / "broken.yaml").write_bytes(b"machine:\nreadings:\n\0")
    (tmp_path / "folder.yaml").mkdir()
    for year, order in (
        (2020, ["undated.yml", "old.yaml", "new.yaml"]),
        (2030, ["old.yaml", "new.yaml", "undated.yml"]),
    ):
        os.utime(tmp_path / "undated.yml", (datetime(year, 1, 1, tzinfo=UTC).timestamp(),) * 2)
        found = sessions_in(tmp_path)
        assert [path.name for path in found] == order


def test_a_machine_file_that_lacks_its_first_key_is_still_checked_as_one(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(machine_text(MODEL).replace("leg_length_mm", "leg_lenght_mm"))
    check, _ = check_file(str(path))
    assert check.input.kind is check.machine is None
    assert [problem.column for problem in check.problems] == ["leg_length_mm", "leg_lenght_mm"]


# --- `orthocal validate` -----------------------------------------------------------------------

LARGE = str(ROOT / "configs" / "orthoglide_large.yaml")
BAD = "leg,posture,direction,reading_mm\nq,iso,y,0.1\nx,iso,x,\n"


@pytest.fixture
def bad(tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text(BAD)
    return str(path)


def test_fine_files():
    result = run("validate", SIX, LARGE)
    assert result.exit_code == 0
    assert "6 differences, max − min, fine" in result.stdout
    assert "machine 'Orthoglide large', fine" in result.stdout


def test_a_file_of_an_implausible_gauge_is_not_called_fine(tmp_path):
    text = Path(LARGE).read_text(encoding="utf-8")
    path = tmp_path / "machine.yaml"
    path.write_text(re.sub("repeatability_mm: .*", "repeatability_mm: 6", text), encoding="utf-8")
    result = run("validate", str(path), SIX, "--machine", str(path))
    assert result.exit_code == 0
    assert result.stdout.count(", no fault, but see the notes") == 2
    assert "fine" not in result.stdout


def test_all_faults_are_shown_in_lines_that_are_not_wrapped(bad):
    result = run("validate", bad)
    assert result.exit_code == 3
    for words in (
        "bad.csv: 3 faults",
        "  line 2, column leg: This is not an axis. ('q')\n    → Write x, y or z.",
        "line 3, column direction",
        "line 3, column reading_mm",
    ):
        assert words in result.stdout
    Path(bad).write_text("difference,value_mm\nfoo,1\n")
    assert max(len(line) for line in run("validate", bad).stdout.split("\n")) > 150
    Path(bad).write_text("leg,posture,direction,reading_mm,colour\nx,iso,y,0.1,red\n")
    result = run("validate", bad)
    assert result.exit_code == 4
    assert "1 reading, which give no offsets" in result.stdout
    assert "note: Columns are not known and were not used: colour." in result.stdout
    Path(bad).write_text(Path(LARGE).read_text().replace("420", "-420"))
    assert run("validate", SIX, "--machine", bad).exit_code == 3


def test_json_one_object_per_file_in_order(bad):
    result = run("validate", "--json", SIX, bad, "/none/there", LARGE, SESSION, "-", text=BAD)
    assert result.exit_code == 3
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    good, wrong, missing, machine, session, stdin = lines
    assert good["valid"] is True
    assert good["problems"] == []
    assert good["input"]["path"] == SIX
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
    assert machine["machine"] == "Orthoglide large"
    assert (session["input"]["kind"], session["input"]["readings"]) == ("session", 60)
    assert stdin["input"]["path"] == "-"
    assert stdin["problems"] == wrong["problems"]
