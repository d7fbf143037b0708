"""Klipper's printer.cfg: what is read of it, what is passed over, and every fault with its line."""

import codecs
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from orthoglide_cal.estimation.arms import free_arms
from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.klipper import read_printer_file
from orthoglide_cal.files.text import document_from_bytes
from orthoglide_cal.inference.diagnose import diagnose
from tests.printer_files import OFF, STEP, printer_cfg
from tests.sentences import sentences
from tests.truth.delta import V400, Delta, Floats
from tests.truth.forward import tool_from_carriages

from .helpers import VARIANTS, document, problems, replaced, saved

GOOD = Path(__file__).with_name("printer.cfg").read_text(encoding="utf-8")
# A round bed of five by five points: thirteen lie in the circle.
MESH = GOOD[GOOD.index("#*# [bed_mesh default]") :]
PADDED = (
    "12 points of the mesh 'default' were not probed: they repeat a neighbour and are left out."
)


def read(text):
    return read_printer_file(document(text, "printer.cfg"))


def line_of(text, start):
    lines = text.split("\n")
    return next(n for n, line in enumerate(lines, 1) if line.startswith(start))


def test_parameters_in_force_and_what_stands_for_those_not_given():
    found = read(GOOD)
    assert (found.machine.delta_radius_mm, found.machine.bed_radius_mm) == (130.5, 110.0)
    assert found.machine.arm_length_mm == (250.25, 250.25, 250.75)
    assert found.machine.endstops_mm == (300.5, 300.5, 299.75)
    assert found.machine.tower_angles_deg == (210.0, 329.5, 90.0)
    assert found.probe.tolist() == [2.0, -3.5, 1.5]
    assert found.remarks == ()
    assert read(GOOD.replace("print_radius: 110\n", "")).machine.bed_radius_mm == 130.5


def test_steps_below_the_endstops_are_heights_of_the_carriages():
    found = read(GOOD)
    step = [40 / (200 * 16), 20 / (200 * 32 * 5 * 5), 0.0125]
    home = [
        endstop + math.sqrt(arm**2 - 130.5**2)
        for endstop, arm in zip([300.5, 300.5, 299.75], [250.25, 250.25, 250.75], strict=True)
    ]

    def at(*counts):
        return [top - count * way for top, count, way in zip(home, counts, step, strict=True)]

    heights = [at(100, 200, 300.5), at(-100, 0, 10), at(0, 0, 400)]
    plan, carriages = found.data["calibration"].plan, found.machine.nominal_rails.joints_for
    first, second = [*heights, at(1000, 2000, 3000)], [*heights, at(0, 0, 80)]
    np.testing.assert_allclose(carriages(plan.place), first, rtol=1e-13)
    np.testing.assert_allclose(carriages(plan.other), second, rtol=1e-13)
    assert plan.distance.tolist() == [False, False, False, True]
    assert plan.surface.tolist() == [1.5, 1.5, 0.1, 0.0]
    value = plan.place[:, 2] - plan.surface
    np.testing.assert_array_equal(found.data["calibration"].value[:3], value[:3])
    assert found.data["calibration"].value[3] == 65.02 - plan.wanted[3]
    starts = ["#*# height0 ", "#*# height1 ", "#*# manual_height0 ", "#*# distance0 "]
    assert found.data["calibration"].line.tolist() == [line_of(GOOD, start) for start in starts]


def test_points_beyond_the_mesh_radius_are_left_out():
    mesh = read(GOOD).data["mesh"]
    assert (sentences(mesh.remarks), len(mesh.plan)) == ([PADDED], 13)
    x, y, z = mesh.plan.place.T
    np.testing.assert_allclose(x[:4] + 2.0, [0.0, -49.99, 0.0, 49.99], atol=1e-12)
    np.testing.assert_allclose(y[:4] - 3.5, [-99.98, -49.99, -49.99, -49.99])
    np.testing.assert_array_equal(z, mesh.value + 1.5)
    assert mesh.plan.surface.tolist() == [1.5] * 13
    assert mesh.value.tolist() == [
        0.1, 0.21, 0.22, 0.23, 0.3, 0.31, 0.32, 0.33, 0.34, -0.41, -0.42, -0.43, 0.5,
    ]  # fmt: skip
    assert mesh.plan.order.tolist() == [0, 3, 2, 1, 4, 5, 6, 7, 8, 11, 10, 9, 12]
    assert mesh.line[0] == line_of(GOOD, "#*# points") + 1
    assert mesh.line[-1] == mesh.line[0] + 4


