"""`export`: every format, marked where it was forced; nothing in a name becomes a command."""

import csv
import io
import re
from configparser import ConfigParser
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.machine_file import read_machine_file
from orthoglide_cal.model.model import Effect
from orthoglide_cal.model.orthoglide import JointOffsets
from orthoglide_cal.model.workspace import compensation
from orthoglide_cal.report import controller
from orthoglide_cal.report.case import Case
from orthoglide_cal.results.answer import Identity
from tests.machines import NOMINAL, extended
from tests.printer_files import OFF, exact
from tests.report.cases import changed
from tests.results import cases
from tests.results.cases import HOSTILE, case_of, identity_of
from tests.truth.delta import V400, Layout, Truth, delta_yaml, tool
from tests.truth.forward import tool_from_carriages

VERIFY = "orthocal verify made.csv AFTER --machine mine.yaml --applied"
FORMATS = {name: partial(controller.exported, name) for name in ("linuxcnc", "text")}


def export(case: Case) -> tuple[Case, Identity]:
    return case, identity_of(case)


@pytest.fixture(scope="module")
def released() -> Case:
    """The healthy session on a machine, of a file, with offsets already active."""
    healthy = cases.healthy().given
    model = changed(NOMINAL, offsets_mm=JointOffsets(0.12345, -0.2, 0.3))
    return case_of(replace(healthy, model=model, machine_file=Path("mine.yaml")))


def sections(text: str) -> ConfigParser:
    """Sections of an ini file, with "#" comments."""
    found = ConfigParser(delimiters="=", comment_prefixes="#", interpolation=None)
    found.read_string(text)
    return found


def changes(found: Case) -> list[float]:
    answer = found.answer
    return [each.change(answer.decimals) for each in answer.parameters]


def test_linuxcnc_snippet_is_an_ini_with_one_offset_per_joint(released: Case) -> None:
    """Read back as LinuxCNC would: sections, keys, "#" comments."""
    text = FORMATS["linuxcnc"](*export(released))
    settings = sections(text)
    found = [float(settings[f"JOINT_{k}"]["HOME_OFFSET"]) for k in range(3)]
    assert found == pytest.approx(np.array([0.12345, -0.2, 0.3]) + changes(released))
    assert [len(settings[name]) for name in settings.sections()] == [1, 1, 1]
    assert "re-home all three axes" in text
    assert "coordinates=XYZ: with others go by the axis named here. Then restart" in text
    assert "previous +0.12345" in text, "to its last digit"
    assert "Check: put the gauge 155 mm from carriage" in text
    assert VERIFY in text


def test_text_says_what_the_controller_says_and_what_is_true(released: Case) -> None:
    text = FORMATS["text"](*export(released))
    true = 310.25 + changes(released)[0]
    assert f"x: the controller says 310.25000 mm, truly {true:.5f} mm" in text
    assert "re-home" in text
    assert VERIFY in text
    row = next(line for line in text.splitlines() if line.strip().startswith("z "))
    cells = row.split()
    assert float(cells[4]) == pytest.approx(float(cells[1]) + float(cells[2]))


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(
    "make", [cases.named_in_machine, cases.named_in_measurement, cases.ambiguous, cases.unexplained]
)
def test_what_must_not_be_used_is_marked(make, name: str) -> None:
    case = make()
    text = FORMATS[name](*export(case))
    assert "FORCED" in text
    reason = case.says(case.answer.release.reasons[0]).split(":")[0]
    assert reason in " ".join(text.replace("\n# ", " ").split())


@pytest.mark.parametrize("name", FORMATS)
def test_hostile_names_stay_words(name: str) -> None:
    harmful, written = cases.hostile().given, "=1+1\n[JOINT_0]\nHOME_OFFSET = 99\n" + HOSTILE[3]
    case = case_of(replace(harmful, model=changed(harmful.model, name=written)))
    text = FORMATS[name](*export(case))
    assert not set(text) & set("\x1b\x07\u009b\u202e\u2066\r")
    assert not re.search(r"^HOME_OFFSET = 99", text, re.MULTILINE)
    assert text.count("\n[JOINT_0]") == (1 if name == "linuxcnc" else 0)


def test_compensation_table_is_numbers() -> None:
    model = extended(axis_gap=(0.3, -0.2, 0.25), thermal_drift=(0.1, 0.1, 0.1))
    table = compensation(model, 3)
    rows = list(csv.DictReader(io.StringIO(controller.as_table(table, cases.healthy()))))
    assert len(rows) == 27
    assert {row["status"] for row in rows} == {"released"}
    first = np.array([float(rows[0][f"add_to_joint_{axis}_mm"]) for axis in "xyz"])
    assert first == pytest.approx(table[0, 3:], abs=5.1e-5)


# --- lines for printers, read as each firmware documents them -----------------------------------

USUAL = np.array([210.0, 330.0, 90.0])
# Carriages so far below the height at which their endstop triggers.
BELOW = np.array([[210.0, 260.0, 190.0], [400.0, 395.0, 410.0], [418.0, 391.0, 425.0]])


