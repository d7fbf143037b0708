"""The machine file of both kinds: what is accepted, what is refused and how, round trips, edits."""

import json
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
    edited,
    machine_file_in,
    machine_from_text,
    machine_in,
    machine_text,
    machine_values,
    with_history,
)
from orthoglide_cal.files.readings import Session, session_text
from orthoglide_cal.files.tree import load_tree
from orthoglide_cal.model.linear_delta import CALLIPER_MM
from orthoglide_cal.model.machine import Details, Entered, JointOffsets, OwnGauge
from orthoglide_cal.model.model import Effect, Estimate, Model
from orthoglide_cal.model.orthoglide import Gauge, Orthoglide, double_posture
from tests.printers import CONFIG, UNEVEN, printer
from tests.truth.delta import TOLERANCES, delta_yaml

from .helpers import MACHINE, MODEL, PROTOTYPE, document, parsed, places, problems, replaced

DIGEST = "0123456789abcdef" * 4
TEXT, PRINTER = (path.read_text(encoding="utf-8") for path in (PROTOTYPE, CONFIG))


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


def test_what_could_not_be_read_again_is_not_recorded() -> None:
    """159.9 mm and 0.2 mm more are beyond the travel."""
    file = machine_file_in(load_tree(document(TEXT.replace("{x: 0,", "{x: 159.9,"))))
    before, after = ({"x": x, "y": 0.0, "z": 0.0} for x in (159.9, 160.1))
    entry = Entered(date="2025-01-31", before=before, after=after, data_sha256=DIGEST)
    with pytest.raises(InputError, match="larger than the travel"):
        with_history(file, after, None, entry)


def test_what_could_not_be_taken_back_exactly_is_not_recorded() -> None:
    before, after = ({"x": x, "y": 0.0, "z": 0.0} for x in (0.0, 0.1))
    entry = Entered(date="2025-01-31", before=before, after=after, data_sha256=DIGEST)
    for text in (f"{TEXT}history:\n", json.dumps(yaml.safe_load(TEXT))):
        with pytest.raises(InputError, match="could not restore this file exactly"):
            with_history(machine_file_in(load_tree(document(text))), after, None, entry)


def read(text: str) -> Model:
    return machine_from_text(text, "m.yaml")


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
    text = replaced(TEXT, {
        "leg_length_mm: 310.25": "leg_length_mm: x", "range_mm: 10": "rang_mm: 10",
        "axis_gap: 0.5": "axis_gap: y", "axis_squareness: 1.0": "axis_squareness: 5000",
        "misread: 0.1": "mis[ad: z",
    })  # fmt: skip
    assert places(problems(read, text)) == [
        (7, "leg_length_mm", "x"), (14, "gauge.range_mm", None), (16, "gauge.rang_mm", "10"),
        (26, "tolerances.axis_gap", "y"), (27, "tolerances.axis_squareness", "5000"),
        (36, "tolerances.mis[ad", "z"), (36, "tolerances.mis[ad", "mis[ad"),
    ]  # fmt: skip


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
    content = parsed(PRINTER)
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
    st.just(tuple(effect.accepted("2026-01-01", DIGEST) for effect in OF_PRINTERS)),
)


@given(MODELS)
@settings(max_examples=15)
def test_what_is_written_is_read_back_exactly(model):
    """The machine to the last digit, its causes to twelve; and read and written it stays so."""
    text = machine_text(model)
    again = read(text)
    assert again.machine == model.machine
    assert {**machine_values(again), "complete": True} == parsed(text)
    assert machine_text(again) == text
    for after, before in zip(again.accepted, model.accepted, strict=True):
        assert_same(after, before)


def test_a_shape_that_was_found_with_fewer_terms_is_read():
    bed = CAUSES["bed_shape"]
    theta = np.concatenate((np.linspace(0.1, 0.7, 7), np.zeros(18)))
    found = bed.at(theta).accepted("2026-01-01", "0" * 64)
    content = parsed(machine_text(read(PRINTER).extended([found])))
    kept = content["identified"][0]
    kept["parameters"] = {name: kept["parameters"][name] for name in bed.names[:7]}
    kept["correlation"] = np.eye(7).tolist()
    (again,) = read(yaml.safe_dump(content)).accepted
    assert again.theta == pytest.approx(theta)


def test_an_accepted_cause_is_written_with_all_that_is_known_of_it():
    (entry,) = parsed(text_with(accepted()))["identified"]
    assert list(entry) == ["cause", "where", "parameters", "date", "data_sha256", "correlation"]
    assert entry["where"] == ""
    assert entry["parameters"]["xy"] == {"value": 0.31, "std": 0.333333333333, "unit": "mm"}


