"""The bench's own judgement, on answers made up for the purpose."""

import json
import sys
from dataclasses import replace
from math import comb
from pathlib import Path

import pytest

from tests.truth import CAUSES, DIAL, MICRON, OUTSIDE, PROTOTYPE, Separation, make_session

from . import bench, run
from .accuracy import coverage, heldout
from .answers import Answer, ContractError, NamedCause, parse_answer
from .bench import Setting, run_group
from .cases import Case, Counts
from .chance import band, chance_at_most, chance_below
from .report import failures, full_report
from .scoring import Judged, Rate, both_accepted, confusion, is_right, judge, rates


def _case(*hidden: str, near: float = 9.0, visible: float = 9.0, own: float = 1.0) -> Case:
    distances = dict.fromkeys(CAUSES, near) | {"healthy": visible}
    if len(hidden) == 1:
        distances[hidden[0]] = own
    rivals = sorted((c for c in distances if c not in hidden), key=lambda c: distances[c])
    far = Separation(hidden, distances, tuple(rivals))
    return Case("case", make_session(1, PROTOTYPE, MICRON, hidden), far)


def _named(*ids: str, aliases: tuple[str, ...] = (), also: tuple[str, ...] = ()) -> Answer:
    causes = tuple(NamedCause(name, 0.9, aliases, 0.004, 0.0035) for name in ids)
    return Answer("named", causes, also, (0.1, 0.2, 0.3), (0.01, 0.01, 0.01), 0.003)


def test_a_case_asks_for_what_its_distances_allow() -> None:
    assert _case("axis_gap").kind() == "distinct"
    assert _case("axis_gap", near=3.9).kind() == "close"
    assert _case("axis_gap", visible=3.9).kind() == "faint"
    assert _case("axis_gap", near=4.5, own=3.0).kind() == "distinct"
    assert _case("axis_gap", near=4.5, own=3.0).kind("margin") == "close"
    assert _case("misread", "axis_gap").kind() == "pair"
    assert _case("misread", "axis_gap", near=2.0).kind() == "half pair"
    healthy = Case("h", make_session(1, PROTOTYPE, MICRON), None)
    outside = Case("o", make_session(1, PROTOTYPE, MICRON, outside="noisy_leg"), None)
    assert (healthy.kind(), outside.kind()) == ("healthy", "outside")


def test_distinct_truths_must_come_first() -> None:
    case = _case("bar_skew")
    assert is_right(case, _named("bar_skew"), "distinct")
    assert not is_right(case, _named("axis_gap", aliases=("bar_skew",)), "distinct")
    assert not is_right(case, Answer("consistent"), "distinct")
    assert not is_right(case, replace(_named("bar_skew"), verdict="unexplained"), "distinct")


def test_close_truths_must_be_mentioned() -> None:
    case = _case("bar_skew", near=1.0)
    assert is_right(case, _named("axis_gap", aliases=("bar_skew",)), "close")
    assert is_right(case, _named("axis_gap", also=("bar_skew",)), "close")
    assert not is_right(case, _named("axis_gap"), "close")
    assert not is_right(case, Answer("consistent"), "close")
    assert is_right(case, Answer("consistent"), "faint")
    assert not is_right(case, _named("axis_gap"), "faint")


def test_pairs_need_both_and_half_pairs_what_shows() -> None:
    case = _case("misread", "axis_gap")
    assert is_right(case, _named("axis_gap", "misread"), "pair")
    assert is_right(case, _named("bar_skew", "misread", aliases=("axis_gap",)), "pair")
    assert not is_right(case, _named("misread"), "pair")
    assert case.separation is not None
    alone = {**case.separation.distances, "misread": 2.0}
    half = replace(case, separation=replace(case.separation, distances=alone))
    # Near a misreading alone: the gap does not show, the misreading must be found.
    assert is_right(half, _named("misread"), "half pair")
    assert not is_right(half, _named("axis_gap"), "half pair")
    judged = judge([case], [_named("bar_skew", "misread", aliases=("axis_gap",))])
    assert both_accepted(judged) == (0, 1)


def test_rates_and_confusion_count() -> None:
    cases = [_case("bar_skew"), _case("bar_skew"), _case("axis_gap", near=1.0)]
    judged = judge(cases, [_named("bar_skew"), _named("misread"), _named("axis_gap")])
    distinct, close = rates(judged)
    assert (distinct.right, distinct.total, distinct.met) == (1, 2, False)
    assert (close.right, close.total, close.met) == (1, 1, True)
    assert confusion(judged)["bar_skew"] == {"bar_skew": 1, "misread": 1}


def test_coverage_and_heldout_look_at_right_models_only() -> None:
    case = _case("axis_gap")
    truth = tuple(float(value) for value in case.session.offsets)
    right = replace(_named("axis_gap"), offsets=(truth[0], truth[1] + 0.019, truth[2] - 0.02))
    judged = judge([case, case], [right, _named("bar_skew")])
    (row,) = coverage(judged)
    assert (row.sessions, row.inside) == (1, 2)
    (ratio,) = heldout(judged)
    assert ratio.sessions == 1
    assert ratio.before / ratio.after == pytest.approx(0.004 / 0.0035)


