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
from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.files.machine_file import (
    StoredMachine,
    default_machine,
    machine_file_in,
    machine_in,
    machine_text,
    machine_values,
    stored_machine,
    with_entry,
    without_entry,
)
from orthoglide_cal.files.readings import Session, session_text
from orthoglide_cal.files.text import document_from_bytes
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
    model = stored_machine(yaml.safe_dump(values, sort_keys=False), "m.yaml").model
    (kept,) = machine_values(model)["history"]
    assert kept["written"]["target"] == "m.ini"
    assert "live" not in kept["written"]


def test_what_could_not_be_read_again_is_not_recorded() -> None:
    """159.9 mm and 0.2 mm more are beyond the travel."""
    file = stored(TEXT.replace("{x: 0,", "{x: 159.9,"))
    with pytest.raises(InputError, match="larger than the travel"):
        with_entry(file, entry(159.9, 160.1))


def read(text: str) -> Model:
    return stored_machine(text, "m.yaml").model


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


# --- edited in place: what is not changed stays, letter by letter ------------------------------


def stored(text: str | bytes) -> StoredMachine:
    data = text if isinstance(text, bytes) else text.encode()
    return machine_file_in(load_tree(document_from_bytes(data, "m.yaml")))


def entry(before: float, after: float, day: int = 31) -> Entered:
    first, then = ({"x": x, "y": 0.0, "z": 0.0} for x in (before, after))
    return Entered(date=f"2025-01-{day}", before=first, after=then, data_sha256=DIGEST)


KEY = "offsets_mm: {x: 0, y: 0, z: 0}"
OLD = f"\n  - {{date: 2025-01-02, data_sha256: {DIGEST}}}"


@pytest.mark.parametrize(
    "text",
    [
        TEXT,
        TEXT.replace(KEY, "offsets_mm: {x: 0.e0, 'y': \"0\",\n  z: +0} # now"),
        TEXT.replace(KEY, "offsets_mm:\n  x: 0   # first\n  y: 0\n  # of z\n  z: 0"),
        TEXT.replace(KEY, "offsets_mm:  # none"),
        TEXT.replace(KEY, "# nothing"),
        TEXT.replace("\n", "\r\n"),
        TEXT.replace("\n", "\r\n", 9),
        "\ufeff" + TEXT,
        TEXT.rstrip(),
        TEXT + "history:\n\n# end\n",
        TEXT + "history: ~ # none",
        TEXT + "history: []\ncomplete: true",
        f"{TEXT}history: # old{OLD} # first{OLD}\n# end\n",
        f"{TEXT}history:{OLD}",
        f"{TEXT}history:\n# old{OLD}",
        f"{TEXT}history: [{OLD[5:]}]\n",
        json.dumps(parsed(TEXT)),
        json.dumps(parsed(TEXT), indent=1),
    ],
)  # fmt: skip
def test_what_is_entered_is_taken_back_to_the_byte(text: str) -> None:
    files = [stored(text)]
    for day, after in enumerate((0.43, 0.25, 1e-5), 11):
        active = files[-1].model.machine.active[0]
        files.append(stored(with_entry(files[-1], entry(active, after, day)).document.data))
        assert files[-1].model.machine.history[-1].active[1] == (after, 0.0, 0.0)
        assert files[-1].model.machine.active == (after, 0.0, 0.0)
    for remark in ("# L, the", "# now", "# first", "# of z", "# end"):
        assert (remark in files[-1].document.text) == (remark in text)
    while len(files) > 1:
        again = without_entry(files.pop()).document.data
        assert again == files[-1].document.data


@pytest.mark.parametrize(("old", "new"), [("{x: 0.4,", "{x:  0.4,"), (r"\n  replaced:.*", "")])
def test_what_was_changed_since_is_to_be_restored_by_hand(old: str, new: str) -> None:
    """Also entries of earlier versions, which did not keep what they replaced."""
    text = with_entry(stored(TEXT), entry(0.0, 0.4)).document.text
    changed = re.sub(old, new, text, flags=re.DOTALL)
    assert changed != text
    with pytest.raises(UsageError, match=r"(?s)by hand.*offsets_mm: {x: 0.0, y: 0.0, z: 0.0}"):
        without_entry(stored(changed))
