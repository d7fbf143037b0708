"""The history of a machine: what drifts, and when it was adjusted."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.estimation.budget import Budget
from orthoglide_cal.results import history
from tests.machines import NOMINAL, PROTOTYPE
from tests.results.sessions import DRIFT, FIRST, HISTORY, TRUE, session, write, write_history


def test_history_of_a_machine(tmp_path: Path):
    write_history(tmp_path)
    found = history(tmp_path)
    assert found.machine == PROTOTYPE.name
    assert [entry.adjusted for entry in found.entries] == [False, True, False, False]
    assert [entry.active_mm.tolist() for entry in found.entries] == [list(x) for _, x in HISTORY]
    assert datetime.fromtimestamp(found.last_adjusted, UTC).isoformat() == HISTORY[1][0]
    assert [name for name, _ in found.left_out] == ["broken.yaml"]
    for k, entry in enumerate(found.entries):
        truth = np.array(FIRST) + k * np.array(DRIFT)
        assert np.all(np.abs(entry.total_mm - truth) < 2.0 * entry.solution.expanded_mm)
    since_first, since_adjustment = found.drifts
    assert since_first.since == "the first session"
    assert since_adjustment.since == "the last adjustment"
    assert since_first.days == pytest.approx(291.0)
    assert since_adjustment.days == pytest.approx(262.0)
    assert since_first.moved == (True, False, False)
    first, last = found.entries[0], found.entries[-1]
    assert since_first.change_mm == pytest.approx(last.total_mm - first.total_mm)
    # What both sessions share, as the lengths of the legs, does not make the change uncertain.
    shared = {"leg_length", "gauge_scale"}
    for entry in (first, last):
        assert shared < {each.source for each in entry.solution.budget.contributions}
    new = [
        Budget(tuple(e for e in entry.solution.budget.contributions if e.source not in shared))
        for entry in (first, last)
    ]
    expanded = np.hypot(*(budget.expanded_mm for budget in new))
    assert since_first.expanded_mm == pytest.approx(expanded)


def test_nothing_drifts_in_one_session(tmp_path: Path):
    write(session(TRUE, 7), NOMINAL, tmp_path / "one.yaml")
    found = history(tmp_path)
    assert found.drifts == ()
    assert found.last_adjusted is None


def test_history_of_two_machines_asks_which(tmp_path: Path):
    write_history(tmp_path)
    other = replace(NOMINAL, machine=replace(PROTOTYPE, name="Other"))
    write(session(TRUE, 7), other, tmp_path / "other.yaml", finished="2026-05-05T10:00:00")
    with pytest.raises(UsageError, match="2 machines"):
        history(tmp_path)
    chosen = history(tmp_path, "Other")
    assert len(chosen.entries) == 1
    assert len(chosen.left_out) == 5
    with pytest.raises(InputError, match="no usable session"):
        history(tmp_path, "Third")
    with pytest.raises(InputError, match="no such folder"):
        history(tmp_path / "nowhere")
