"""Histories against the independent truth: the story, when, how much; circumstances; refusals."""

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation.arms import free_arms
from orthoglide_cal.files.input import read_input
from orthoglide_cal.inference.sessions import Trend
from orthoglide_cal.model.model import Estimate
from orthoglide_cal.report.documents.history import history_document
from orthoglide_cal.results.history import History, _Session, compare
from orthoglide_cal.results.making import answer_to
from orthoglide_cal.results.verification import verify
from tests import truth
from tests.inference.sessions import given as touched
from tests.machines import NOMINAL
from tests.printer_files import printer_cfg
from tests.results.histories import STORIES, WANTED, Drawn, draw, measured
from tests.results.sessions import TRUE, given, session
from tests.truth import delta
from tests.truth.session import Setting


def places(found: History) -> tuple[int, ...]:
    paths = [each.path for each in found.sessions]
    return tuple(paths.index(change.before) for change in found.changes)


def scored(drawn: Drawn) -> Counter[str]:
    """What the program gets right of one history, and what not."""
    found, wanted, story = compare(drawn.inputs), WANTED.get(drawn.story, "changed"), drawn.story
    far, right = drawn.sigmas >= 4.0, found.verdict == wanted
    count = Counter({f"{story} {'far' if far else 'near'}": 1})
    if far:
        count[f"{story} right"] += right
        count[f"{story} right or open"] += right or wanted in found.ambiguous_with
    if wanted == "changed" and right and len(drawn.gaps) == 1 and far:
        count["placed"] += 1
        count["place right"] += places(found) == drawn.gaps
        if places(found) == drawn.gaps and story != "cause":
            sizes = {each.name: each for each in found.changes[0].parameters}
            true = dict(zip("xyz", drawn.size.tolist(), strict=True))
            count["sizes"] += len(sizes)
            count["size inside U"] += sum(
                abs(each.value - true.get(name, 0.0)) <= each.expanded
                for name, each in sizes.items()
            )
    if story == "cause" and right:
        count["cause named"] += any("axis" in each.name for each in found.changes[0].parameters)
    return count


@pytest.mark.slow
def test_rates_of_a_thousand_histories():
    """1,008 histories of 3 to 12 sessions, 112 of each story."""
    total: Counter[str] = Counter()
    for story in STORIES:
        for seed in range(1000, 1112):
            total += scored(draw(story, seed))
    print(dict(total))
    still = ("unchanged", "warm")
    assert sum(total[f"{story} right"] for story in still) >= 0.97 * 224
    moved = [story for story in STORIES if story not in still]
    apart = sum(total[f"{story} far"] for story in moved)
    assert sum(total[f"{story} right"] for story in moved) >= 0.95 * apart
    assert sum(total[f"{story} right or open"] for story in moved) >= 0.98 * apart
    assert total["place right"] >= 0.97 * total["placed"]
    assert 0.93 <= total["size inside U"] / total["sizes"] <= 0.97
    assert total["cause named"] >= 0.95 * total["cause right"]


@pytest.mark.parametrize("story", STORIES)
def test_each_story_is_told(story):
    drawn = draw(story, 5, 6)
    found = compare(drawn.inputs)
    assert found.verdict == WANTED.get(story, "changed")
    assert [each.path for each in found.sessions] == [f"{k}.csv" for k in range(6)]
    if drawn.gaps:
        assert places(found) == drawn.gaps
    if story == "step and drift":
        assert found.also == ("drifting",)
    if story == "warm":
        assert "temperatures_vary" in [note.code for note in found.notes]
    if story == "cause":
        (change,) = found.changes
        assert all(each.name.startswith("axis_") for each in change.parameters)
        assert "shown_in" in [note.code for note in found.notes]


