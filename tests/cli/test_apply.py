"""`orthocal apply`: the machine file learns what was entered, and the later commands agree."""

import re
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from orthoglide_cal.files.machine_file import shipped_folder
from tests import truth

from .program import (
    FIRST,
    UNDETERMINED,
    answer,
    done,
    parameters,
    refusals,
    refused,
    refuses,
    run,
    words,
)  # fmt: skip

pytestmark = pytest.mark.usefixtures("to_apply")


def machine_file() -> dict[str, Any]:
    """As any other program reads it."""
    content: dict[str, Any] = yaml.safe_load(Path("machine.yaml").read_text(encoding="utf-8"))
    return content


def history() -> list[dict[str, Any]]:
    return machine_file().get("history") or []


def active() -> np.ndarray:
    return np.array(list(machine_file()["offsets_mm"].values()))


def applied() -> None:
    done("apply", "before.csv", "--yes")


def to_practise() -> None:
    """Simulated sessions may be recorded in the machine file."""
    text = Path("machine.yaml").read_text(encoding="utf-8")
    Path("machine.yaml").write_text(f"{text}practice: true\n", encoding="utf-8")


def measured_again(moved: float = 0.0) -> None:
    """The same machine, corrected by what its controller holds, its axes moved since [mm]."""
    left = replace(FIRST, offsets=FIRST.offsets + moved - active())
    truth.write_readings(truth.second_session(left, 7), Path("after.csv"))


def test_what_was_entered_is_recorded_and_the_rest_of_the_file_stays() -> None:
    before = Path("machine.yaml").read_text(encoding="utf-8")
    exported = answer("export", "before.csv")
    said = answer("apply", "before.csv", "--yes")
    after = Path("machine.yaml").read_text(encoding="utf-8")
    changed = [line for line in before.splitlines() if line not in after.splitlines()]
    assert changed == ["offsets_mm: {x: 0.0, y: 0.0, z: 0.0}"]
    np.testing.assert_allclose(active(), FIRST.offsets, atol=0.01)
    (entry,) = history()
    assert entry.pop("replaced")["offsets_mm"] == "offsets_mm: {x: 0.0, y: 0.0, z: 0.0}\n"
    assert list(entry) == ["date", "before", "after", "data_sha256"]
    assert {key: said[key] for key in entry} == entry
    assert said["machine_file"] == "machine.yaml"
    assert entry["before"] == {"x": 0.0, "y": 0.0, "z": 0.0}
    assert entry["after"] == machine_file()["offsets_mm"]
    assert entry["after"] == {
        parameter["name"]: parameter["enter"] for parameter in exported["parameters"]
    }
    assert entry["data_sha256"] == sha256(Path("before.csv").read_bytes()).hexdigest()


def test_new_values_are_absolute_and_nobody_says_what_was_applied() -> None:
    before = run("solve", "before.csv", "--json").stdout
    applied()
    assert run("solve", "before.csv", "--json").stdout == before
    measured_again()
    solved, exported = answer("solve", "after.csv"), answer("export", "after.csv")
    for k, axis in enumerate("xyz"):
        joint = parameters(exported)[axis]
        assert joint["active"] == active()[k]
        assert joint["enter"] == pytest.approx(FIRST.offsets[k], abs=0.01)
        assert abs(parameters(solved)[axis]["found"]) < 0.01
    verified = answer("verify", "before.csv", "after.csv")
    said = refused(2, "verify", "after.csv", "before.csv", "--limit", "0.05")
    assert said.endswith("first: orthocal verify before.csv after.csv --limit 0.05")
    said = refused(2, "report", "after.csv", "--after", "before.csv", "--html", "-")
    assert said.endswith("first: orthocal report before.csv --after after.csv")
    np.testing.assert_allclose(list(verified["applied_mm"].values()), active(), atol=1e-9)
    assert verified["answer"] == "as modelled"
    again = answer("verify", "before.csv", "after.csv", "--applied", *map(str, active()))
    assert again["differences"] == verified["differences"]
    # Nothing needs to be entered, and nothing is recorded.
    done("apply", "after.csv", "--yes")
    assert len(history()) == 1
    # The second correction adds to the first.
    first = active()
    measured_again(moved=0.1)
    done("apply", "after.csv", "--yes")
    one, other = history()
    assert other["before"] == one["after"] == dict(zip("xyz", first.tolist(), strict=True))
    np.testing.assert_allclose(active(), FIRST.offsets + 0.1, atol=0.01)