def test_parameters_in_another_order_keep_their_correlations():
    content = parsed(text_with(accepted()))
    (entry,) = content["identified"]
    order = [2, 0, 1]
    names = [list(entry["parameters"])[k] for k in order]
    entry["parameters"] = {name: entry["parameters"][name] for name in names}
    entry["correlation"] = CORRELATION[np.ix_(order, order)].tolist()
    text = yaml.safe_dump(content, sort_keys=False)
    (found,) = read(text).accepted
    assert_same(found, accepted())


@pytest.mark.parametrize("text", ["k{}: 1\n", "tolerances:\n", "name: x\n", "machine: 1\n"])
def test_many_faults_are_found_quickly(text):
    body = "".join(f"  misread{i}: 1\n" for i in range(25_000)) if "tol" in text else ""
    text = "".join(text.format(i) for i in range(1 if body else 25_000)) + body
    start = time.process_time()
    assert len(problems(read, text)) <= 1001
    assert time.process_time() - start < 3.0


def test_correlations_may_be_missing():
    text = re.sub(r"  correlation:\n(  - .*\n)+", "", text_with(accepted()))
    (found,) = read(text).accepted
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


# --- edited in place: what is not changed stays, letter by letter ------------------------------


def test_only_the_line_of_the_key_changes() -> None:
    new = edited(TEXT, {("leg_length_mm",): 400, ("gauge", "range_mm"): 12.5})
    before, after = TEXT.splitlines(), new.splitlines()
    assert [(a, b) for a, b in zip(before, after, strict=True) if a != b] == [
        (
            "leg_length_mm: 310.25          # L, the parallelograms' length",
            "leg_length_mm: 400          # L, the parallelograms' length",
        ),
        ("  range_mm: 10", "  range_mm: 12.5"),
    ]


ENTRIES = [{"date": "2025-01-31", "before": {"x": 0.0}, "after": {"x": -0.25}}]
OTHER = {"x": 0.43, "y": -0.2, "z": 0.0}


@pytest.mark.parametrize(
    "text",
    [
        "name: a # b\noffsets_mm: {x: 0, y: 0, z: 0} # now\nidentified: []\n",
        "offsets_mm:\n  x: 0   # first\n  y: 0\n  # of z\n  z: 0\nname: a",
        "offsets_mm: {x: 0}\nhistory: []\nname: a\n",
        "offsets_mm:\nhistory:\n\n# of the name\nname: a\n",
        "offsets_mm: {x: 0,\n  y: 0, z: 0}\nhistory: ~ # none\nname: a\n",
        "history:\n  - {date: a}\n  # second\n  - date: b\n    after: {x: 1} # end\nname: a\n",
        'name: "a"\nhistory:\n- date: a\n  before: {x: 0}\n- {date: b}\n# the end\n',
    ],
)
def test_values_are_those_asked_for_and_every_comment_outside_them_stays(text: str) -> None:
    wanted = {"offsets_mm": OTHER, "history": ENTRIES}
    offsets = {("offsets_mm", axis): value for axis, value in OTHER.items()}
    whole = offsets if "# first" in text else {("offsets_mm",): OTHER}
    new = edited(text, {**whole, ("history",): ENTRIES})
    assert yaml.safe_load(new) == {**yaml.safe_load(text), **wanted}
    for comment in ("# b", "# now", "# first", "# of z", "# of the name", "# none", "# the end"):
        assert (comment in new) == (comment in text)


@pytest.mark.parametrize(
    "text",
    [
        "a: 1\nh: []\n",
        "a: 1\nh: [] # none",
        "h:\n  - a: 0 # first\n\n# then\nb: 2\n",
        "h:\r\n- {a: 0}\r\n- b: 1\r\n",
        '{"h": [{"a": 0}, {"b": 1}], "complete": true}\n',
    ],
)
def test_an_item_comes_last_and_goes_again(text: str) -> None:
    items = yaml.safe_load(text)["h"]
    new = edited(text, {("h", len(items)): {"x": 1, "y": [1, 2], "z": {"b": [{"c": 1}]}}}, " # no")
    assert yaml.safe_load(new)["h"][:-1] == items
    assert "\r" not in text or new.count("\r\n") == new.count("\n")
    assert yaml.safe_load(new)["h"][-1]["z"] == {"b": [{"c": 1}]}
    assert edited(new, {("h", len(items)): None}) == text


@pytest.mark.parametrize("text", ["a: 1", "a:\n  b: 1 # b\n# end\n", "a: 1\n\ncomplete: true\n"])
def test_a_key_comes_last_and_goes_again(text: str) -> None:
    new = edited(text, {("h",): [{"x": 1}], ("v",): {"x": 1}}, " # new")
    assert new.count(" # new\n") == 2 or new.endswith(" # new")
    assert yaml.safe_load(new) == {**yaml.safe_load(text), "h": [{"x": 1}], "v": {"x": 1}}
    assert edited(new, {("v",): None, ("h",): None}) == text
