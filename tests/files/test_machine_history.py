"""The machine file: history, details for reports, bounds of its numbers, and files cut off."""

import pytest

from orthoglide_cal.files import (
    Session,
    machine_from_text,
    machine_text,
    read_machine,
    session_text,
)
from orthoglide_cal.files.input import check_file
from orthoglide_cal.files.machine_file import machine_in
from orthoglide_cal.files.text import document_from_bytes
from orthoglide_cal.files.yaml_tree import load_tree
from orthoglide_cal.model import Model

from .helpers import PROTOTYPE, problems
from .test_machine_file import DIGEST, VALUES, accepted, text_with

HISTORY = """
history:
- {date: 2025-01-31, before: {x: 0, y: 0, z: 0}, after: {x: 0.4, y: -0.1, z: 0},
   data_sha256: DIGEST}
report:
  organisation: Foundry of Nantes
  serial_number: "0042"
  gauge_due: 2026-03-01
""".replace("DIGEST", DIGEST)


def test_history_and_details_are_kept_when_the_file_is_written_again(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(PROTOTYPE.read_text() + HISTORY)
    model = read_machine(path)
    (entry,) = model.machine.history
    assert entry.model_dump(exclude={"before", "written"}) == {
        "date": "2025-01-31",
        "after": {"x": 0.4, "y": -0.1, "z": 0.0},
        "data_sha256": DIGEST,
    }
    assert entry.before == (0.0, 0.0, 0.0)
    assert model.machine.entered_from(DIGEST) == entry
    assert model.machine.entered_from("0" * 64) is None
    report = model.machine.report
    assert (report.organisation, report.serial_number) == ("Foundry of Nantes", "0042")
    assert (report.gauge_due, report.customer) == ("2026-03-01", None)
    again = machine_from_text(machine_text(model), "m.yaml")
    assert again.machine == model.machine
    session = session_of(model)
    assert session.machine == model.machine


def session_of(model: Model) -> Model:
    """The machine that a session of it holds."""
    text = session_text(Session(machine=model))
    tree = load_tree(document_from_bytes(text.encode(), "s.yaml"))
    found = machine_in(tree, ("machine",))
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("old", "new", "column"),
    [
        ("date: 2025-01-31", "date: today", "history[0].date"),
        ("z: 0},\n", "z: 2000},\n", "history[0].after.z"),
        ("x: 0.4, ", "", "history[0].after.x"),
        ("y: -0.1", "y: -0.1, w: 1", "history[0].after.w"),
        (DIGEST, "abc", "history[0].data_sha256"),
        ("serial_number", "number", "report.number"),
        ("gauge_due: 2026-03-01", "gauge_due: soon", "report.gauge_due"),
        ("organisation: Foundry of Nantes", "organisation: ''", "report.organisation"),
    ],
)
def test_faults_of_history_and_details(tmp_path, old, new, column):
    path = tmp_path / "m.yaml"
    assert old in HISTORY
    path.write_text(PROTOTYPE.read_text() + HISTORY.replace(old, new))
    assert [fault.column for fault in problems(read_machine, path)] == [column]


def test_a_file_that_was_cut_off_is_noticed(tmp_path):
    """Wherever: a cause less would move the offsets without a word."""
    text = text_with(*map(accepted, VALUES))
    path = tmp_path / "m.yaml"
    lines = text.splitlines(keepends=True)
    for end in range(1, len(lines)):
        path.write_text("".join(lines[:end]))
        assert problems(read_machine, path)
    path.write_text(text)
    assert len(read_machine(path).accepted) == len(VALUES)


def test_a_file_of_ones_own_without_identified_gets_a_remark(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(PROTOTYPE.read_text().replace("identified: []", ""))
    (remark,) = check_file(str(path))[0].remarks
    assert "identified: []" in remark
    assert check_file(str(PROTOTYPE))[0].remarks == ()
