"""Touches and distances: from a CSV, and from a printer.cfg through the door of every command."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.errors import UsageError
from orthoglide_cal.files.input import Input, read_input
from orthoglide_cal.files.machine_file import default_machine, read_machine_file, stored_machine
from orthoglide_cal.files.printer_file import REPEATABILITY_MM
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.model.linear_delta import CALLIPER_MM, MINUTES_PER_TOUCH, Endstops
from orthoglide_cal.model.measured import NOZZLE
from orthoglide_cal.model.model import Model
from tests.printer_files import printer_cfg
from tests.printers import CONFIG, UNEVEN, printer, true_values
from tests.sentences import sentences
from tests.truth.delta import Layout, Truth, delta_csv, indicated, make_delta_session, tool
from tests.truth.plan import frozen

from .helpers import problems, saved

MODEL = stored_machine(CONFIG.read_text(encoding="utf-8"), "m.yaml").model
TRUTH = Truth(endstops=frozen([0.5, -0.3, 0.4]), radius=0.4, angles=frozen([0.15, -0.1, 0.0]))
Z = 1.5


# --- CSV --------------------------------------------------------------------------------------


def test_a_file_of_an_independent_program_is_read_as_it_was_taken(tmp_path: Path) -> None:
    layout = Layout(places=13, heights=(0.0, 25.0), cycles=2)
    session = make_delta_session(3, UNEVEN, (), layout)
    given = read_input(saved(tmp_path, delta_csv(session)), Model(printer(UNEVEN)))
    read = given.measured
    plan = read.plan
    expected = np.stack((session.x, session.y, session.readings), axis=1)
    assert plan.place == pytest.approx(expected, abs=1e-12)
    assert np.array_equal(plan.other, plan.place)
    assert plan.surface.tolist() == session.block.tolist()
    assert plan.hours == pytest.approx(session.minutes / 60.0, abs=1e-12)
    assert plan.order.tolist() == list(range(52))
    assert not plan.distance.any()
    assert read.value == pytest.approx(session.readings - session.block, abs=1e-12)
    assert read.cycle.tolist() == session.cycle.tolist()
    assert read.line.tolist() == list(range(2, 54))
    assert read.timed
    assert read.remarks == ()
    assert not given.is_session


def test_what_is_optional_in_any_order(tmp_path: Path) -> None:
    text = "note;colour;y_mm;reading_mm;x_mm\nfoil;red;1,5;0,02;-3\n;;2;-0,01;4,25\n"
    read = read_input(saved(tmp_path, text), MODEL).measured
    assert read.plan.place.tolist() == [[-3.0, 1.5, 0.02], [4.25, 2.0, -0.01]]
    assert read.plan.surface.tolist() == [0.0, 0.0]
    assert read.value.tolist() == [0.02, -0.01]
    assert read.plan.hours.tolist() == [0.0, MINUTES_PER_TOUCH / 60.0]
    assert (read.note, read.timed, read.cycle.tolist()) == (("foil", ""), False, [1, 1])
    assert any("colour" in remark for remark in sentences(read.remarks))


def test_a_column_without_a_name_changes_no_unit(tmp_path: Path) -> None:
    text = "x_mm,y_mm,reading_mm,\n3,4,0.25,why\n"
    assert read_input(saved(tmp_path, text), MODEL).measured.value.tolist() == [0.25]


def test_a_line_with_a_hash_is_a_comment_also_below_a_header_of_places(tmp_path: Path) -> None:
    read = read_input(saved(tmp_path, H + "# a new nozzle\n1,0,0.2\n"), MODEL).measured
    assert read.value.tolist() == [0.1, 0.2]


def test_the_order_in_time_is_that_of_the_numbers(tmp_path: Path) -> None:
    text = "seq,x_mm,y_mm,reading_mm\n7,0,0,0.1\n3,1,0,0.2\n5,2,0,0.3\n"
    read = read_input(saved(tmp_path, text), MODEL).measured
    assert read.plan.order.tolist() == [2, 0, 1]
    assert read.plan.hours == pytest.approx(np.array([2, 0, 1]) * MINUTES_PER_TOUCH / 60.0)


@pytest.mark.parametrize(("last", "same"), [("0", True), ("1", False)])
def test_the_same_time_for_all_is_none(tmp_path: Path, last: str, same: bool) -> None:
    text = f"x_mm,y_mm,reading_mm,minutes\n1,0,0.1,0\n0,1,0.2,0\n0,0,0.1,{last}\n"
    remarks = read_input(saved(tmp_path, text), MODEL).measured.remarks
    assert ("equal_minutes" in [remark.code for remark in remarks]) == same


H = "x_mm,y_mm,reading_mm\n0,0,0.1\n"


def test_touches_need_a_machine_with_a_bed(tmp_path: Path) -> None:
    for model in (None, default_machine()):
        (fault,) = problems(read_input, saved(tmp_path, H), model)
        assert fault.line == 1
        assert "touches of a bed" in fault.what
        assert "kind linear_delta: --machine" in fault.remedy


def test_a_column_of_places_makes_no_touches_of_gauge_readings(tmp_path: Path) -> None:
    text = "leg,posture,direction,reading_mm,x_mm,y_mm\nx,iso,y,0.1,3,4\nx,max,y,0.2,3,4\n"
    read = read_input(saved(tmp_path, text), default_machine()).measured
    assert len(read) == 2
    assert any("x_mm" in remark for remark in sentences(read.remarks))


# --- printer.cfg ------------------------------------------------------------------------------


def cfg(sections: str = "cm", truth: Truth = TRUTH) -> str:
    """What the firmware of such a printer saves, exactly measured."""
    return printer_cfg(UNEVEN, truth, noise=0.0, sections=sections, surface=Z)


def taken(folder: Path, text: str, **options) -> Input:
    return read_input(saved(folder, text, "printer.cfg"), **options)


@pytest.mark.parametrize(("data", "count"), [("c", 10), ("m", 49)])
def test_what_a_printer_saved_gives_its_true_parameters(
    tmp_path: Path, data: str, count: int
) -> None:
    """Exactly measured they are those of the truth, to the digits that the file has."""
    given = taken(tmp_path, cfg(data))
    assert len(given.measured) == count
    found = solve(given.measured, given.model)
    # A step is 12.5 µm and written to a thousandth, a height to a nanometre.
    assert found.offsets_mm == pytest.approx(true_values(UNEVEN, TRUTH), abs=2e-4)
    assert found.rms_after_mm < 1e-5


def test_the_calibration_comes_first_and_distances_are_distances(tmp_path: Path) -> None:
    plan = taken(tmp_path, cfg()).measured.plan
    assert plan.distance.tolist() == [False] * 7 + [True] * 3
    assert plan.surface.tolist() == [Z] * 7 + [0.0] * 3
    turn = np.radians(30.0 + 60.0 * np.arange(6))
    ring = 0.9 * UNEVEN.bed * np.stack((np.cos(turn), np.sin(turn), 0.0 * turn), axis=1)
    ring[:, 2] = 0.2
    assert plan.place[7:] == pytest.approx(ring[:3], abs=5e-5)
    assert plan.other[7:] == pytest.approx(ring[3:], abs=5e-5)
    assert plan.precision[7:] == pytest.approx(REPEATABILITY_MM / CALLIPER_MM)
    assert plan.precision[:7].tolist() == [1.0] * 7


def test_what_else_is_known_comes_from_the_machine_file(tmp_path: Path) -> None:
    """Its probe, tolerances and causes; the numbers in force are those of the printer.cfg."""
    own = printer(UNEVEN, {"leg_length": 0.1})
    probe = own.probe.changed(calliper_mm=0.02, texture_mm=0.02)
    known = own.changed(name="mine", probe=probe, endstops_mm=Endstops(1.0, 2.0, 3.0))
    machine = taken(tmp_path, cfg(), model=Model(known)).model.machine
    assert (machine.name, machine.probe) == ("mine", probe)
    assert machine.tolerances == {"leg_length": 0.1}
    assert machine.endstops_mm == UNEVEN.endstops
    bare = taken(tmp_path, cfg()).model.machine
    assert (bare.name, bare.arm_length_mm, bare.endstops_mm) == (
        "printer.cfg", UNEVEN.arms, UNEVEN.endstops,
    )  # fmt: skip
    assert (bare.probe.repeatability_mm, bare.probe.calliper_mm) == (REPEATABILITY_MM, CALLIPER_MM)


def test_a_machine_of_another_kind_is_refused(tmp_path: Path) -> None:
    """As is a printer's file for a machine file; where it belongs is said."""
    with pytest.raises(UsageError, match="is of a linear delta") as caught:
        taken(tmp_path, cfg(), model=default_machine())
    assert "--machine" in caught.value.remedy
    (fault,) = problems(read_machine_file, saved(tmp_path, cfg(), "printer.cfg"))
    assert "not a machine file" in fault.what
    assert "solve, diagnose or plan" in fault.remedy


