"""The machine file of both kinds: what is accepted, what is refused and how, round trips."""

import re
import time
from collections.abc import Iterator

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError
from orthoglide_cal.files.input import check_file
from orthoglide_cal.files.machine_file import (
    default_machine,
    machine_from_text,
    machine_in,
    machine_text,
    machine_values,
)
from orthoglide_cal.files.session_file import Session, session_text
from orthoglide_cal.files.yaml_tree import load_tree
from orthoglide_cal.model.cause import Effect, Estimate
from orthoglide_cal.model.linear_delta import CALLIPER_MM
from orthoglide_cal.model.machine import Details, Entered, JointOffsets, OwnGauge
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import Gauge, Orthoglide, double_posture
from tests.printers import CONFIG, UNEVEN, printer
from tests.truth.delta import TOLERANCES, delta_yaml

from .helpers import MACHINE, MODEL, PROTOTYPE, assert_fault, document, places, problems

DIGEST = "0123456789abcdef" * 4
TEXT, PRINTER = (path.read_text(encoding="utf-8") for path in (PROTOTYPE, CONFIG))
CALLIPER = str(yaml.safe_load(PRINTER)["probe"]["calliper_mm"])


def line_of(start: str) -> int:
    return next(n for n, line in enumerate(PRINTER.split("\n"), 1) if line.startswith(start))


def test_what_an_earlier_version_recorded_is_read():
    """It wrote whether the running controller was told; nothing asks for that any more."""
    written = {"target": "m.ini", "sha256_before": DIGEST, "sha256_after": DIGEST, "live": False}
    entry = {"date": "2024-05-04", "data_sha256": DIGEST, "written": written}
    values = {**machine_values(default_machine()), "history": [entry]}
    model = machine_from_text(yaml.safe_dump(values, sort_keys=False), "m.yaml")
    (kept,) = machine_values(model)["history"]
    assert kept["written"]["target"] == "m.ini"
    assert "live" not in kept["written"]


def read(text: str) -> Model:
    return machine_from_text(text, "m.yaml")


def changed(text: str, *pairs: tuple[str, str]) -> str:
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def test_what_nobody_stated_of_a_gauge_stays_out_of_the_file():
    silent = default_machine()
    gauge = silent.machine.gauge
    assert (gauge.placement_mm, gauge.scale_u) == (None, None)
    assert not {"placement_mm", "scale_u"} & set(machine_values(silent)["gauge"])
    plan = double_posture(silent.machine)
    stated = silent.machine.changed(gauge=gauge.changed(placement_mm=0.4, scale_u=0.0003))
    for machine, sizes in ((silent.machine, (0.001, 1.0)), (stated, (0.0003, 0.4))):
        influences = list(machine.uncertain(plan, lambda other: np.zeros(len(other))))
        assert tuple(one.size for one in influences) == sizes
        assert {one.assumed for one in influences} == {machine is silent.machine}


L = "leg_length_mm: 310.25"

BAD = [
    # replaced, by, line, path, value, words of the message, words of the remedy
    (L, "leg_length_mm: 012", 7, "leg_length_mm", "012", "octal", "leading zero"),
    (L, "leg_length_mm: 310,25", 7, "leg_length_mm", "310,25", "decimal comma", "decimal point"),
    (L, "leg_length_mm:", 7, "leg_length_mm", None, "must be a number", "plain number"),
    (L, "leg_lenght_mm: 310.25", 3, "leg_length_mm", None, "missing", "leg_length_mm: …"),
    (L, L + "\nkind:", 8, "kind", None, "kind of machine", "Known: orthoglide"),
    (L, L + "\nL: 3", 8, "L", "3", "not known", "Known here: kind, name"),
    (L, L + "\n" + L, 8, "leg_length_mm", "310.25", "given twice", "Remove"),
    ("[-100, 60]", "[60, -100]", 10, "joint_limits_mm", None, "ordered", "displacements"),
    ("[-100, 60]", "[-100, 370.25]", 10, "joint_limits_mm[1]", "370.25", "beyond", "not the joint"),
    ("[-100, 60]", "[-100]", 10, "joint_limits_mm[1]", None, "too short", "Add"),
    ("resolution_mm: 0.01", "resolution_mm: 0", 15, "gauge.resolution_mm", "0", "zero", "size"),
    ("{x: 0, y: 0, z: 0}", "{x: 0, q: 1}", 21, "offsets_mm.q", "1", "not known", "x, y, z"),
    ("misread: 0.1", "misred: 0.1", 36, "tolerances.misred", "misred", "not a cause id",
     "'misread'? Known: axis_gap"),
    ("backlash: 0.02", "backlash: 1e-300", 30, "tolerances.backlash", "1e-300", "from 1e-09",
     "0 to rule it out"),
    ("schema_version: 1", "schema_version: 2", 3, "schema_version", "2", "version", "Write 1"),
    ("name: Orthoglide prototype", "name: ''", 4, "name", "", "empty", "word"),
    ("axis_gap: 0.5", "tower_lean: 2.0", 26, "tolerances.tower_lean", "tower_lean",
     "of this kind of machine", "Known: axis_gap"),
    ("resolution_mm: 0.01", "resolution_mm: 1e-9", 15, "gauge.resolution_mm", "1e-9", "at least",
     "unit"),
    ("{x: 0, y: 0, z: 0}", "{x: 0, y: -161, z: 0}", 21, "offsets_mm.y", "-161",
     "travel of 160 mm", "Check"),
    ("width_mm: 80", "width_mm: 311", 8, "parallelogram_width_mm", "311", "wider than it is long",
     "Check d and L"),
]  # fmt: skip