def test_binomial_chances_are_exact() -> None:
    assert chance_at_most(3, 10, 0.4) == pytest.approx(
        sum(comb(10, k) * 0.4**k * 0.6 ** (10 - k) for k in range(4))
    )
    assert chance_at_most(10, 10, 1.0) == 1.0
    # Below 97 % of 100 means at most 96.
    assert chance_below(0.97, 100, 0.99) == pytest.approx(chance_at_most(96, 100, 0.99))
    low, high = band(400, 0.93, 0.97)
    assert 0.87 < low < 0.92
    assert 0.98 < high < 1.0
    assert band(0, 0.93, 0.97) == (0.0, 1.0)
    assert Rate("distinct", 96, 100, 0.97, 0.99).false_failure == chance_below(0.97, 100, 0.99)


def test_answers_are_read_strictly() -> None:
    line = {
        "verdict": "ambiguous",
        "lack_of_fit": {"statistic": 99.0, "p_value": 1e-9, "noise_mm": 0.003, "residual_mm": 0.1},
        "causes": [
            {
                "id": "axis_gap",
                "probability": 0.7,
                "aliases": ["bar_skew"],
                "heldout_before_mm": 0.1,
                "heldout_after_mm": None,
            }
        ],
        "ambiguous_with": ["backlash"],
        "offsets_mm": {"x": 1, "y": 2, "z": 3},
        "std_mm": {"x": 0.1, "y": 0.2, "z": 0.3},
    }
    answer = parse_answer(json.dumps(line))
    assert answer.first == "axis_gap"
    assert answer.mentioned == {"axis_gap", "bar_skew", "backlash"}
    assert (answer.offsets, answer.std[2]) == ((1.0, 2.0, 3.0), 0.3)
    assert answer.causes[0].heldout_after is None
    assert parse_answer('{"input": "a.csv", "error": "no such file"}').first == "error"
    for broken in ({**line, "verdict": "maybe"}, {k: v for k, v in line.items() if k != "causes"}):
        with pytest.raises(ContractError):
            parse_answer(json.dumps(broken))


ECHO = """
import json, sys
names = [name for name in sys.argv[1:] if name.endswith(".csv") and not name.startswith("later-")]
for name in names:
    found = name.split("-")[0]
    causes = [{"id": found, "probability": 1, "aliases": [], "heldout_before_mm": 0.02,
               "heldout_after_mm": 0.006}] if found not in ("healthy", "outside") else []
    verdict = {"healthy": "consistent", "outside": "unexplained"}.get(found, "named")
    axes = {"x": 0.0, "y": 0.0, "z": 0.0}
    print(json.dumps({"verdict": verdict, "causes": causes, "ambiguous_with": [],
        "lack_of_fit": {"noise_mm": 0.003}, "offsets_mm": axes, "std_mm": axes}))
"""


def test_a_group_runs_through_a_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that reads the truth off the file names is right but for pairs and coverage."""
    script = tmp_path / "echo.py"
    script.write_text(ECHO, encoding="utf-8")
    monkeypatch.setattr(run, "program", lambda: [sys.executable, str(script)])
    counts = Counts(single=1, healthy=4, outside=1, pair=1)
    setting = Setting(counts, seed=3, holdouts=1, keep=tmp_path / "kept")
    group = run_group(PROTOTYPE, DIAL, setting)
    assert len(group.judged) == len(CAUSES) + 4 + len(OUTSIDE) + 30
    wrong = {j.kind for j in group.judged if not j.right}
    assert wrong <= {"pair", "half pair"}
    assert "pair" in wrong
    # Its intervals have no width, and its later errors are 0.006 over 0.0067.
    assert any("coverage of healthy" in text for text in failures([group]))
    assert group.later
    assert group.later[0].after == pytest.approx(0.006 / DIAL.sigma)
    assert "MISSED" in full_report([group])
    kept = list((tmp_path / "kept" / "prototype-dial").glob("healthy-*.csv"))
    assert len(kept) == 4


def test_a_program_that_skips_a_file_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "program", lambda: [sys.executable, "-c", "print('')"])
    with pytest.raises(run.RunError, match="0 answers for 1 files"):
        run.diagnose(tmp_path, ["a.csv"])


def test_groups_are_asked_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    empty: tuple[Judged, ...] = ()
    monkeypatch.setattr(
        bench, "run_group", lambda m, g, s: bench.Group(m.name, g.name, empty, 1.0, ())
    )
    said: list[str] = []
    groups = bench.run_bench([PROTOTYPE], [MICRON, DIAL], Setting(Counts()), said.append)
    assert [(g.machine, g.gauge) for g in groups] == [
        ("prototype", "micron"),
        ("prototype", "dial"),
    ]
    assert len(said) == 2