@pytest.mark.parametrize("by", [0.3, -0.2])
def test_endstops_that_were_trimmed_after_the_calibration_are_told(
    tmp_path: Path, by: float
) -> None:
    """As a first layer is set: all three by the same; where the nozzle goes, an independent delta
    says: who believes the opposite drives it into the bed."""
    trimmed = replace(UNEVEN, endstops=tuple(end + by for end in UNEVEN.endstops))
    ways = trimmed.home - indicated(trimmed, np.array([[0.0, 0.0, 0.2]]))
    beyond = float(tool(UNEVEN, Truth(), UNEVEN.home - ways)[0, 2]) - 0.2
    assert abs(beyond) == pytest.approx(abs(by), abs=0.01)
    words = f"{abs(beyond):.2f}", "higher" if beyond > 0.0 else "lower"
    text = cfg(truth=Truth())
    assert not [r for r in taken(tmp_path, text).measured.remarks if r.code in NOZZLE]
    for end in set(UNEVEN.endstops):
        text = text.replace(f"position_endstop = {end}\n", f"position_endstop = {end + by}\n")
    remarks = sentences(taken(tmp_path, text).measured.remarks)
    (remark,) = (remark for remark in remarks if "first layer" in remark)
    assert all(word in remark for word in words), remark


@pytest.mark.parametrize("section", ["[printer] # mine", "[ printer ]", "[printer]\t; mine"])
def test_a_printer_is_known_by_its_section(tmp_path: Path, section: str) -> None:
    assert len(taken(tmp_path, cfg().replace("[printer]", section, 1)).measured) == 10