A, R, T = "arm_length_mm: 344.1 ", "delta_radius_mm: 161.8", "[210, 330, 90]"
E = "{a: 420, b: 420, c: 420}"
BAD_OF_PRINTERS = [
    (T, "[330, 210, 90]", 10, "tower_angles_deg", None, "counter-clockwise", "[210, 330, 90]"),
    (R, "delta_radius_mm: 344.1", 9, "delta_radius_mm", "344.1", "as large as an arm",
     "horizontal distance"),
    (A, "arm_length_mm: [344, 344] ", 8, "arm_length_mm[2]", None, "too short", "Add"),
    (A, "arm_length_mm: [344, 344, 0.5] ", 8, "arm_length_mm[2]", "0.5", "at least 1", "unit"),
    (A, "arm_length_mm: [344, 344, 150] ", 9, "delta_radius_mm", "161.8", "as large as an arm",
     "horizontal"),
    (E, "{a: 420, b: 420}", 11, "endstops_mm.c", None, "missing", "c: …"),
    ("bed_radius_mm: 150", "bed_radius_mm: 150\nleg_length_mm: 3", 13, "leg_length_mm", "3",
     "not known", "Known here"),
    ("repeatability_mm: 0.012", "repeatability_mm: 0", 17, "probe.repeatability_mm", "0",
     "greater than zero", "size"),
    ("calliper_mm:", "caliper_mm:", 18, "probe.caliper_mm", CALLIPER, "not known",
     "'calliper_mm'?"),
    (f"calliper_mm: {CALLIPER}", "calliper_mm: 0", 18, "probe.calliper_mm", "0", "zero", "size"),
    ("misread: 0.1", "axis_gap: 0.1", line_of("  misread:"), "tolerances.axis_gap", "axis_gap",
     "of this kind of machine", "Known: "),
    ("probe_tilt: 0.05", "probe_tilt: 500", line_of("  probe_tilt:"), "tolerances.probe_tilt",
     "500", "1000 times", "in mm"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "old", "new", "line", "path", "value", "what", "remedy"),
    [*((TEXT, *row) for row in BAD), *((PRINTER, *row) for row in BAD_OF_PRINTERS)],
)
def test_faults_name_place_and_remedy(text, old, new, line, path, value, what, remedy):
    found = problems(read, changed(text, (old, new)))
    (fault,) = (fault for fault in found if fault.column == path)
    assert_fault(fault, (line, path, value), what, remedy)
    assert fault.file == "m.yaml"


