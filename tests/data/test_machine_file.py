"""The machine file: what is accepted, what is refused and how, round trips."""

import dataclasses
import time
import zipfile
from pathlib import Path

import pytest
import yaml

from orthoglide_cal.data import (
    CAUSE_IDS,
    default_machine,
    machine_text,
    read_machine,
    write_machine,
)
from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.machine import Estimate, Gauge, IdentifiedCause

from .helpers import PROTOTYPE, places, problems

DIGEST = "0123456789abcdef" * 4


def test_the_prototype_is_the_default():
    machine = default_machine()
    assert machine.leg_length_mm == 310.25
    assert machine.parallelogram_width_mm == 80.0
    assert machine.tool_offset_mm == 31.0
    assert machine.joint_limits_mm == (-100.0, 60.0)
    assert machine.gauge == Gauge(0.01, 10.0, 1.0, 0.006)
    assert set(machine.tolerances) == set(CAUSE_IDS)
    assert machine == read_machine(PROTOTYPE) == read_machine(None)


def test_a_different_machine():
    machine = read_machine(PROTOTYPE.with_name("orthoglide_large.yaml"))
    assert machine.leg_length_mm == 420.0
    assert machine.joint_limits_mm == (-140.0, 90.0)
    assert machine.gauge.resolution_mm == 0.001


def changed(tmp_path: Path, *pairs: tuple[str, str]) -> Path:
    text = PROTOTYPE.read_text()
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / "m.yaml"
    path.write_text(text)
    return path


L = "leg_length_mm: 310.25"

