"""The machine file of a linear delta: what is accepted, every fault, round trips."""

import numpy as np
import pytest
import yaml

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files import machine_from_text, machine_text, machine_values
from orthoglide_cal.model import Model
from orthoglide_cal.model.linear_delta import CALLIPER_MM, LinearDelta
from tests.printers import CONFIG, UNEVEN
from tests.truth.delta import TOLERANCES, delta_yaml

from .helpers import places, problems

TEXT = CONFIG.read_text(encoding="utf-8")
CALLIPER = str(yaml.safe_load(TEXT)["probe"]["calliper_mm"])


def read(text: str) -> Model:
    return machine_from_text(text, "m.yaml")


def line_of(start: str) -> int:
    return next(n for n, line in enumerate(TEXT.split("\n"), 1) if line.startswith(start))


def test_the_file_of_an_independent_program_with_three_arms() -> None:
    text = delta_yaml(UNEVEN)
    machine = read(text).machine
    assert isinstance(machine, LinearDelta)
    assert machine.arm_length_mm == UNEVEN.arms
    assert machine.expanding_mm == pytest.approx(np.mean(UNEVEN.arms))
    assert machine.tower_angles_deg == UNEVEN.angles
    assert machine.endstops_mm == UNEVEN.endstops
    assert (machine.delta_radius_mm, machine.bed_radius_mm) == (UNEVEN.radius, UNEVEN.bed)
    assert (machine.probe.repeatability_mm, machine.probe.calliper_mm) == (
        UNEVEN.noise,
        UNEVEN.calliper,
    )
    assert machine.probe.texture_mm == yaml.safe_load(text)["probe"]["texture_mm"]
    assert dict(machine.tolerances) == TOLERANCES


def test_it_is_read_as_it_was_written() -> None:
    """Also with one arm stated for all, with nothing said of the bed, and with what was found."""
    lean, bed = CAUSES["tower_lean"], CAUSES["bed_shape"]
    for text in (TEXT, delta_yaml(UNEVEN)):
        found = [
            cause.at(cause.scale * np.linspace(0.1, 0.7, cause.unknowns)).accepted(
                "2026-01-01", "0" * 64
            )
            for cause in (lean, bed)
        ]
        model = read(text).extended(found)
        again = read(machine_text(model))
        assert again.machine == model.machine
        assert machine_values(again) == machine_values(model)
        for mine, theirs in zip(again.accepted, model.accepted, strict=True):
            assert mine.cause is theirs.cause
            assert mine.theta == pytest.approx(theirs.theta, rel=1e-11)
        assert machine_text(again) == machine_text(model)


def test_a_shape_that_was_found_with_fewer_terms_is_read() -> None:
    bed = CAUSES["bed_shape"]
    theta = np.concatenate((np.linspace(0.1, 0.7, 7), np.zeros(18)))
    found = bed.at(theta).accepted("2026-01-01", "0" * 64)
    content = yaml.safe_load(machine_text(read(TEXT).extended([found])))
    kept = content["identified"][0]
    kept["parameters"] = {name: kept["parameters"][name] for name in bed.names[:7]}
    kept["correlation"] = np.eye(7).tolist()
    (again,) = read(yaml.safe_dump(content)).accepted
    assert again.theta == pytest.approx(theta)


def test_what_is_optional() -> None:
    content = yaml.safe_load(TEXT)
    del content["tolerances"], content["identified"]
    del content["probe"]["texture_mm"], content["probe"]["calliper_mm"]
    machine = read(yaml.safe_dump(content)).machine
    assert isinstance(machine, LinearDelta)
    assert (machine.probe.calliper_mm, machine.probe.texture_mm) == (CALLIPER_MM, None)
    assert dict(machine.tolerances) == {}
    # Towers may be counted from any angle on.
    content["tower_angles_deg"] = [330.0, 90.0, 210.0]
    assert read(yaml.safe_dump(content)).machine.tower_angles_deg == (330.0, 90.0, 210.0)