def numbers(node: yaml.Node, path: str = "") -> Iterator[tuple[str, yaml.Node]]:
    """Every number of a YAML document, with its path."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            yield from numbers(value, f"{path}.{key.value}".lstrip("."))
    elif isinstance(node, yaml.SequenceNode):
        for value in node.value:
            yield from numbers(value, path)
    elif node.tag.endswith((":int", ":float")):
        yield path, node


@pytest.mark.parametrize("text", [TEXT, PRINTER], ids=["orthoglide", "printer"])
@pytest.mark.parametrize("wrong", ["x", ".nan", "1e300", "-1e300"])
def test_a_number_that_cannot_be_is_refused_wherever_it_stands(text, wrong):
    places = list(numbers(yaml.compose(text)))
    assert len(places) > 20
    for path, node in places:
        start, end = node.start_mark, node.end_mark
        (fault,) = problems(read, text[: start.index] + wrong + text[end.index :])
        assert (fault.line, fault.column.partition("[")[0]) == (start.line + 1, path)
        assert fault.value in (wrong, None)  # where it is one of a list that makes no sense
        assert fault.remedy


def test_all_faults_at_once_in_the_order_of_lines():
    text = changed(
        TEXT, (L, "leg_length_mm: x"), ("range_mm: 10", "rang_mm: 10"),
        ("axis_gap: 0.5", "axis_gap: y"), ("axis_squareness: 1.0", "axis_squareness: 5000"),
        ("misread: 0.1", "mis[ad: z"),
    )  # fmt: skip
    assert places(problems(read, text)) == [
        (7, "leg_length_mm", "x"), (14, "gauge.range_mm", None), (16, "gauge.rang_mm", "10"),
        (26, "tolerances.axis_gap", "y"), (27, "tolerances.axis_squareness", "5000"),
        (36, "tolerances.mis[ad", "z"), (36, "tolerances.mis[ad", "mis[ad"),
    ]  # fmt: skip


def test_an_unknown_kind_is_the_only_fault():
    """The rest is understood as what it most likely means."""
    for kind, wanted in (("linear_delt", "'linear_delta'?"), ("cartesian", "Known: orthoglide")):
        (fault,) = problems(read, changed(PRINTER, ("kind: linear_delta", f"kind: {kind}")))
        assert places([fault]) == [(4, "kind", kind)]
        assert wanted in fault.remedy
    missing, _ = problems(read, changed(PRINTER, ("kind: linear_delta", "kinds: linear_delta")))
    assert missing.remedy == "Add a line `kind: linear_delta`."


def test_optional_parts():
    model = read(
        "schema_version: 1\nname: bare\nleg_length_mm: 300\nparallelogram_width_mm: 80\n"
        "tool_offset_mm: 0\njoint_limits_mm: [-90, 50]\nworkspace_mm: 200\ntolerances:\n"
        "identified: ~\ngauge: {resolution_mm: 1e-3, range_mm: 12, revolution_mm: null,"
        " repeatability_mm: 0.002}\n"
    )
    machine = model.machine
    assert machine.kind == "orthoglide"
    assert machine.gauge.revolution_mm is None
    assert machine.offsets_mm == (0.0, 0.0, 0.0)
    assert machine.homing_mm is None
    assert model.machine.plausible == (5.0, 5.0, 5.0)
    assert dict(machine.tolerances) == {}
    assert model.accepted == ()


def test_optional_parts_of_a_printer():
    content = yaml.safe_load(PRINTER)
    del content["tolerances"], content["identified"]
    del content["probe"]["texture_mm"], content["probe"]["calliper_mm"]
    machine = read(yaml.safe_dump(content)).machine
    assert (machine.probe.calliper_mm, machine.probe.texture_mm) == (CALLIPER_MM, None)
    assert dict(machine.tolerances) == {}
    # Towers may be counted from any angle on.
    content["tower_angles_deg"] = [330.0, 90.0, 210.0]
    assert read(yaml.safe_dump(content)).machine.tower_angles_deg == (330.0, 90.0, 210.0)


def test_the_file_of_an_independent_program_with_three_arms():
    same = printer(UNEVEN, TOLERANCES)
    own = same.changed(name="truth-uneven", probe=same.probe.changed(texture_mm=UNEVEN.texture))
    machine = read(delta_yaml(UNEVEN)).machine
    assert machine == own
    assert machine.leg_mm == pytest.approx(np.mean(UNEVEN.arms))


@pytest.mark.parametrize(
    ("text", "what"),
    [("- a\n", "not a machine file"), ("leg,posture\n", "not a machine file"),
     ("machine: {}\nreadings: []\n", "is a session")],
)  # fmt: skip
def test_other_files_are_told_apart(text, what):
    with pytest.raises(InputError, match=what):
        read(text)


# Of no scale, and of a positive cause with nuisance parameters.
VALUES = {
    "axis_gap": ((0.31, 1 / 3), (-1e-5, 0.02), (0.07, 0.004)),
    "axis_squareness": ((1.1, 0.7), (-0.3, 0.2), (0.9, 0.0013)),
    "backlash": ((0.031, 0.004), (0.0, 0.003), (0.012, 0.0021)),
    "encoder_scale": ((0.0403, 0.9055), (-1.1537, 1.4668), (-0.9618, 1.0724)),
}
CORRELATION = np.array([[1.0, -0.4, 0.123456], [-0.4, 1.0, 0.3], [0.123456, 0.3, 1.0]])


def accepted(id: str = "axis_gap", correlation: np.ndarray = CORRELATION) -> Effect:
    cause = CAUSES[id]
    estimates = {
        name: Estimate(value=value, std=std, unit=cause.unit)
        for name, (value, std) in zip(cause.names, VALUES[id], strict=True)
    }
    return cause.estimated(estimates, correlation).accepted("2025-03-01", DIGEST)


def text_with(*effects: Effect) -> str:
    return machine_text(MODEL.extended(effects))


def assert_same(one: Effect, other: Effect) -> None:
    assert one.cause is other.cause
    assert one.place == other.place
    assert (one.date, one.data_sha256) == (other.date, other.data_sha256)
    np.testing.assert_allclose(one.theta, other.theta, rtol=1e-11, atol=0)
    np.testing.assert_allclose(one.std, other.std, rtol=1e-11, atol=0)
    np.testing.assert_allclose(one.correlation, other.correlation, rtol=0, atol=1e-6)


TEXTS = st.text(
    st.characters(codec="utf-8", exclude_categories=("Cc", "Cf", "Cs", "Cn", "Co", "Zl", "Zp")),
    min_size=1,
    max_size=12,
).filter(str.strip)
SIZES = {
    id: st.floats(1e-6, 100.0 * cause.sizes[Orthoglide]) | st.just(0.0)
    for id, cause in CAUSES.items()
    if Orthoglide in cause.sizes
}
ENTERED = st.tuples(*[st.floats(-1000.0, 1000.0)] * 3).map(
    lambda values: dict(zip("xyz", values, strict=True))
)
MACHINES = st.builds(
    MACHINE.changed,
    name=TEXTS,
    leg_length_mm=st.floats(200.0, 1e5),
    offsets_mm=st.builds(JointOffsets, *[st.floats(-160.0, 160.0)] * 3),
    gauge=st.builds(
        Gauge,
        resolution_mm=st.floats(1e-6, 1.0),
        range_mm=st.floats(1e-3, 1e3),
        revolution_mm=st.none() | st.floats(1e-3, 1e3),
        repeatability_mm=st.floats(1e-6, 1.0),
        placement_mm=st.none() | st.floats(0.0, 1.0),
        scale_u=st.none() | st.floats(0.0, 1.0),
    ),
    homing_mm=st.none() | st.floats(1e-3, 1e3),
    tolerances=st.fixed_dictionaries({}, optional=SIZES),
    report=st.builds(Details, place=st.none() | TEXTS, authorised_by=st.none() | TEXTS),
    gauges=st.lists(st.builds(OwnGauge, id=TEXTS, due=st.none()), max_size=2).map(tuple),
    history=st.lists(
        st.builds(
            Entered,
            date=st.just("2025-01-31"), before=ENTERED, after=ENTERED, data_sha256=st.just(DIGEST),
        ),
        max_size=2,
    ).map(tuple),
)  # fmt: skip


OF_PRINTERS = [
    CAUSES[id].at(CAUSES[id].scale * np.linspace(0.1, 0.7, CAUSES[id].unknowns))
    for id in ("tower_lean", "bed_shape")
]
MODELS = st.builds(
    Model,
    MACHINES,
    st.lists(st.sampled_from(sorted(VALUES)), unique=True).map(
        lambda ids: tuple(map(accepted, ids))
    ),
) | st.builds(
    Model,
    st.sampled_from([read(PRINTER).machine, read(delta_yaml(UNEVEN)).machine]),
    st.just(tuple(each.accepted("2026-01-01", DIGEST) for each in OF_PRINTERS)),
)


@given(MODELS)
@settings(max_examples=15)
def test_what_is_written_is_read_back_exactly(model):
    """The machine to the last digit, its causes to twelve; and read and written it stays so."""
    text = machine_text(model)
    again = read(text)
    assert again.machine == model.machine
    assert {**machine_values(again), "complete": True} == yaml.safe_load(text)
    assert machine_text(again) == text
    for after, before in zip(again.accepted, model.accepted, strict=True):
        assert_same(after, before)


def test_a_shape_that_was_found_with_fewer_terms_is_read():
    bed = CAUSES["bed_shape"]
    theta = np.concatenate((np.linspace(0.1, 0.7, 7), np.zeros(18)))
    found = bed.at(theta).accepted("2026-01-01", "0" * 64)
    content = yaml.safe_load(machine_text(read(PRINTER).extended([found])))
    kept = content["identified"][0]
    kept["parameters"] = {name: kept["parameters"][name] for name in bed.names[:7]}
    kept["correlation"] = np.eye(7).tolist()
    (again,) = read(yaml.safe_dump(content)).accepted
    assert again.theta == pytest.approx(theta)


def test_an_accepted_cause_is_written_with_all_that_is_known_of_it():
    (entry,) = yaml.safe_load(text_with(accepted()))["identified"]
    assert list(entry) == ["cause", "where", "parameters", "date", "data_sha256", "correlation"]
    assert entry["where"] == ""
    assert entry["parameters"]["xy"] == {"value": 0.31, "std": 0.333333333333, "unit": "mm"}


def test_parameters_in_another_order_keep_their_correlations():
    content = yaml.safe_load(text_with(accepted()))
    (entry,) = content["identified"]
    order = [2, 0, 1]
    names = [list(entry["parameters"])[k] for k in order]
    entry["parameters"] = {name: entry["parameters"][name] for name in names}
    entry["correlation"] = CORRELATION[np.ix_(order, order)].tolist()
    text = yaml.safe_dump(content, sort_keys=False)
    (found,) = read(text).accepted
    assert_same(found, accepted())


def entry_with(change: dict, id: str = "axis_gap") -> str:
    """A file whose only accepted cause is changed by these keys; None takes one out."""
    content = yaml.safe_load(text_with(accepted(id)))
    (entry,) = content["identified"]
    for key, value in change.items():
        *outer, last = key.split(".")
        place = entry
        for name in outer:
            place = place[name]
        place.pop(last, None)
        if value is not None:
            place[last] = value
    return yaml.safe_dump(content, sort_keys=False)


NAMES = "axis_gap has the parameters xy, yz, zx"
OTHER = {"value": 1, "std": 1, "unit": "mm"}


@pytest.mark.parametrize(
    ("id", "change", "path", "value", "what"),
    [
        ("axis_gap", {"data_sha256": "abc"}, "data_sha256", "abc", "not a SHA-256"),
        ("axis_gap", {"date": "yesterday"}, "date", "yesterday", "not a date"),
        ("axis_gap", {"cause": "gap"}, "cause", "gap", "not a cause id"),
        ("axis_gap", {"parameters.yz.std": -1}, "parameters.yz.std", "-1", "not be negative"),
        ("axis_gap", {"parameters.zx": [0.1, 0.01, "mm"]}, "parameters.zx", None, "group of keys"),
        ("axis_gap", {"parameters.xy.unit": "mrad"}, "parameters.xy.unit", "mrad",
         "measured in mm, not 'mrad'"),
        ("axis_gap", {"where": None, "whre": ""}, "whre", "", "not known"),
        ("axis_gap", {"where": "leg x"}, "where", "leg x", "the whole machine"),
        ("axis_gap", {"cause": "tower_lean"}, "cause", "tower_lean", "of this kind of machine"),
        ("backlash", {"parameters.x.value": -0.031}, "parameters.x.value", "-0.031", "negative"),
        ("axis_gap", {"correlation": None, "parameters.zx": None}, "parameters", None, NAMES),
        ("axis_gap", {"correlation": None, "parameters.yy": OTHER}, "parameters", None, NAMES),
        ("axis_gap", {"correlation": None, "parameters.yz": None, "parameters.g_yz": OTHER},
         "parameters", None, NAMES),
        ("axis_gap", {"correlation": [[1, 0.1, 0], [0.1, 1], [0, 0, 1]]}, "correlation", None,
         "3 rows of 3"),
        ("axis_gap", {"correlation": [[1, 0.1, 0], [0.2, 1, 0], [0, 0, 1]]}, "correlation", None,
         "not correlations"),
        ("axis_gap", {"correlation": [[0.9, 0.1, 0], [0.1, 1, 0], [0, 0, 1]]}, "correlation", None,
         "not correlations"),
        ("axis_gap", {"correlation": [[1, 1.1, 0], [1.1, 1, 0], [0, 0, 1]]}, "correlation", None,
         "not correlations"),
    ],
)  # fmt: skip
def test_accepted_causes_are_checked(id, change, path, value, what):
    text = entry_with(change, id)
    (fault,) = problems(read, text)
    assert (fault.column, fault.value) == (f"identified[0].{path}", value)
    assert what in fault.what
    assert re.match(
        f"[ -]*{path.rpartition('.')[2]}: ?'?{value or ''}", text.split("\n")[fault.line - 1]
    )


def test_only_lasting_causes_are_part_of_a_machine():
    """Whatever its parameters are: a knock against the stand is of one session."""
    text = changed(
        text_with(accepted("encoder_scale"), accepted()), ("cause: axis_gap", "cause: misread")
    )
    (fault,) = problems(read, text)
    line = text.split("\n").index("- cause: misread") + 1
    assert places([fault]) == [(line, "identified[1].cause", "misread")]
    assert "cannot be part of a machine" in fault.what
    assert "Use one of axis_gap, " in fault.remedy
    for passing in ("stand_shift", "swapped_gauges", "gauge_drift"):
        assert passing not in fault.remedy


@pytest.mark.parametrize("text", ["k{}: 1\n", "tolerances:\n", "name: x\n", "machine: 1\n"])
def test_many_faults_are_found_quickly(text):
    body = "".join(f"  misread{i}: 1\n" for i in range(25_000)) if "tol" in text else ""
    text = "".join(text.format(i) for i in range(1 if body else 25_000)) + body
    start = time.process_time()
    assert len(problems(read, text)) <= 1001
    assert time.process_time() - start < 3.0


def test_correlations_may_be_missing():
    (found,) = read(entry_with({"correlation": None})).accepted
    assert_same(found, accepted(correlation=np.eye(3)))


# --- history and details -----------------------------------------------------------------------

HISTORY = """
history:
- {date: 2025-01-31, before: {x: 0, y: 0, z: 0}, after: {x: 0.4, y: -0.1, z: 0},
   data_sha256: DIGEST}