def test_a_drift_has_its_rate_its_limit_and_a_prediction():
    drawn = draw("drift", 9, 8)
    found = compare(drawn.inputs, limit_mm=0.5)
    true = dict(zip("xyz", np.polyfit(drawn.days, drawn.path, 1)[0].tolist(), strict=True))
    for each in found.drift:
        # Three standard uncertainties: of three rates one is outside once in 120 times.
        assert each.value == pytest.approx(true[each.name], abs=3.0 * each.std)
    fastest = max(found.drift, key=lambda each: abs(each.value))
    assert found.limit.parameter == fastest.name
    # At the earliest: before the rate alone gets there, not much.
    days = 0.5 / abs(fastest.value)
    assert 0.8 * days < found.limit.days < days
    assert not found.limit.scatter_exceeds
    step = float(np.median(np.diff(drawn.days)))
    start = found.pooled["xyz".index(fastest.name)].value
    coming = found.prediction["xyz".index(fastest.name)]
    assert coming.value == pytest.approx(start + step * fastest.value, abs=0.01)
    assert coming.expanded < 0.04


def test_scatter_is_that_of_the_sessions_and_beyond_a_limit_it_is_said():
    """Of four: so large that what a session does not know of itself is a twentieth of it."""
    drawn = draw("scatter", 9, 4)
    found = compare(drawn.inputs, limit_mm=0.01)
    true = drawn.path.std(axis=0, ddof=1)
    assert true.min() > 4.8 * drawn.sigma
    assert [each.std for each in found.scatter] == pytest.approx(true, rel=0.05)
    assert set(found.limit.scatter_exceeds) == {each.name for each in found.scatter}


def test_what_all_sessions_share_is_not_counted_twice():
    """Seven sessions know the offsets little better than one: the legs stay as they are."""
    found = compare(draw("unchanged", 2, 7).inputs)
    one, all_ = found.sessions[0].parameters[0], found.pooled[0]
    assert found.verdict is Trend.UNCHANGED
    assert 0.7 * one.std < all_.std < one.std
    # Its own share averages out; each further session adds less.
    assert found.sessions[0].own_expanded[0] < 0.8 * one.expanded
    further = [found.further[more][0] for more in (1, 2, 5)]
    assert all_.expanded > further[0] > further[1] > further[2] > 0.0196  # 1.96 times 0.01 mm


def test_a_recorded_adjustment_is_no_change_and_an_unrecorded_one_is():
    changed = (given(session(TRUE, 1)), given(session(TRUE * 0.0, 2)))
    recorded = given(session(TRUE * 0.0, 2), NOMINAL.holding(tuple(TRUE)))
    found = compare([changed[0], recorded], ["2026-03-02", "2026-04-02"])
    assert found.verdict is Trend.UNCHANGED
    assert "adjusted" in [note.code for note in found.notes]
    assert compare(changed).verdict is Trend.CHANGED
    # `verify` says the same of both: the machine responded, and nothing else changed.
    checked = verify(*changed, TRUE)
    assert (checked.kept, checked.other_change.found) == (True, False)


def test_a_name_that_the_next_session_refutes_is_withdrawn():
    """Unless an adjustment is recorded in between; a sound machine then has no gap."""
    rng, gap = np.random.default_rng(3), truth.Effect("axis_gap", parameters=(0.4, -0.3, 0.5))
    of = partial(measured, truth.PROTOTYPE, truth.MICRON, TRUE)
    before, after = (of(e, Setting.exact(), rng, f"{len(e)}.csv") for e in ((gap,), ()))
    found = compare([before, after])
    assert found.sessions[0].refuted.code == "refuted_later"
    assert (found.sessions[0].causes, found.next.code) == ((), "refuted")
    shown = str(history_document(found).screen().notice)
    assert all(words in shown for words in ("1.csv: axis_", "later readings refute it"))
    size = Estimate(name="xy", unit="mm", value=0.3, std=0.01)
    pushed = {before.measured.source.sha256: [("axis_gap", size)]}
    again = of((gap,), Setting.exact(), rng, "again.csv")
    for known in (compare([before, after], adjusted=pushed), compare([before, again])):
        assert (known.sessions[0].refuted, bool(known.sessions[0].causes)) == (None, True)