@pytest.mark.parametrize(("other", "padded", "x"), VARIANTS["meshes"])
def test_the_mesh_of_another_file(other, padded, x):
    mesh = read(replaced(GOOD, other)).data["mesh"]
    assert (sentences(mesh.remarks), len(mesh.plan)) == ([PADDED] if padded else [], 25 - padded)
    assert mesh.plan.place[0, 0] == pytest.approx(x - 2.0)


def test_another_profile_where_there_is_no_default():
    text = GOOD.replace("[bed_mesh default]", "[bed_mesh hot bed]")
    (padded,) = sentences(read(text).data["mesh"].remarks)
    assert "the mesh 'hot bed'" in padded
    two = read(GOOD + MESH.replace("[bed_mesh default]", "[bed_mesh hot]").replace("0.3", "0.9"))
    assert two.data["mesh"].value[4] == 0.3
    assert two.remarks == ()


@pytest.mark.parametrize(
    "name",
    ["bltouch", "smart_effector", "dockable_probe", "scanner", "probe_eddy_current at the nozzle"],
)
def test_offsets_of_whatever_probes(name):
    found, same = read(GOOD.replace("[probe]", f"[{name}]")), read(GOOD)
    assert found.probe.tolist() == [2.0, -3.5, 1.5]
    assert found.data["mesh"].plan == same.data["mesh"].plan


def test_offsets_that_may_stand_in_an_included_file_are_asked_for():
    bare = GOOD.replace("x_offset: 2\n", "").replace("y_offset: -3.5\n", "")
    remark, _ = sentences(read(bare).data["mesh"].remarks)
    assert "x_offset and y_offset of [probe] taken as 0" in remark
    remark, _ = sentences(read(GOOD.replace("x_offset: 2\n", "")).data["mesh"].remarks)
    assert remark.startswith("x_offset of [probe]")
    assert sentences(read(bare.replace("[include macros.cfg]\n", "")).data["mesh"].remarks) == [
        PADDED
    ]


@pytest.mark.parametrize("option", ["zero_reference_position: 0,0", "relative_reference_index: 12"])
def test_a_mesh_that_counts_from_one_of_its_places_does_not_tell_the_height(option):
    text = GOOD.replace("mesh_radius: 100\n", f"mesh_radius: 100\n{option}\n")
    remark, _ = sentences(read(text).data["mesh"].remarks)
    assert f"line {line_of(text, option)}, {option.split(':')[0]}" in remark
    assert "the common height of the three endstops" in remark
    assert sentences(read(GOOD).data["mesh"].remarks) == [PADDED]


def test_the_lines_above_win_as_in_klipper():
    text = GOOD + "#*# [stepper_a]\n#*# arm_length = 251.125\n#*# angle = 210.25\n"
    found = read(text)
    assert found.machine.arm_length_mm == (250.25, 250.25, 250.75)
    assert found.machine.tower_angles_deg[0] == 210.25


@pytest.mark.parametrize("other", VARIANTS["klipper"])
def test_what_makes_no_difference(other):
    found, same = read(replaced(GOOD, other)), read(GOOD)
    assert found.machine == same.machine
    assert found.remarks == ()
    for one, other in (
        (found.data["calibration"], same.data["calibration"]),
        (found.data["mesh"], same.data["mesh"]),
    ):
        assert one.plan == other.plan
        np.testing.assert_array_equal(one.value, other.value)


def test_all_faults_are_found_at_once():
    text = GOOD.replace("130.5", "x").replace("height0 = 1.5", "height0 = y").replace("65.02", "z")
    assert [fault.value for fault in problems(read, text)] == ["x", "y", "z"]