report:
  organisation: Foundry of Nantes
  serial_number: "0042"
  gauge_due: 2026-03-01
""".replace("DIGEST", DIGEST)


def test_history_and_details_are_read_also_in_a_session(tmp_path):
    model = read(TEXT + HISTORY)
    (entry,) = model.machine.history
    assert (entry.date, entry.active) == ("2025-01-31", ((0, 0, 0), (0.4, -0.1, 0)))
    assert model.machine.entered_from(DIGEST) == entry
    assert model.machine.entered_from("0" * 64) is None
    report = model.machine.report
    assert (report.organisation, report.serial_number) == ("Foundry of Nantes", "0042")
    assert (report.gauge_due, report.customer) == ("2026-03-01", None)
    held = machine_in(load_tree(document(session_text(Session(machine=model)))), ("machine",))
    assert held.machine == model.machine


@pytest.mark.parametrize(
    ("old", "new", "column"),
    [
        ("date: 2025-01-31", "date: today", "history[0].date"),
        ("x: 0.4, ", "", "history[0].after.x"),
        (DIGEST, "abc", "history[0].data_sha256"),
        ("serial_number", "number", "report.number"),
        ("gauge_due: 2026-03-01", "gauge_due: soon", "report.gauge_due"),
    ],
)
def test_faults_of_history_and_details(old, new, column):
    found = problems(read, TEXT + changed(HISTORY, (old, new)))
    assert [fault.column for fault in found] == [column]


def test_a_file_that_was_cut_off_is_noticed():
    """Wherever: a cause less would move the offsets without a word."""
    text = text_with(*map(accepted, VALUES))
    lines = text.splitlines(keepends=True)
    for end in range(1, len(lines)):
        assert problems(read, "".join(lines[:end]))
    assert len(read(text).accepted) == len(VALUES)


def test_a_file_of_ones_own_without_identified_gets_a_remark(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(TEXT.replace("identified: []", ""))
    (remark,) = check_file(str(path))[0].remarks
    assert remark.code == "no_identified"
    assert check_file(str(PROTOTYPE))[0].remarks == ()
