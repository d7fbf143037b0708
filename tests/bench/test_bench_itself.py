"""The bench's own judgement, on answers made up for the purpose."""

import json
import sys
from dataclasses import replace
from math import comb
from pathlib import Path

import numpy as np
import pytest

from tests.truth import CAUSES, DIAL, MICRON, OUTSIDE, PROTOTYPE, Separation, make_session

from . import run
from .accuracy import coverage, heldout
from .answers import Answer, ContractError, NamedCause, parse_answer
from .cases import Case, Counts, draw_gauges
from .chance import band, chance_at_most, chance_below
from .report import failures, full_report
from .run import run_bench
from .scoring import Rate, both_accepted, confusion, is_right, judge, rates


def _case(*hidden: str, near: float = 9.0, visible: float = 9.0, own: float = 1.0) -> Case:
    distances = dict.fromkeys(CAUSES, near) | {"healthy": visible}
    if len(hidden) == 1:
        distances[hidden[0]] = own
    rivals = sorted((c for c in distances if c not in hidden), key=lambda c: distances[c])
    far = Separation(hidden, distances, tuple(rivals))
    return Case("case", make_session(1, PROTOTYPE, MICRON, hidden), far)


def _named(*ids: str, aliases: tuple[str, ...] = (), also: tuple[str, ...] = ()) -> Answer:
    causes = tuple(NamedCause(name, aliases, 0.004, 0.0035) for name in ids)
    return Answer("named", causes, also, (0.1, 0.2, 0.3), (0.01, 0.01, 0.01))


def test_a_case_asks_for_what_its_distances_allow() -> None:
    assert _case("axis_gap").kind() == "distinct"
    assert _case("axis_gap", near=3.9).kind() == "close"
    assert _case("axis_gap", visible=3.9).kind() == "faint"
    assert _case("axis_gap", near=4.5, own=3.0).kind() == "distinct"
    assert _case("misread", "axis_gap").kind() == "pair"
    assert _case("misread", "axis_gap", near=2.0).kind() == "half pair"
    healthy = Case("h", make_session(1, PROTOTYPE, MICRON), None)
    outside = Case("o", make_session(1, PROTOTYPE, MICRON, outside="noisy_leg"), None)
    assert (healthy.kind(), outside.kind()) == ("healthy", "outside")


@pytest.mark.parametrize(
    ("kind", "answer", "right"),
    [
        ("distinct", _named("bar_skew"), True),
        ("distinct", _named("axis_gap", aliases=("bar_skew",)), False),
        ("distinct", Answer("consistent"), False),
        ("distinct", replace(_named("bar_skew"), verdict="unexplained"), False),
        ("close", _named("axis_gap", aliases=("bar_skew",)), True),
        ("close", _named("axis_gap", also=("bar_skew",)), True),
        ("close", _named("axis_gap"), False),
        ("close", Answer("consistent"), False),
        ("faint", Answer("consistent"), True),
        ("faint", _named("axis_gap"), False),
    ],
)
def test_distinct_truths_must_come_first_and_close_ones_be_mentioned(
    kind: str, answer: Answer, right: bool
) -> None:
    assert is_right(_case("bar_skew"), answer, kind) is right


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
    right = replace(_named("axis_gap"), found=(truth[0], truth[1] + 0.019, truth[2] - 0.02))
    judged = judge([case, case], [right, _named("bar_skew")])
    (row,) = coverage(judged)
    assert (row.sessions, row.inside) == (1, 2)
    (ratio,) = heldout(judged)
    assert ratio.sessions == 1
    assert ratio.before / ratio.after == pytest.approx(0.004 / 0.0035)