def test_undo_takes_the_last_entry_back() -> None:
    applied()
    done("apply", "--undo", "--yes")
    assert run("apply", "--undo", "--yes").exit_code == 2
    applied()
    assert len(history()) == 1


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\n", "\r\n"),
        ("\\A", "\ufeff"),
        ("\\Z", "history: []\n"),
        ("\\Z", "history: []  # none yet"),
        ("\\Z", "complete: true"),
        ("\\A", "history: []\n# The machine:\n"),
        ("offsets_mm: .*", "offsets_mm: {x: 0, y: +0.000, z: 0.} # now"),
        ("offsets_mm: .*", "offsets_mm:\n  x: 0 # of x\n  y: 0e0\n\n  z:   -0.0\n"),
        ("offsets_mm: .*\n", ""),
    ],
)
def test_undo_leaves_the_bytes_that_were_there(old: str, new: str) -> None:
    path, text = Path("machine.yaml"), Path("machine.yaml").read_text(encoding="utf-8")
    path.write_bytes(re.sub(old, new, text).encode())
    before = path.read_bytes()
    applied()
    once = path.read_bytes()
    assert len(history()) == 1
    measured_again(moved=0.1)
    done("apply", "after.csv", "--yes")
    assert len(history()) == 2
    for left in (once, before):
        done("apply", "--undo", "--yes")
        assert path.read_bytes() == left


@pytest.mark.parametrize("line", refusals(Path(__file__).with_name("refused_to_apply.txt")))
def test_what_is_refused_changes_nothing(line: str) -> None:
    Path("few.csv").write_text(UNDETERMINED, encoding="utf-8")
    applied()
    measured_again()
    before = Path("machine.yaml").read_bytes()
    refuses(line, "apply")
    assert Path("machine.yaml").read_bytes() == before


@pytest.mark.parametrize(("started", "code"), [(None, 2), ("2000", 2), ("2999", 0)])
def test_a_session_from_before_the_last_entry_is_refused(started: str | None, code: int) -> None:
    """Measured with other offsets in the controller; nothing newer is overwritten."""
    to_practise()
    run("simulate", "--offsets", "0.3", "0", "0", "--seed", "3", "--output", "old.yaml")
    applied()
    entered = machine_file()
    content = yaml.safe_load(Path("old.yaml").read_text(encoding="utf-8"))
    content["started"] = started and f"{started}-03-04T10:00:00+00:00"
    Path("old.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    tried = run("apply", "old.yaml", "--yes")
    assert tried.exit_code == code, tried.stderr
    assert ("Measure again" in tried.stderr) is (code == 2)
    assert (machine_file() == entered) is (code == 2)


def test_a_session_of_another_machine_is_refused() -> None:
    simulated_session()
    other = str(shipped_folder() / "orthoglide_prototype.yaml")
    run("simulate", "--seed", "3", "--machine", other, "--output", "other.yaml")
    assert "name, leg_length_mm" in refused(2, "apply", "other.yaml", "--yes")
    # Naming another machine's file does not make a session that machine's.
    text = Path("machine.yaml").read_text(encoding="utf-8")
    changed = text.replace(f"leg_length_mm: {truth.LARGE.leg}", "leg_length_mm: 421.5")
    Path("machine.yaml").write_text(changed, encoding="utf-8")
    said = refused(2, "apply", "s.yaml", "--machine", "machine.yaml", "--yes")
    assert "leg_length_mm" in said
    assert Path("machine.yaml").read_text(encoding="utf-8") == changed != text


def test_only_a_machine_file_of_ones_own_is_written() -> None:
    path = shipped_folder() / "orthoglide_large.yaml"
    before = path.read_bytes()
    refused(2, "apply", "before.csv", "--yes", "--machine", str(path))
    assert path.read_bytes() == before
    Path("machine.yaml").unlink()
    assert "orthocal machine new" in refused(2, "apply", "before.csv", "--yes")


def test_offsets_changed_by_hand_are_not_taken_back() -> None:
    applied()
    text = Path("machine.yaml").read_text(encoding="utf-8")
    changed = re.sub("^offsets_mm: .*", "offsets_mm: {x: 1, y: 0, z: 0}", text, flags=re.MULTILINE)
    Path("machine.yaml").write_text(changed, encoding="utf-8")
    assert "by hand" in refused(2, "apply", "--undo", "--yes")


def simulated_session() -> None:
    """s.yaml, as `measure --gauge simulated --seed 4` leaves one, to be recorded for practice."""
    to_practise()
    done("simulate", "--offsets", "1", "-0.8", "0.6", "--seed", "3", "-o", "s.yaml")
    content = yaml.safe_load(Path("s.yaml").read_text(encoding="utf-8"))
    content["environment"] = {**(content.get("environment") or {}), "seed": "4"}
    Path("s.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")


def test_a_simulated_machine_is_measured_again_with_its_seed() -> None:
    """What the screens suggest leads back to the same machine, with its correction.

    The session may come from standard input.
    """
    simulated_session()
    shown = done("apply", "-", "--yes", text=Path("s.yaml").read_text(encoding="utf-8"))
    assert len(history()) == 1
    assert "orthocal measure --gauge simulated --seed 4" in shown
    assert "orthocal measure --gauge simulated --seed 4" in run().stdout
    assert "The machine file records that the" in words(run("solve", "s.yaml").stdout)