A, R, T = "arm_length_mm: 344.1 ", "delta_radius_mm: 161.8", "[210, 330, 90]"
E = "{a: 420, b: 420, c: 420}"
BAD = [
    (T, "[330, 210, 90]", 10, "tower_angles_deg", None, "counter-clockwise", "[210, 330, 90]"),
    (T, "[210, 210, 90]", 10, "tower_angles_deg", None, "counter-clockwise", "firmware"),
    (R, "delta_radius_mm: 344.1", 9, "delta_radius_mm", "344.1", "as large as an arm",
     "horizontal distance"),
    (R, "delta_radius_mm: 0", 9, "delta_radius_mm", "0", "greater than zero", "size"),
    (R, "delta_radius: 161.8", 9, "delta_radius", "161.8", "not known", "'delta_radius_mm'?"),
    (A, "arm_length_mm: [344, 344] ", 8, "arm_length_mm[2]", None, "too short", "Add"),
    (A, "arm_length_mm: [344, 344, 0.5] ", 8, "arm_length_mm[2]", "0.5", "at least 1", "unit"),
    (A, "arm_length_mm: [344, 344, 150] ", 9, "delta_radius_mm", "161.8", "as large as an arm",
     "horizontal"),
    (A, "arm_length_mm: -3 ", 8, "arm_length_mm", "-3", "greater than zero", "size"),
    (E, "{a: 420, b: 420}", 11, "endstops_mm.c", None, "missing", "c: …"),
    (E, "{a: 420, b: 420, c: 1e9}", 11, "endstops_mm.c", "1e9", "at most 10000", "unit"),
    ("bed_radius_mm: 150", "bed_radius_mm: 0", 12, "bed_radius_mm", "0", "zero", "size"),
    ("bed_radius_mm: 150", "bed_radius_mm: 150\nleg_length_mm: 3", 13, "leg_length_mm", "3",
     "not known", "Known here"),
    ("repeatability_mm: 0.012", "repeatability_mm: 0", 17, "probe.repeatability_mm", "0",
     "greater than zero", "size"),
    ("resolution_mm: 0.0", "resolution_mm: -1", 16, "probe.resolution_mm", "-1", "negative",
     "zero or more"),
    ("calliper_mm:", "caliper_mm:", 18, "probe.caliper_mm", CALLIPER, "not known",
     "'calliper_mm'?"),
    (f"calliper_mm: {CALLIPER}", "calliper_mm: 0", 18, "probe.calliper_mm", "0", "zero", "size"),
    ("texture_mm: 0.02", "texture_mm: -0.1", 19, "probe.texture_mm", "-0.1", "negative", "zero"),
    ("probe:", "prob:", 15, "prob", None, "not known", "'probe'?"),
    ("misread: 0.1", "axis_gap: 0.1", line_of("  misread:"), "tolerances.axis_gap", "axis_gap",
     "of this kind of machine", "Known: "),
    ("probe_tilt: 0.05", "probe_tilt: 500", line_of("  probe_tilt:"), "tolerances.probe_tilt",
     "500", "1000 times", "in mm"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line", "path", "value", "what", "remedy"), BAD)
def test_faults_name_place_and_remedy(old, new, line, path, value, what, remedy) -> None:
    assert TEXT.count(old) == 1
    found = problems(read, TEXT.replace(old, new))
    at_place = [fault for fault in found if fault.column == path]
    assert places(at_place) == [(line, path, value)]
    assert what in at_place[0].what
    assert remedy in at_place[0].remedy


def test_an_unknown_kind_is_the_only_fault() -> None:
    """The rest is understood as what it most likely means."""
    for kind, wanted in (("linear_delt", "'linear_delta'?"), ("cartesian", "Known: orthoglide")):
        (fault,) = problems(read, TEXT.replace("kind: linear_delta", f"kind: {kind}"))
        assert places([fault]) == [(4, "kind", kind)]
        assert wanted in fault.remedy