def test_what_an_included_file_holds_is_asked_for():
    text = GOOD.replace("rotation_distance: 40\n", "")
    assert "included" in problems(read, text)[0].remedy
    text = text.replace("[include macros.cfg]\n", "")
    assert "included" not in problems(read, text)[0].remedy


def klipper_fit(machine: Delta, text: str) -> Floats:
    """Endstops, radius, two angles, three arms, (9,): what DELTA_CALIBRATE makes of its own file.

    By Klipper's document "Delta calibration" and what its log prints: squares of heights count by
    twice the number of distances over that of heights.
    """

    def ways(name: str) -> Floats:
        found = re.findall(rf"^#\*# {name} = (.*)$", text, re.MULTILINE)
        return STEP * np.array([row.split(",") for row in found], dtype=float)

    heights, first, second = map(ways, (r"height\d_pos", r"distance\d_pos1", r"distance\d_pos2"))
    lengths = ways(r"distance\d")[:, 0] / STEP

    def place(values: Floats, way: Floats) -> Floats:
        turn, arms = np.radians([*values[4:6], machine.angles[2]]), values[6:]
        foot = values[3] * np.stack((np.cos(turn), np.sin(turn)), axis=1)
        high = values[:3] + np.sqrt(arms**2 - values[3] ** 2) - way
        at = np.concatenate((np.tile(foot, (len(way), 1, 1)), high[..., None]), axis=2)
        start = np.stack((0.0 * high[:, 0], 0.0 * high[:, 0], high.mean(axis=1) - 0.9 * arms[0]))
        return tool_from_carriages(at.transpose(1, 2, 0), arms[:, None], start, steps=12).T

    def errors(values: Floats) -> Floats:
        apart = np.linalg.norm(place(values, first) - place(values, second), axis=1)
        weight = np.sqrt(2.0 * len(lengths) / len(heights))
        return np.concatenate((weight * place(values, heights)[:, 2], apart - lengths))

    start = np.array([*machine.endstops, machine.radius, *machine.angles[:2], *machine.arms])
    return least_squares(errors, start, x_scale="jac", xtol=1e-13, ftol=1e-13, gtol=1e-13).x


@pytest.mark.parametrize("noise", [0.0, 0.012])
def test_distances_free_the_arms_as_in_klipper(tmp_path: Path, noise: float) -> None:
    """Arms agree; the others, weighted by what is stated of calliper and probe, within U/5."""
    truth = replace(OFF, arms=np.array([0.6, -0.4, 0.3]))
    text = printer_cfg(V400, truth, noise=noise, sections="c", many=True)
    given = free_arms(read_input(saved(tmp_path, text, "printer.cfg")))
    (arms,) = given.model.accepted
    found, expected = diagnose(given.measured, given.model), klipper_fit(V400, text)
    assert found.lack_of_fit.dof == found.alone.dof == len(given.measured) - 6 - 3
    assert arms.theta == pytest.approx(expected[6:] - V400.arms, abs=1e-3)
    apart = np.array(given.model.machine.active) + found.alone.offsets_mm - expected[:6]
    assert np.all(np.abs(apart) < (found.alone.budget.expanded_mm / 5.0 if noise else 1e-3))
    assert np.abs(expected[6:] - V400.arms).max() > 0.5
    # Three distances would fit any arms.
    few = saved(tmp_path, printer_cfg(V400, truth, sections="c"), "few.cfg")
    assert free_arms(read_input(few)).model.accepted == ()


def test_a_block_that_klipper_drops_is_told_when_the_file_is_only_read() -> None:
    heading = "auto-generated.\n#*#\n"
    assert not read("#*# first\n" + GOOD.replace(heading, f"{heading}\n")).remarks
    for stray in ("\n#*# a\n#*# b\n" + GOOD, GOOD.replace(heading, f"{heading}#*# [a]\n\n\n")):
        (remark,) = read(stray).remarks
        assert (remark.code, len(remark.data["lines"])) == ("dropped", 2)
    marked = document_from_bytes(codecs.BOM_UTF8 + GOOD.encode(), "printer.cfg")
    assert [remark.code for remark in read_printer_file(marked).remarks] == ["dropped"]
