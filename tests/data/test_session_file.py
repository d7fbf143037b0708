"""Session files: round trips, recognition by content, faults, and the machine inside."""

import dataclasses

import pytest

from orthoglide_cal.data import (
    MachineModel,
    RetakenReading,
    SessionGauge,
    SessionReading,
    SessionRecord,
    SkippedStep,
    read_input,
    read_machine,
    read_measured,
    read_session,
    session_readings,
    session_text,
    write_session,
)
from orthoglide_cal.data.session_schema import Step
from orthoglide_cal.errors import InputError, UsageError

from .helpers import MACHINE, PROTOTYPE, places, problems

LARGE = read_machine(PROTOTYPE.with_name("orthoglide_large.yaml"))


def record(machine=MACHINE, **changes) -> SessionRecord:
    steps = [("x", "iso", "y"), ("x", "max", "z"), ("y", "-20.5", "x"), ("z", "min", "y")]
    content = {
        "machine": MachineModel.from_machine(machine),
        "protocol": "double-posture",
        "operator": "M. Muster: # 'quoted'",
        "gauges": [SessionGauge(id="012", certificate="1e-3", resolution=0.01)],
        "started": "2025-03-01T09:00:00+01:00",
        "finished": None,
        "environment": {"temperature_c": "20.5", "note": "null"},
        "readings": [
            SessionReading(
                leg=leg, posture=posture, direction=direction, reading_mm=k / 3 - 0.4, seq=k + 1,
                cycle=1, minutes=0.37 * k, temperature_c=20 + k / 7, gauge="012", gauge_at=0.45,
                note="" if k else "yes: 1", timestamp=f"2025-03-01T09:0{k}:30.250+01:00",
            )
            for k, (leg, posture, direction) in enumerate(steps)
        ],
        "retaken": [
            RetakenReading(
                leg="x", posture="iso", direction="y", reading_mm=9.9, seq=1, reason="slipped"
            )
        ],
        "skipped": [SkippedStep(leg="z", posture="iso", direction="x", reason="no access")],
    }  # fmt: skip
    return SessionRecord(**{**content, **changes})


