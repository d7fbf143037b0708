"""Sessions that go on from others, interrupted anywhere: nothing is lost."""

import json
import signal
from pathlib import Path

import pytest

from orthoglide_cal.session.events import RECORD, replay

from .going_on import choice, events_of, is_step
from .terminal import Terminal, finished, refused, run_program
from .virtual import without_times

HERE = Path(__file__).parent


def test_a_killed_session_needs_nothing_but_its_journal(first: Path, tmp_path: Path) -> None:
    """Killed in the program before any reading, and after several; FILE is gone meanwhile.

    What is measured is said once at the beginning, and again where it is gone on with.
    """
    copy = tmp_path / "a.yaml"
    copy.write_bytes(first.read_bytes())
    arguments = choice(copy, is_step)
    whole = run_program(tmp_path, "whole.yaml", *arguments)
    assert whole.returncode == 0
    options: tuple[str, ...] = arguments[:-1]
    for kill_at in (1, 2, 4, 7):
        with Terminal(tmp_path, "k.yaml", *options) as terminal:
            while terminal.step() != kill_at:
                terminal.type("")
            terminal.child.kill(signal.SIGKILL)
        copy.unlink(missing_ok=True)
        options = ("--resume",)
    shown = finished(tmp_path, "k.yaml", "--resume")
    for text in (whole.stdout, shown):
        assert " ".join(text.split()).count("Without touching the stands") == 1, text
    expected = without_times((tmp_path / "whole.yaml").read_text())
    assert without_times((tmp_path / "k.yaml").read_text()) == expected


def test_what_is_read_comes_back_as_it_was_written(first: Path, tmp_path: Path) -> None:
    finished(tmp_path, "s.yaml", *choice(first, is_step))
    begun, planned, *_ = events_of(tmp_path / "s.journal")
    assert begun.version == 2
    assert RECORD.validate_json(json.dumps(planned.model_dump())) == planned
    assert planned.following.data.text == first.read_text()
    assert {reading.entered for reading in planned.readings} == {(0.3, 0.0, 0.0)}
    record = planned.model_dump()
    for spoilt in ({"leg": "x"}, {"contact": 9}, {"entered": [0.3, 0.0]}, {"turned": 1}):
        readings = [{**record["readings"][0], **spoilt}]
        with pytest.raises(ValueError, match=r"\w"):
            RECORD.validate_json(json.dumps({**record, "readings": readings}))
    # Without it nothing is read.
    alone, *_ = (tmp_path / "s.journal").read_bytes().splitlines(keepends=True)
    (tmp_path / "1.journal").write_bytes(alone)
    assert "or another reading for it" in refused(3, tmp_path, "1.yaml", "--resume")


@pytest.mark.parametrize("cut", [1, 2, 12, 25, 26])
def test_journals_of_version_1_go_on_to_the_session_that_their_program_wrote(
    tmp_path: Path, cut: int
) -> None:
    """Written, whole, by the last program that knew version 1 only; its simulated gauge, too."""
    lines = (HERE / "whole_version_1.journal").read_bytes().splitlines(keepends=True)
    (tmp_path / "s.journal").write_bytes(b"".join(lines[:cut]))
    finished(tmp_path, "s.yaml", "--resume")
    expected = without_times((HERE / "whole_version_1.yaml").read_text())
    assert without_times((tmp_path / "s.yaml").read_text()) == expected
    first = events_of(tmp_path / "s.journal")[0]
    assert replay([first]).planned is None
