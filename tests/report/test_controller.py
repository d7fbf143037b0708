"""`export`: every format, refused where it must be, marked where it was forced."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.model.workspace import compensation
from orthoglide_cal.report import controller
from orthoglide_cal.results import calibrate, export
from tests.machines import NOMINAL, extended
from tests.report.cases import changed
from tests.results import cases
from tests.results.cases import HOSTILE
from tests.results.sessions import TRUE, given, session

FORMATS = {
    "linuxcnc": controller.as_linuxcnc,
    "text": controller.as_text,
    "csv": controller.as_csv,
    "json": controller.as_json,
    "yaml": controller.as_yaml,
}


@pytest.fixture(scope="module")
def released():
    """The healthy session on a machine with offsets already active."""
    healthy = cases.healthy().input
    model = changed(healthy.model, offsets_mm=(0.1, -0.2, 0.3))
    return export(calibrate(replace(healthy, model=model), issued=cases.ISSUED))


def test_linuxcnc_snippet_is_an_ini_with_one_offset_per_joint(released):
    """Read back as LinuxCNC would: sections, keys, "#" comments."""
    text = controller.as_linuxcnc(released)
    section, found = "", {}
    for line in text.splitlines():
        if not line or line.startswith("#"):
            continue
        if header := re.fullmatch(r"\[(JOINT_\d)\]", line):
            section = header[1]
        else:
            key, value = re.fullmatch(r"(\w+) = (-?\d+\.\d+)", line).groups()
            assert key == "HOME_OFFSET"
            found[section] = float(value)
    change = released.adjustment.applied_mm
    assert found == pytest.approx(
        {"JOINT_0": 0.1 + change[0], "JOINT_1": -0.2 + change[1], "JOINT_2": 0.3 + change[2]}
    )
    assert "re-home all three axes" in text
    assert "previous +0.100" in text
    assert "Check: put the gauge" in text


def test_text_says_what_the_controller_says_and_what_is_true(released):
    text = controller.as_text(released)
    change = released.adjustment.applied_mm[0]
    assert f"x: the controller says 310.250 mm, truly {310.25 + change:.3f} mm" in text
    assert "re-home" in text
    assert "orthocal verify" in text
    row = next(line for line in text.splitlines() if line.strip().startswith("z "))
    cells = row.split()
    assert float(cells[4]) == pytest.approx(float(cells[1]) + float(cells[2]))


def test_csv_is_numbers_and_harmless_words(released):
    rows = list(csv.DictReader(io.StringIO(controller.as_csv(released))))
    assert [row["axis"] for row in rows] == ["x", "y", "z"]
    for row, joint in zip(rows, released.adjustment.joints, strict=True):
        assert float(row["new_mm"]) == pytest.approx(joint.new_mm)
        assert float(row["new_mm"]) == pytest.approx(
            float(row["previous_mm"]) + float(row["change_mm"])
        )
        assert row["status"] == "released"


def test_json_and_yaml_hold_the_same(released):
    one, other = (
        json.loads(controller.as_json(released)),
        yaml.safe_load(controller.as_yaml(released)),
    )
    assert one == other
    assert one["forced"] is False
    assert one["rehome"] is True
    assert one["joints"]["y"]["previous_mm"] == -0.2
    assert one["check"]["leg"] == "x"


@pytest.mark.parametrize(
    "make",
    [cases.named_in_machine, cases.named_in_measurement, cases.ambiguous, cases.unexplained],
)
def test_what_must_not_be_used_is_refused_and_marked_if_forced(make):
    calibration = make()
    with pytest.raises(UnusableResultError, match="Export refused") as refused:
        export(calibration)
    assert refused.value.exit_code == 4
    assert "--force" in refused.value.remedy
    assert calibration.release.reasons[0] in str(refused.value)
    forced = export(calibration, force=True)
    for name, write in FORMATS.items():
        assert "FORCED" in write(forced), name
        assert calibration.release.reasons[0].split(":")[0] in " ".join(
            write(forced).replace("\n# ", " ").split()
        )
    assert json.loads(controller.as_json(forced))["forced"] is True
    assert controller.as_yaml(forced).startswith("# FORCED")


def test_nothing_can_be_forced_out_of_no_result():
    with pytest.raises(UnusableResultError, match="do not determine") as refused:
        export(cases.failed(), force=True)
    assert "--force" not in refused.value.remedy


@pytest.mark.parametrize("name", FORMATS)
def test_hostile_names_stay_words(name):
    harmful, written = cases.hostile().input, "=1+1\n[JOINT_0]\nHOME_OFFSET = 99\n" + HOSTILE[3]
    released = export(calibrate(replace(harmful, model=changed(harmful.model, name=written))))
    text = FORMATS[name](released)
    assert not set(text) & set("\x1b\x07\u009b\u202e\u2066\r")
    if name in ("json", "yaml"):
        value = (json.loads if name == "json" else yaml.safe_load)(text)
        assert value["machine"] == written
    else:
        assert not re.search(r"^HOME_OFFSET = 99", text, re.MULTILINE)
        assert text.count("\n[JOINT_0]") == (1 if name == "linuxcnc" else 0)
    if name == "csv":
        for row in csv.reader(io.StringIO(text)):
            for cell in row[6:]:
                assert not cell.startswith(("=", "+", "-", "@", "\t"))
        assert "'=1+1" in text


def test_compensation_table_is_numbers():
    model = extended(axis_gap=(0.3, -0.2, 0.25), thermal_drift=(0.1, 0.1, 0.1))
    table = compensation(model, 3)
    text = controller.as_table(table, export(cases.healthy()))
    rows = list(csv.DictReader(io.StringIO(text)))
    assert len(rows) == 27
    assert {row["causes"] for row in rows} == {"axis_gap"}
    assert {row["not_compensated"] for row in rows} == {"thermal_drift"}
    first = np.array([float(rows[0][f"add_to_joint_{axis}_mm"]) for axis in "xyz"])
    assert first == pytest.approx(table.corrections_mm[0], abs=5.1e-5)


@pytest.mark.parametrize("name", sorted(FORMATS.keys() - {"csv"}))
def test_the_command_to_verify_keeps_the_machine_file(released, name):
    text = FORMATS[name](released, Path("mine.yaml"))
    assert "orthocal verify made.csv AFTER --machine mine.yaml --applied" in text


def test_previous_offsets_keep_their_digits():
    model = changed(NOMINAL, offsets_mm=(0.12345, 0.0, 0.0))
    released = export(calibrate(given(session(TRUE, 3), model)))
    assert "previous +0.12345" in controller.as_linuxcnc(released)
