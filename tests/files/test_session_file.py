"""Session files: round trips, recognition by content, faults, and the machine inside."""

import json
import re

import pytest

from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.machine_file import (
    machine_text,
    machine_values,
    read_machine_file,
    stored_machine,
)
from orthoglide_cal.files.readings import (
    Conditions,
    GaugeIdentity,
    Session,
    session_json,
    session_text,
)
from tests.machines import extended
from tests.sentences import sentences

from .helpers import MODEL, PROTOTYPE, problems, replaced, saved

LARGE = read_machine_file(PROTOTYPE.with_name("orthoglide_large.yaml")).model


def values(model=MODEL, **changes) -> Session:
    steps = [("x", "iso", "y"), ("x", "max", "z"), ("y", "-20.5", "x"), ("z", "min", "y")]
    content = {
        "machine": model,
        "protocol": "double-posture",
        "operator": "M. Muster: # 'quoted'",
        "gauges": [{"id": "012", "certificate": "1e-3", "resolution": 0.01}],
        "started": "2025-03-01T09:00:00+01:00",
        "environment": {"temperature_c": "20.5", "note": "null"},
        "readings": [
            {
                "leg": leg, "posture": posture, "direction": direction, "end": None, "cycle": 1,
                "reading_mm": k / 3 - 0.4, "seq": k + 1, "minutes": 0.37 * k,
                "temperature_c": 20 + k / 7, "gauge": "012", "gauge_at": 0.45,
                "note": "" if k else "yes: 1", "timestamp": f"2025-03-01T09:0{k}:30.250+01:00",
            }
            for k, (leg, posture, direction) in enumerate(steps)
        ],
        "retaken": [
            {"leg": "x", "posture": "iso", "direction": "y", "reading_mm": 9.9, "reason": "slipped"}
        ],
        "skipped": [{"leg": "z", "posture": "iso", "direction": "x", "reason": "no access"}],
    }  # fmt: skip
    return Session(**{**content, **changes})


def save(tmp_path, text, name="session.yaml"):
    return saved(tmp_path, text, name)


def test_the_conditions_are_those_of_the_file(tmp_path):
    given = read_input(save(tmp_path, session_text(values()))).conditions
    assert given == Conditions(
        protocol="double-posture",
        operator="M. Muster: # 'quoted'",
        started="2025-03-01T09:00:00+01:00",
        temperature_c=tuple(20 + k / 7 for k in range(4)),
        environment={"temperature_c": "20.5", "note": "null"},
        gauges=(GaugeIdentity(id="012", certificate="1e-3", resolution_mm=0.01),),
        retaken=1,
        skipped=1,
        notes=((given.notes[0][0], "yes: 1"),),
    )
    noted = session_text(values()).split("\n")[given.notes[0][0] - 1]
    assert noted.startswith("- {leg: x, posture: iso")
    # Labels without an entry are gauges too.
    other = values(gauges=[{"id": "7"}], environment={"sky": "foggy"})
    given = read_input(save(tmp_path, session_text(other))).conditions
    assert given.gauges == (GaugeIdentity(id="7"), GaugeIdentity(id="012"))
    assert given.environment == {"sky": "foggy"}


@pytest.mark.parametrize("name", ["session.yaml", "data.csv"])
@pytest.mark.parametrize("before", ["", "# a comment, with commas\n\n", "---\n", "\ufeff"])
def test_recognised_by_content(tmp_path, name, before):
    for text in (session_text(values()), json.dumps(session_json(values()))):
        path = save(tmp_path, before + text, name)
        assert len(read_input(path, MODEL).measured) == 4


def test_the_machine_inside_is_used_unless_another_is_named(tmp_path):
    path = save(tmp_path, session_text(values(LARGE)))
    given = read_input(path)
    assert given.is_session
    assert given.model.machine == LARGE.machine
    assert given.measured.plan.displacement.tolist() == [0.0, 90.0, -20.5, -140.0]
    assert given.measured.remarks == ()
    given = read_input(path, MODEL)
    assert given.model is MODEL
    assert given.measured.plan.displacement.tolist() == [0.0, 60.0, -20.5, -100.0]
    remark = sentences(given.measured.remarks)[0]
    assert "differs from the machine given" in remark
    assert "leg_length_mm" in remark


def test_accepted_causes_belong_to_the_machine_inside(tmp_path):
    """Machines are distinguished by their causes, but not by the last digit of one."""
    found = extended(encoder_scale=(0.0403, -1.1537, -0.9618), axis_gap=(1 / 3, 0.2, -0.1))
    same = stored_machine(machine_text(found), "m.yaml").model
    path = save(tmp_path, session_text(values(same)))
    alone, given, other = read_input(path), read_input(path, same), read_input(path, MODEL)
    assert machine_values(alone.model) == machine_values(same)
    assert [effect.cause.id for effect in alone.model.accepted] == ["encoder_scale", "axis_gap"]
    assert given.model is same
    assert given.measured.remarks == ()
    assert other.model.accepted == ()
    (remark,) = sentences(other.measured.remarks)
    assert remark.endswith("in: identified. The machine given was used.")


def without(text: str, key: str) -> str:
    return re.sub(rf" {key}: [^,}}]*,", "", text)


@pytest.mark.parametrize(
    ("started", "seconds"),
    [("2025-03-01T09:00:00+01:00", [30.25, 90.25, 150.25, 210.25]), (None, [0, 60, 120, 180])],
)
def test_minutes_from_timestamps(tmp_path, started, seconds):
    path = save(tmp_path, without(session_text(values(started=started)), "minutes"))
    read = read_input(path, MODEL).measured
    assert read.timed
    assert (read.plan.hours * 3600).tolist() == pytest.approx(seconds)


def test_resolution_with_its_unit_and_inches(tmp_path):
    text = session_text(values()).replace("resolution: 0.01", "resolution_mm: 0.001")
    text = text.replace("reading_mm: -0.4,", "reading_in: -0.01,")
    path = save(tmp_path, text)
    given = read_input(path, MODEL)
    assert given.conditions.gauges[0].resolution_mm == 0.001
    assert given.measured.value[0] == -0.254


def test_faults_of_all_parts_are_found_at_once(tmp_path):
    text = replaced(session_text(values(operator="Ada")), {
        "operator: Ada": "operator: [a]", "posture: max": "posture: [a]", "leg: y": "leg: q",
        "reading_mm: -0.4": "reading_mm: x", "reason: slipped": "reason: {}",
        "leg: z, posture: iso": "leg: z",
    })  # fmt: skip
    found = problems(read_input, save(tmp_path, text))
    assert [fault.column for fault in found] == [
        "operator", "readings[0].reading_mm", "readings[1].posture", "readings[2].leg",
        "retaken[0].reason", "skipped[0].posture",
    ]  # fmt: skip


def test_unknown_keys_are_said(tmp_path):
    text = session_text(values()).replace("operator:", "weather: rain\noperator:")
    text = text.replace("leg: x,", "leg: x, colour: red,")
    remarks = sentences(read_input(save(tmp_path, text), MODEL).measured.remarks)
    assert any("weather" in remark for remark in remarks)
    assert any("colour" in remark for remark in remarks)