def numbers(text: str, code: str) -> dict[str, list[float]]:
    """Letter → numbers of the one line that begins with a G-code."""
    (line,) = (line for line in text.splitlines() if line.startswith(f"{code} "))
    words = (word for word in line.split()[1:])
    return {word[0]: [float(part) for part in word[1:].split(":")] for word in words}


def klipper(text: str) -> tuple[np.ndarray, ...]:
    """Arms, radius, angles, and heights of the nozzle at which the endstops trigger."""
    found = sections("\n".join(re.findall(r"^#\*# ?(.*)$", text, re.MULTILINE)))
    towers = [found[f"stepper_{tower}"] for tower in "abc"]
    keys = "arm_length", "angle", "position_endstop"
    arms, angles, ends = (np.array([float(tower[key]) for tower in towers]) for key in keys)
    return arms, np.array(float(found["printer"]["delta_radius"])), angles, ends


def reprapfirmware(text: str) -> tuple[np.ndarray, ...]:
    """M665: L, R, H, tower corrections in degrees; M666: corrections added to the homed height."""
    m665, m666 = numbers(text, "M665"), numbers(text, "M666")
    trims = np.array([m665[name][0] for name in "XYZ"])
    more = np.array([m666[name][0] for name in "XYZ"])
    assert more.sum() == pytest.approx(0.0, abs=3e-4)
    arms = np.broadcast_to(m665["L"], 3)
    return arms, np.array(m665["R"][0]), USUAL + trims, m665["H"][0] + more


def marlin(text: str) -> tuple[np.ndarray, ...]:
    """M666 moves a carriage down by −adjustment after its endstop: there it is homed at H."""
    m665, m666 = numbers(text, "M665"), numbers(text, "M666")
    trims = np.array([m665[name][0] for name in "XYZ"])
    adjust = np.array([m666[name][0] for name in "XYZ"])
    assert adjust.max() <= 0.0
    arms = m665["L"][0] + np.array([m665.get(name, [0.0])[0] for name in "ABC"])
    return arms, np.array(m665["R"][0]), USUAL + trims, m665["H"][0] - adjust


READ = {"klipper": klipper, "reprapfirmware": reprapfirmware, "marlin": marlin}


def reached(arms, radius, angles, endstops) -> np.ndarray:
    """Where a firmware with these numbers believes the tool to be, shape (n, 3)."""
    angle = np.radians(angles)
    feet = radius * np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=1)
    height = endstops + np.sqrt(arms**2 - radius**2) - BELOW
    carriages = feet + height[:, :, None] * [0.0, 0.0, 1.0]
    start = np.array([[0.0, 0.0, z] for z in height.mean(axis=1) - 0.9 * arms.mean()])
    return tool_from_carriages(carriages.transpose(1, 2, 0), arms[:, None], start.T, steps=12).T


def exported(tmp_path: Path, truth: Truth, format: str, *known: Effect) -> str:
    machine, data = tmp_path / "machine.yaml", tmp_path / "touches.csv"
    machine.write_text(delta_yaml(V400).replace("  backlash: 0.05\n", ""))
    data.write_text(exact(V400, truth, Layout(places=41, heights=(0.0, 60.0))))
    model = read_machine_file(machine).model
    case = case_of(read_input(str(data), model.extended(known)))
    return controller.exported(format, *export(case))


@pytest.mark.parametrize("format", READ)
def test_the_tool_is_where_the_firmware_will_believe_it(tmp_path, format):
    really, text = tool(V400, OFF, V400.home - BELOW), exported(tmp_path, OFF, format)
    found = reached(*READ[format](text))
    remarks = " ".join(line[2:] for line in text.splitlines() if line.startswith("# "))
    obeyed = "Where these settings stand above the block, too, delete them there" in remarks
    assert obeyed == (format == "klipper")
    assert found == pytest.approx(really, abs=2e-3)
    before = reached(np.array(V400.arms), V400.radius, USUAL, np.array(V400.endstops))
    assert np.abs(before - really).max() > 0.2


@pytest.mark.parametrize("format", READ)
def test_arms_that_were_accepted_as_longer_are_entered(tmp_path, format):
    longer = np.array([0.21, -0.13, 0.34])
    truth = replace(OFF, arms=longer)
    text = exported(tmp_path, truth, format, CAUSES["leg_length"].at(longer))
    assert reached(*READ[format](text)) == pytest.approx(
        tool(V400, truth, V400.home - BELOW), abs=2e-3
    )
    assert "leg_length" not in text


@pytest.mark.parametrize("format", READ)
def test_what_no_firmware_can_be_told_is_said(tmp_path, format):
    leaning = CAUSES["tower_lean"].at(1e-3 * np.array([2.0, -1.0, 1.0, 0.5, 0.0, 1.5]))
    truth = replace(OFF, leans=np.array([[2.0, 0.5], [-1.0, 0.0], [1.0, 1.5]]))
    text = exported(tmp_path, truth, format, leaning)
    assert "Not in these lines: tower_lean; it has no setting for that: correct the fault." in text
    assert "no setting for towers that lean" in text
    comment = controller.FIRMWARES[format]["comment"]
    code = [line for line in text.splitlines() if not line.startswith((f"{comment} ", comment))]
    assert all(line.startswith("M") for line in code)
