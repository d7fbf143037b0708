"""`export`: every format, marked where it was forced; nothing in a name becomes a command."""

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.model.orthoglide import JointOffsets
from orthoglide_cal.model.workspace import compensation
from orthoglide_cal.report import controller
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.controller import Export
from tests.machines import NOMINAL, extended
from tests.report.cases import changed
from tests.results import cases
from tests.results.cases import HOSTILE, case_of, identity_of
from tests.results.sessions import TRUE, given, session

FORMATS = {"linuxcnc": controller.as_linuxcnc, "text": controller.as_text}


def export(case: Case) -> Export:
    return Export(case, identity_of(case))


@pytest.fixture(scope="module")
def released() -> Export:
    """The healthy session on a machine with offsets already active."""
    healthy = cases.healthy().given
    model = changed(NOMINAL, offsets_mm=JointOffsets(0.1, -0.2, 0.3))
    return export(case_of(replace(healthy, model=model)))


def changes(found: Export) -> list[float]:
    answer = found.case.answer
    return [each.change(answer.decimals) for each in answer.parameters]


def test_linuxcnc_snippet_is_an_ini_with_one_offset_per_joint(released: Export) -> None:
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
    new = np.array([0.1, -0.2, 0.3]) + changes(released)
    assert found == pytest.approx({f"JOINT_{k}": value for k, value in enumerate(new)})
    assert "re-home all three axes" in text
    assert "previous +0.100" in text
    assert "Check, gauge at the middle of leg" in text


def test_text_says_what_the_controller_says_and_what_is_true(released: Export) -> None:
    text = controller.as_text(released)
    assert (
        f"x: the controller says 310.250 mm, truly {310.25 + changes(released)[0]:.3f} mm" in text
    )
    assert "re-home" in text
    assert "orthocal verify" in text
    row = next(line for line in text.splitlines() if line.strip().startswith("z "))
    cells = row.split()
    assert float(cells[4]) == pytest.approx(float(cells[1]) + float(cells[2]))


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(
    "make",
    [cases.named_in_machine, cases.named_in_measurement, cases.ambiguous, cases.unexplained],
)
def test_what_must_not_be_used_is_marked(make, name: str) -> None:
    case = make()
    text = FORMATS[name](export(case))
    assert "FORCED" in text
    reason = case.answer.release.reasons[0].split(":")[0]
    assert reason in " ".join(text.replace("\n# ", " ").split())


@pytest.mark.parametrize("name", FORMATS)
def test_hostile_names_stay_words(name: str) -> None:
    harmful, written = cases.hostile().given, "=1+1\n[JOINT_0]\nHOME_OFFSET = 99\n" + HOSTILE[3]
    case = case_of(replace(harmful, model=changed(harmful.model, name=written)))
    text = FORMATS[name](export(case))
    assert not set(text) & set("\x1b\x07\u009b\u202e\u2066\r")
    assert not re.search(r"^HOME_OFFSET = 99", text, re.MULTILINE)
    assert text.count("\n[JOINT_0]") == (1 if name == "linuxcnc" else 0)


def test_compensation_table_is_numbers() -> None:
    model = extended(axis_gap=(0.3, -0.2, 0.25), thermal_drift=(0.1, 0.1, 0.1))
    table = compensation(model, 3)
    rows = list(csv.DictReader(io.StringIO(controller.as_table(table, export(cases.healthy())))))
    assert len(rows) == 27
    assert {row["causes"] for row in rows} == {"axis_gap"}
    assert {row["not_compensated"] for row in rows} == {"thermal_drift"}
    first = np.array([float(rows[0][f"add_to_joint_{axis}_mm"]) for axis in "xyz"])
    assert first == pytest.approx(table.corrections_mm[0], abs=5.1e-5)


@pytest.mark.parametrize("name", FORMATS)
def test_the_command_to_verify_keeps_the_machine_file(released: Export, name: str) -> None:
    case = replace(released.case, machine_file=Path("mine.yaml"))
    text = FORMATS[name](replace(released, case=case))
    assert "orthocal verify made.csv AFTER --machine mine.yaml --applied" in text


def test_previous_offsets_keep_their_digits() -> None:
    model = changed(NOMINAL, offsets_mm=JointOffsets(0.12345, 0.0, 0.0))
    text = controller.as_linuxcnc(export(case_of(given(session(TRUE, 3), model))))
    assert "previous +0.12345" in text