def test_binomial_chances_are_those_of_their_words() -> None:
    tenth = sum(comb(10, k) * 0.4**k * 0.6 ** (10 - k) for k in range(4))
    assert chance_at_most(3, 10, 0.4) == pytest.approx(tenth)
    # Below 97 % of 100 means at most 96.
    assert chance_below(0.97, 100, 0.99) == pytest.approx(chance_at_most(96, 100, 0.99))
    assert chance_below(0.0, 100, 0.99) == 0.0
    low, high = band(400, 0.93, 0.97)
    assert 0.87 < low < 0.92
    assert 0.98 < high < 1.0
    assert band(0, 0.93, 0.97) == (0.0, 1.0)
    assert Rate("distinct", 96, 100, 0.97, 0.99).false_failure == chance_below(0.97, 100, 0.99)


def test_answers_are_read_strictly() -> None:
    cause = {"id": "axis_gap", "aliases": ["bar_skew"], "heldout_before_mm": 0.1}
    line = {
        "verdict": "ambiguous",
        "causes": [{**cause, "heldout_after_mm": None, "heldout_ratio": None}],
        "ambiguous_with": ["backlash"],
        "beyond_tolerance": [],
        "parameters": [{"found": k, "std": 0.1 * k} for k in (1.0, 2.0, 3.0)],
    }
    answer = parse_answer(json.dumps(line))
    assert answer.first == "axis_gap"
    assert answer.mentioned == {"axis_gap", "bar_skew", "backlash"}
    assert (answer.found, answer.std[1]) == ((1.0, 2.0, 3.0), 0.2)
    assert answer.causes[0].heldout_after is None
    assert parse_answer('{"input": "a.csv", "error": "no such file"}').first == "error"
    for broken in (
        {**line, "verdict": "maybe"},
        {**line, "causes": [cause]},
        {k: v for k, v in line.items() if k != "causes"},
    ):
        with pytest.raises(ContractError):
            parse_answer(json.dumps(broken))


ECHO = """
import json, sys
names = [name for name in sys.argv[1:] if name.endswith(".csv") and not name.startswith("later")]
for name in names:
    found = name.split("-")[0]
    causes = [{"id": found, "aliases": [], "heldout_before_mm": 0.02, "heldout_after_mm": 0.006,
               "heldout_ratio": None}] if found not in ("healthy", "outside") else []
    verdict = {"healthy": "consistent", "outside": "unexplained"}.get(found, "named")
    print(json.dumps({"verdict": verdict, "causes": causes, "ambiguous_with": [],
        "beyond_tolerance": [], "parameters": [{"found": 0.0, "std": 0.0}] * 3}))
"""


def test_a_bench_runs_through_a_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that reads the truth off the file names is right but for pairs and coverage."""
    script = tmp_path / "echo.py"
    script.write_text(ECHO, encoding="utf-8")
    monkeypatch.setattr(run, "program", lambda: [sys.executable, str(script)])
    counts, kept = Counts(single=1, healthy=4, outside=1, pair=1), tmp_path / "kept"
    drawn = draw_gauges([PROTOTYPE], [MICRON, DIAL], counts, seed=3)
    bench = run_bench(drawn, holdouts=1, seed=3, keep=kept)
    assert len(bench.judged) == 2 * (len(CAUSES) + 4 + len(OUTSIDE) + 30)
    wrong = {j.kind for j in bench.judged if not j.right}
    assert wrong <= {"pair", "half pair"}
    assert "pair" in wrong
    # Its intervals have no width, and its later errors are 0.006 over the noise of each gauge.
    assert any("coverage of healthy" in text for text in failures(bench))
    assert bench.later[0].sessions == 2
    ratios = np.array([0.006 / DIAL.sigma, 0.006 / MICRON.sigma])
    assert bench.later[0].after == pytest.approx(np.sqrt(np.mean(ratios**2)))
    assert "MISSED" in full_report(bench)
    assert len(list(kept.glob("healthy-*.csv"))) == 8
    assert len((kept / "truths.jsonl").read_text().splitlines()) == len(bench.judged)


def test_a_program_that_skips_a_file_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "program", lambda: [sys.executable, "-c", "print('')"])
    with pytest.raises(run.RunError, match="0 answers for 1 files"):
        run.diagnose(tmp_path, [("a", make_session(1, PROTOTYPE, MICRON))])