BAD = [
    # replaced, by, line, path, value, words of the message, words of the remedy
    (L, "leg_length_mm: 012", 7, "leg_length_mm", "012", "octal", "leading zero"),
    (L, "leg_length_mm: 5:10", 7, "leg_length_mm", "5:10", "not a number", "plain number"),
    (L, "leg_length_mm: yes", 7, "leg_length_mm", "yes", "not a number", "plain number"),
    (L, "leg_length_mm: .nan", 7, "leg_length_mm", ".nan", "not a number", "plain number"),
    (L, "leg_length_mm: .inf", 7, "leg_length_mm", ".inf", "not a number", "plain number"),
    (L, "leg_length_mm: 1_000", 7, "leg_length_mm", "1_000", "not a number", "plain number"),
    (L, "leg_length_mm: 310,25", 7, "leg_length_mm", "310,25", "decimal comma", "decimal point"),
    (L, "leg_length_mm: -310", 7, "leg_length_mm", "-310", "greater than zero", "size"),
    (L, "leg_length_mm:", 7, "leg_length_mm", None, "number is wanted", "plain number"),
    (L, "leg_length_mm: [1]", 7, "leg_length_mm", None, "number is wanted", "plain number"),
    (L, "leg_lenght_mm: 310.25", 3, "leg_length_mm", None, "missing", "leg_length_mm: …"),
    (L, L + "\nL: 3", 8, "L", "3", "not known", "Known here: schema_version"),
    (L, L + "\n" + L, 8, "leg_length_mm", "310.25", "stands twice", "Remove"),
    ("[-100, 60]", "[60, -100]", 10, "joint_limits_mm", None, "ordered", "displacements"),
    ("[-100, 60]", "[10, 60]", 10, "joint_limits_mm", None, "isotropic", "displacements"),
    ("[-100, 60]", "[-100, 370.25]", 10, "joint_limits_mm[1]", None, "beyond", "not the joint"),
    ("[-100, 60]", "[-100]", 10, "joint_limits_mm[1]", None, "too short", "Add"),
    ("[-100, 60]", "[-100, 0, 60]", 10, "joint_limits_mm", None, "too many", "Remove"),
    ("resolution_mm: 0.01", "resolution_mm: 0", 15, "gauge.resolution_mm", "0", "zero", "size"),
    ("{x: 0, y: 0, z: 0}", "{x: 0, q: 1}", 21, "offsets_mm.q", "1", "not known", "x, y, z"),
    ("misread: 0.1", "misred: 0.1", 36, "tolerances.misred", "misred", "not a cause id",
     "'misread'? Known: axis_gap"),
    ("backlash: 0.02", "backlash: 0", 30, "tolerances.backlash", "0", "greater than zero", "size"),
    ("schema_version: 1", "schema_version: 2", 3, "schema_version", "2", "version", "Write 1"),
    ("name: Orthoglide prototype", "name: ''", 4, "name", "", "empty", "word"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line", "path", "value", "what", "remedy"), BAD)
def test_faults_name_place_and_remedy(tmp_path, old, new, line, path, value, what, remedy):
    found = problems(read_machine, changed(tmp_path, (old, new)))
    at_place = [fault for fault in found if fault.column == path]
    assert places(at_place) == [(line, path, value)]
    assert what in at_place[0].what
    assert remedy in at_place[0].remedy
    assert at_place[0].file.endswith("m.yaml")


def test_all_faults_at_once_in_the_order_of_lines(tmp_path):
    path = changed(tmp_path, (L, "leg_length_mm: x"), ("range_mm: 10", "rang_mm: 10"))
    assert places(problems(read_machine, path)) == [
        (7, "leg_length_mm", "x"), (14, "gauge.range_mm", None), (16, "gauge.rang_mm", "10"),
    ]  # fmt: skip


def test_exponents_and_quotes_are_numbers(tmp_path):
    path = changed(tmp_path, ("misread: 0.1", "misread: 1e-1"), (L, 'leg_length_mm: "300"'))
    machine = read_machine(path)
    assert machine.tolerances["misread"] == 0.1
    assert machine.leg_length_mm == 300.0


def test_optional_parts(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(
        "schema_version: 1\nname: bare\nleg_length_mm: 300\nparallelogram_width_mm: 80\n"
        "tool_offset_mm: 0\njoint_limits_mm: [-90, 50]\nworkspace_mm: 200\ntolerances:\n"
        "identified: ~\ngauge: {resolution_mm: 1e-3, range_mm: 12, revolution_mm: null,"
        " repeatability_mm: 0.002}\n"
    )
    machine = read_machine(path)
    assert machine.gauge.revolution_mm is None
    assert machine.offsets_mm == (0.0, 0.0, 0.0)
    assert dict(machine.tolerances) == {}
    assert machine.identified == ()


@pytest.mark.parametrize(
    ("text", "what"),
    [("- a\n", "not a machine file"), ("leg,posture\n", "not a machine file"),
     ("machine: {}\nreadings: []\n", "is a session")],
)  # fmt: skip
def test_other_files_are_told_apart(tmp_path, text, what):
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=what):
        read_machine(path)


def identified() -> IdentifiedCause:
    return IdentifiedCause(
        id="axis_gap",
        where="",
        parameters={
            "g_xy": Estimate(0.31, 1 / 3, "mm"),
            "g_yz": Estimate(-1e-5, 0.02, "mm"),
        },
        date="2025-03-01",
        data_sha256=DIGEST,
    )


def test_round_trip_is_exact(tmp_path):
    machine = dataclasses.replace(
        default_machine(),
        name="no: 7 # \u00e9 'x'",
        leg_length_mm=1000 / 3,
        offsets_mm=(0.1, -1e-7, 123.456),
        gauge=Gauge(0.001, 12.0, None, 0.002),
        identified=(identified(),),
    )
    path = tmp_path / "new.yaml"
    write_machine(machine, path)
    assert read_machine(path) == machine
    assert path.read_text() == machine_text(machine)


def test_encoder_scale_unit_survives(tmp_path):
    cause = dataclasses.replace(
        identified(), id="encoder_scale", parameters={"k_x": Estimate(1.5, 0.1, "1e-3")}
    )
    path = tmp_path / "new.yaml"
    write_machine(dataclasses.replace(default_machine(), identified=(cause,)), path)
    assert read_machine(path).identified == (cause,)


def test_a_unit_that_is_not_the_contracts_is_refused(tmp_path):
    machine = dataclasses.replace(default_machine(), identified=(identified(),))
    path = tmp_path / "m.yaml"
    path.write_text(machine_text(machine).replace("unit: mm", "unit: mrad"))
    fault = problems(read_machine, path)[0]
    assert fault.column == "identified[0].parameters.g_xy.unit"
    assert "measured in mm, not 'mrad'" in fault.what


@pytest.mark.parametrize(
    ("old", "new", "path"),
    [
        (DIGEST, "abc", "identified[0].data_sha256"),
        ("2025-03-01", "yesterday", "identified[0].date"),
        ("cause: axis_gap", "cause: gap", "identified[0].cause"),
        ("std: 0.02", "std: -1", "identified[0].parameters.g_yz.std"),
        ("where: ''", "whre: ''", "identified[0].whre"),
    ],
)
def test_identified_causes_are_checked(tmp_path, old, new, path):
    text = machine_text(dataclasses.replace(default_machine(), identified=(identified(),)))
    assert old in text
    file = tmp_path / "m.yaml"
    file.write_text(text.replace(old, new))
    assert [fault.column for fault in problems(read_machine, file)] == [path]


@pytest.mark.parametrize("text", ["k{}: 1\n", "tolerances:\n", "name: x\n", "machine: 1\n"])
def test_many_faults_are_found_quickly(tmp_path, text):
    path = tmp_path / "m.yaml"
    body = "".join(f"  misread{i}: 1\n" for i in range(25_000)) if "tol" in text else ""
    path.write_text("".join(text.format(i) for i in range(1 if body else 25_000)) + body)
    start = time.process_time()
    assert len(problems(read_machine, path)) <= 1001
    assert time.process_time() - start < 3.0


def test_writing_never_overwrites(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text("mine")
    with pytest.raises(UsageError, match="not overwritten"):
        write_machine(default_machine(), path)
    assert path.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_an_installed_wheel_finds_its_machine(tmp_path):
    """The wheel's files unpacked outside the repository, run from elsewhere."""
    import os
    import subprocess
    import sys

    pytest.importorskip("hatchling")
    root = Path(__file__).parents[2]
    build = f"from hatchling.build import build_wheel; build_wheel({str(tmp_path)!r})"
    subprocess.run([sys.executable, "-c", build], cwd=root, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    script = (
        "import orthoglide_cal, sys\n"
        "from orthoglide_cal.data import default_machine\n"
        "print(orthoglide_cal.__file__, default_machine().leg_length_mm)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(site)},
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout.split() == [str(site / "orthoglide_cal" / "__init__.py"), "310.25"]


CORRELATION = ((1.0, -0.4), (-0.4, 1.0))


def test_correlations_survive_and_may_be_missing(tmp_path):
    cause = dataclasses.replace(identified(), correlation=CORRELATION)
    path = tmp_path / "m.yaml"
    write_machine(dataclasses.replace(default_machine(), identified=(cause,)), path)
    assert read_machine(path).identified == (cause,)
    without = [line for line in path.read_text().splitlines() if "0.4" not in line]
    path.write_text("\n".join(line for line in without if "correlation" not in line))
    assert read_machine(path).identified == (identified(),)


@pytest.mark.parametrize(
    ("rows", "what"),
    [
        (((1.0,),), "2 rows of 2"),
        (((1.0, 0.1), (0.1,)), "2 rows of 2"),
        (((1.0, 0.1), (0.2, 1.0)), "not correlations"),
        (((0.9, 0.1), (0.1, 1.0)), "not correlations"),
        (((1.0, 1.1), (1.1, 1.0)), "not correlations"),
    ],
)
def test_correlations_are_checked(tmp_path, rows, what):
    cause = dataclasses.replace(identified(), correlation=CORRELATION)
    text = machine_text(dataclasses.replace(default_machine(), identified=(cause,)))
    old = yaml.safe_load(text)
    old["identified"][0]["correlation"] = [list(row) for row in rows]
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump(old))
    (fault,) = problems(read_machine, path)
    assert fault.column == "identified[0].correlation"
    assert what in fault.what