def save(tmp_path, text, name="session.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return str(path)


def test_round_trip_is_exact(tmp_path):
    path = tmp_path / "s.yaml"
    write_session(record(), path)
    assert read_session(path) == record()
    assert path.read_text() == session_text(record())


def test_readings_come_back_exactly(tmp_path):
    path = save(tmp_path, session_text(record()))
    read = read_measured(path, MACHINE)
    assert read.value.tolist() == [k / 3 - 0.4 for k in range(4)]
    assert read.plan.hours.tolist() == [0.37 * k / 60 for k in range(4)]
    assert read.plan.gauge_at.tolist() == [0.45] * 4
    assert read.temperature.tolist() == [20 + k / 7 for k in range(4)]
    assert read.posture == ("iso", "max", "-20.5", "min")
    assert read.gauge == ("012",) * 4
    assert read.note == ("yes: 1", "", "", "")
    assert read.timed
    assert len(read.source.sha256) == 64


def test_in_memory_as_from_the_file(tmp_path):
    path = save(tmp_path, session_text(record()))
    read = read_measured(path, MACHINE)
    live = session_readings(record(), read.source)
    for field in dataclasses.fields(read.plan):
        assert getattr(live.plan, field.name).tolist() == getattr(read.plan, field.name).tolist()
    for name in ("value", "cycle", "temperature"):
        assert getattr(live, name).tolist() == getattr(read, name).tolist()
    assert (live.posture, live.gauge, live.note, live.timed, live.remarks) == (
        read.posture, read.gauge, read.note, read.timed, read.remarks,
    )  # fmt: skip


@pytest.mark.parametrize("name", ["session.yaml", "session", "data.csv", "x.txt"])
@pytest.mark.parametrize("before", ["", "# a comment, with commas\n\n", "---\n", "\ufeff"])
def test_recognised_by_content(tmp_path, name, before):
    path = save(tmp_path, before + session_text(record()), name)
    assert len(read_measured(path, MACHINE)) == 4


def test_json_is_yaml(tmp_path):
    import json

    content = json.dumps(record().model_dump(mode="json"))
    assert len(read_measured(save(tmp_path, content, "s.json"), MACHINE)) == 4


def test_an_unfinished_session_without_readings(tmp_path):
    empty = record(readings=(), finished=None)
    path = save(tmp_path, session_text(empty))
    assert read_session(path) == empty
    assert "no reading" in problems(read_measured, path, MACHINE)[0].what


def test_the_machine_inside_is_used_unless_another_is_named(tmp_path):
    path = save(tmp_path, session_text(record(LARGE)))
    read, machine = read_input(path)
    assert machine == LARGE
    assert read.plan.displacement.tolist() == [0.0, 90.0, -20.5, -140.0]
    assert read.remarks == ()
    read, machine = read_input(path, MACHINE)
    assert machine == MACHINE
    assert read.plan.displacement.tolist() == [0.0, 60.0, -20.5, -100.0]
    assert "differs from the machine given" in read.remarks[0]
    assert "leg_length_mm" in read.remarks[0]


def test_the_default_machine_for_a_table(tmp_path):
    path = save(tmp_path, "leg,posture,direction,reading_mm\nx,max,y,1\n", "d.csv")
    read, machine = read_input(path)
    assert machine == MACHINE
    assert read.plan.displacement.tolist() == [60.0]


def without(text: str, *keys: str) -> str:
    import re

    for key in keys:
        text = re.sub(rf" {key}: [^,}}]*,", "", text)
    return text


def test_minutes_from_timestamps(tmp_path):
    path = save(tmp_path, without(session_text(record()), "minutes"))
    read = read_measured(path, MACHINE)
    assert read.timed
    assert (read.plan.hours * 3600).tolist() == pytest.approx([30.25, 90.25, 150.25, 210.25])


def test_timestamps_without_a_start(tmp_path):
    text = without(session_text(record(started=None)), "minutes")
    read = read_measured(save(tmp_path, text), MACHINE)
    assert (read.plan.hours * 3600).tolist() == pytest.approx([0.0, 60.0, 120.0, 180.0])


def test_mixed_time_zones(tmp_path):
    text = without(session_text(record(started="2025-03-01T09:00:00")), "minutes")
    found = problems(read_measured, save(tmp_path, text), MACHINE)
    assert "time zone" in found[0].what


def test_resolution_with_its_unit_and_inches(tmp_path):
    text = session_text(record()).replace("resolution: 0.01", "resolution_mm: 0.001")
    text = text.replace("reading_mm: -0.4,", "reading_in: -0.01,")
    path = save(tmp_path, text)
    assert read_session(path).gauges[0].resolution == 0.001
    assert read_session(path).readings[0].reading_mm == -0.254
    assert read_measured(path, MACHINE).value[0] == -0.254


BAD = [
    ("leg: x", "leg: w", "readings[0].leg", "w", "not an axis"),
    ("direction: y, cycle", "direction: x, cycle", "readings[0].direction", "x", "own axis"),
    ("posture: max", "posture: 99", "readings[1].posture", "99", "joint limits"),
    ("posture: max", "posture: [a]", "readings[1].posture", None, "One value"),
    ("reading_mm: -0.4", "reading_mm: 1:30", "readings[0].reading_mm", "1:30", "not a number"),
    ("reading_mm: -0.4", "reading_mm: on", "readings[0].reading_mm", "on", "not a number"),
    ("reading_mm: -0.4", "reading_mm: 012", "readings[0].reading_mm", "012", "octal"),
    ("reading_mm: -0.4, ", "", "readings[0].reading_mm", None, "missing"),
    ("seq: 2", "seq: 1", "readings[1].seq", "1", "line"),
    ("minutes: 0.74", "minutes: 0.1", "readings[2].minutes", "0.1", "backwards"),
    ("09:00:30.250", "soon", "readings[0].timestamp", "2025-03-01Tsoon+01:00", "not a time"),
    ("started: '2025-03-01T09:00:00+01:00'", "started: early", "started", "early", "not a time"),
    ("leg_length_mm: 310.25", "leg_length_mm: -1", "machine.leg_length_mm", "-1", "zero"),
    ("id: '012'", "id: ''", "gauges[0].id", "", "empty"),
    ("leg: z, posture: iso", "leg: q, posture: iso", "skipped[0].leg", "q", "not an axis"),
    ("reading_mm: 9.9", "reading_in: x", "retaken[0]", None, "not a number"),
    ("schema_version: 1\nmachine", "schema_version: 9\nmachine", "schema_version", "9", "version"),
    ("protocol: double", "machine: 2\nprotocol: double", "machine", "2", "twice"),
]


@pytest.mark.parametrize(("old", "new", "column", "value", "what"), BAD)
def test_faults_name_place_and_remedy(tmp_path, old, new, column, value, what):
    text = session_text(record())
    assert old in text
    changed = text.replace(old, new, 1)
    found = problems(read_measured, save(tmp_path, changed), MACHINE)
    assert [(fault.column, fault.value) for fault in found] == [(column, value)]
    assert what in found[0].what
    assert found[0].remedy
    same = [a == b for a, b in zip(text.split("\n"), changed.split("\n"), strict=False)]
    assert found[0].line == same.index(False) + 1
    assert places(problems(read_session, save(tmp_path, changed))) == places(found)


def test_entries_that_are_no_readings(tmp_path):
    text = session_text(record())
    head = text[: text.index("readings:")]
    found = problems(read_measured, save(tmp_path, head + "readings: [a, {leg: x}]\n"), MACHINE)
    assert [fault.column for fault in found] == [
        "readings[0]", "readings[1].direction", "readings[1].posture", "readings[1].reading_mm",
    ]  # fmt: skip
    found = problems(read_measured, save(tmp_path, head + "readings: {a: b}\n"), MACHINE)
    assert found[0].column == "readings"


def test_unknown_keys_are_said(tmp_path):
    text = session_text(record()).replace("operator:", "weather: rain\noperator:")
    text = text.replace("leg: x,", "leg: x, colour: red,")
    remarks = read_measured(save(tmp_path, text), MACHINE).remarks
    assert any("weather" in remark for remark in remarks)
    assert any("colour" in remark for remark in remarks)


@pytest.mark.parametrize(
    ("text", "what"),
    [(PROTOTYPE.read_text(), "machine file"), ("a: 1\n", "neither"), ("- 1\n", "neither"),
     ("readings: []\n", "missing")],
)  # fmt: skip
def test_other_yaml_is_told_apart(tmp_path, text, what):
    with pytest.raises(InputError, match=what) as caught:
        read_measured(save(tmp_path, text), MACHINE)
    assert caught.value.remedy


def test_an_existing_session_is_not_overwritten_silently(tmp_path):
    path = tmp_path / "s.yaml"
    write_session(record(), path)
    with pytest.raises(UsageError, match="not overwritten"):
        write_session(record(operator="other"), path)
    assert read_session(path).operator == record().operator
    write_session(record(operator="other"), path, overwrite=True)
    assert read_session(path).operator == "other"


def test_models_refuse_what_cannot_be_written():
    from pydantic import ValidationError

    for wrong in ({"leg": "q"}, {"posture": " "}, {"end": "top"}, {"leg": True}):
        with pytest.raises(ValidationError):
            Step(**{"leg": "x", "posture": "iso", "direction": "y", **wrong})
    with pytest.raises(ValidationError):
        SessionReading(leg="x", posture="iso", direction="y", reading_mm=float("nan"))