def test_order_and_dates():
    drawn = draw("step", 5, 4)
    assert compare(drawn.inputs[::-1]) == compare(drawn.inputs)
    undated = [replace(e, conditions=e.conditions.changed(started=None)) for e in drawn.inputs]
    found = compare(undated)
    assert not found.dated
    assert "undated" in [note.code for note in found.notes]
    assert places(found) == drawn.gaps
    days = ["2026-03-02", "2026-03-09", "2026-04-01", "2026-05-01"]
    assert compare(undated, days[::-1]).sessions[0].path == "3.csv"


def test_the_name_of_a_file_tells_its_date():
    only = given(session(TRUE, 1))
    for name, day in {
        "printer-20241223_204558.cfg": "2024-12-23T20:45:58+00:00",
        "kossel_2025-03-27.cfg": "2025-03-27T00:00:00+00:00",
        "mill7-20260302.csv": "2026-03-02T00:00:00+00:00",
        "20261399.csv": None,
        "printer.cfg": None,
    }.items():
        source = replace(only.measured.source, path=f"backup/{name}")
        found = replace(only, measured=replace(only.measured, source=source)).moment
        assert (found and found.isoformat()) == day


def test_another_machine_is_refused():
    other = touched(truth.make_session(1, truth.LARGE, truth.DIAL))
    with pytest.raises(UsageError, match="several machines"):
        compare([given(session(TRUE, 1)), other])


def test_of_a_session_beyond_the_list_it_compares_what_solve_finds():
    odd = touched(truth.clear_outside(1, truth.PROTOTYPE, truth.DIAL, "plunger_hysteresis"))
    sound = touched(truth.make_session(1, truth.PROTOTYPE, truth.DIAL))
    shown = compare([odd, sound]).sessions[0].parameters
    assert [p.value for p in shown] == pytest.approx([p.found for p in answer_to(odd).parameters])


def test_a_date_that_hardly_sees_a_large_cause_does_not_say_that_it_went():
    """Seven touches of one height, after touches on blocks that showed the lean."""
    lean = delta.Truth(leans=np.array([[0.0, 0.0], [0.0, 15.0], [0.0, 0.0]]))
    rng = np.random.default_rng(2)
    layouts = delta.Layout(49, (0.0, 60.0, 120.0)), delta.Layout(7)
    dates = [delta.probe_bed(delta.V400, lean, (), layout, rng) for layout in layouts]
    found = compare([touched(date) for date in dates])
    assert found.verdict is Trend.UNCHANGED
    assert any(size.name.startswith("tower_lean") for size in found.pooled)


def test_dates_with_other_stored_arms_agree_on_the_same_machine(tmp_path: Path) -> None:
    """Its arms, which nine distances determine, were stored 1 mm too short at first."""
    longer = replace(delta.V400, arms=tuple(arm + 1.0 for arm in delta.V400.arms))
    truths = delta.Truth(arms=np.ones(3)), delta.Truth(endstops=delta.V400.home - longer.home)
    dates = []
    for day, (machine, true) in enumerate(zip((delta.V400, longer), truths, strict=True), 1):
        file = tmp_path / f"2025-03-0{day}.cfg"
        file.write_text(printer_cfg(machine, true, noise=0.0, sections="c", many=True))
        dates.append(free_arms(read_input(str(file))))
    before, after = ([p.value for p in date.parameters] for date in compare(dates).sessions)
    assert before == pytest.approx(after, abs=1e-3)


def test_rates_on_an_assumed_clock_are_widened_once():
    timed = touched(truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("axis_gap",)))
    dated = _Session(replace(timed, measured=replace(timed.measured, timed=False)), timed.model)
    assert dated.decision.white.machine == dated.white.machine != timed.model.machine
