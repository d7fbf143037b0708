"""The benches' own judgement, on answers and files made up for the purpose; and that they run."""

import re
import sys
from dataclasses import replace
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orthoglide_cal.files.input import read_input
from tests.printer_files import OFF, printer_cfg
from tests.truth import CAUSES, DIAL, MICRON, PROTOTYPE, Separation, all_pairs, make_session
from tests.truth.beyond import Beyond, Distinction, Rival, Where, draw_beyond
from tests.truth.delta import V400, Truth

from . import cases, real, run
from .__main__ import main
from .accuracy import coverage, heldout
from .beyond import Described, failures_beyond, report_beyond
from .cases import Case, Counts, draw_gauges
from .report import failures, full_report
from .run import run_bench
from .scoring import Answer, Judged, Rate, band, chance_below, rates


def _case(*hidden: str, near: float = 9.0, **distances: float) -> Case:
    """Every rival is `near`, but those that have a distance of their own."""
    far = {**dict.fromkeys(CAUSES, near), "healthy": 9.0, **distances}
    rivals = sorted((c for c in far if (c,) != hidden), key=lambda c: far[c])
    far_away = Separation(hidden, far, tuple(rivals))
    return Case("case", make_session(1, PROTOTYPE, MICRON, hidden), far_away)


def _named(
    *ids: str, aliases: tuple[str, ...] = (), also: tuple[str, ...] = (), **more: object
) -> Answer:
    held_out = {"heldout_before_mm": 0.004, "heldout_after_mm": 0.0035, "heldout_ratio": None}
    causes = [{"id": name, "aliases": aliases, **held_out} for name in ids]
    return Answer({"verdict": "named", "causes": causes, "ambiguous_with": also, **more})


CONSISTENT = Answer({"verdict": "consistent", "causes": [], "beyond_tolerance": []})


def test_a_case_asks_for_what_its_distances_allow() -> None:
    assert _case("axis_gap").kind == "distinct"
    assert _case("axis_gap", near=3.9).kind == "close"
    assert _case("axis_gap", healthy=3.9).kind == "faint"
    assert _case("axis_gap", near=4.5, axis_gap=3.0).kind == "distinct"
    assert _case("misread", "axis_gap").kind == "pair"
    assert _case("misread", "axis_gap", near=2.0).kind == "half pair"
    healthy = Case("h", make_session(1, PROTOTYPE, MICRON), None)
    outside = Case("o", make_session(1, PROTOTYPE, MICRON, outside="noisy_leg"), None)
    assert (healthy.kind, outside.kind) == ("healthy", "outside")


DISTINCT, CLOSE, FAINT = (_case("bar_skew", **far) for far in ({}, {"near": 3.0}, {"healthy": 3.0}))
PAIR = _case("misread", "axis_gap")
# Near a misreading alone: the gap does not show, the misreading must be found.
HALF = _case("misread", "axis_gap", misread=2.0)


@pytest.mark.parametrize(
    ("case", "answer", "right"),
    [
        (DISTINCT, _named("bar_skew"), True),
        (DISTINCT, _named("axis_gap", aliases=("bar_skew",)), False),
        (DISTINCT, _named("bar_skew", verdict="unexplained"), False),
        (CLOSE, _named("axis_gap", aliases=("bar_skew",)), True),
        (CLOSE, _named("axis_gap", also=("bar_skew",)), True),
        (CLOSE, _named("axis_gap"), False),
        (CLOSE, CONSISTENT, False),
        (FAINT, CONSISTENT, True),
        (FAINT, _named("axis_gap"), False),
        (PAIR, _named("axis_gap", "misread"), True),
        (PAIR, _named("bar_skew", "misread", aliases=("axis_gap",)), True),
        (PAIR, _named("misread"), False),
        (HALF, _named("misread"), True),
        (HALF, _named("axis_gap"), False),
        (DISTINCT, Answer({"input": "a.csv", "error": "no such file"}), False),
    ],
)
def test_distinct_truths_must_come_first_and_close_ones_be_mentioned(
    case: Case, answer: Answer, right: bool
) -> None:
    assert Judged(case, answer).right is right


def test_rates_count() -> None:
    answers = ((DISTINCT, "bar_skew"), (DISTINCT, "misread"), (CLOSE, "bar_skew"))
    distinct, close = rates([Judged(case, _named(id)) for case, id in answers])
    assert (distinct.right, distinct.total, distinct.met) == (1, 2, False)
    assert (close.right, close.total, close.met) == (1, 1, True)


def test_coverage_and_heldout_look_at_right_models_only() -> None:
    case = _case("axis_gap")
    off = zip(case.session.offsets.tolist(), (0.0, 0.019, -0.02), strict=True)
    parameters = [{"found": true + error, "std": 0.01} for true, error in off]
    judged = [Judged(case, _named(id, parameters=parameters)) for id in ("axis_gap", "bar_skew")]
    (row,) = coverage(judged)
    assert (row.sessions, row.inside) == (1, 2)
    (ratio,) = heldout(judged)
    assert ratio.sessions == 1
    assert ratio.before / ratio.after == pytest.approx(0.004 / 0.0035)


def test_binomial_chances_are_those_of_their_words() -> None:
    # Below 40 % of 10 means at most 3; below 97 % of 100 at most 96.
    few = sum(comb(10, k) * 0.4**k * 0.6 ** (10 - k) for k in range(4))
    assert chance_below(0.4, 10, 0.4) == pytest.approx(few)
    assert Rate("outside", 3, 4).chance_if_met == pytest.approx(1.0 - 0.9**4)
    few = 1.0 - sum(comb(100, k) * 0.01**k * 0.99 ** (100 - k) for k in range(4))
    assert Rate("distinct", 96, 100).false_failure == pytest.approx(few)
    low, high = band(400, 0.93, 0.97)
    assert 0.87 < low < 0.92
    assert 0.98 < high < 1.0


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
    monkeypatch.setattr(run, "PROGRAM", [sys.executable, str(script)])
    monkeypatch.setattr(cases, "all_pairs", lambda: all_pairs()[::6])
    monkeypatch.setattr(cases, "OUTSIDE", ("leg_bending",))
    counts, kept = Counts(single=1, healthy=4, outside=1, pair=1), tmp_path / "kept"
    drawn = draw_gauges([PROTOTYPE], [MICRON, DIAL], counts, seed=3)
    bench = run_bench(drawn, holdouts=1, seed=3, keep=kept)
    assert len(bench.judged) == 2 * (len(CAUSES) + 4 + 1 + 5)
    wrong = {j.kind for j in bench.judged if not j.right}
    assert wrong <= {"pair", "half pair"}
    assert "pair" in wrong
    # Its intervals have no width, and its later errors are 0.006 over the noise of each gauge.
    (missed,) = (text for text in failures(bench) if "coverage of healthy" in text)
    assert bench.later[0].sessions == 2
    ratios = np.array([0.006 / DIAL.sigma, 0.006 / MICRON.sigma])
    assert bench.later[0].after == pytest.approx(np.sqrt(np.mean(ratios**2)))
    assert missed in full_report(bench)
    assert len(list(kept.glob("healthy-*.csv"))) == 8


HIDDEN = draw_beyond(5, PROTOTYPE, MICRON, "steps", "leg")
LEG = "xyz"[HIDDEN.where.leg or 0]


def _answer(hidden: Beyond, *patterns: dict[str, Any], expanded: float = 0.01) -> Answer:
    pairs = zip((0.009, -0.002, 0.011), hidden.session.offsets.tolist(), strict=True)
    offsets = [{"found": true + error, "expanded": expanded} for error, true in pairs]
    release = {"usable": bool(patterns)}
    return Answer(
        {"verdict": "unexplained", "patterns": patterns, "parameters": offsets, "release": release}
    )


def _described(
    how: str, where: dict[str, str], far: float = 9.0, after: float = 0.004
) -> Described:
    rival = Rival("settles", HIDDEN.where, far)
    same = frozenset([("steps", HIDDEN.where), ("steps", Where())])
    error = {"heldout_before_mm": 0.02, "heldout_after_mm": after}
    told = _answer(HIDDEN, {"how": how, "where": where, **error})
    return Described(HIDDEN, Distinction(same, rival), told, _answer(HIDDEN, expanded=0.004))


@pytest.mark.parametrize(
    ("how", "where", "right"),
    [
        ("steps", {"leg": LEG}, (True, True)),
        ("steps", {"leg": LEG, "direction": None}, (True, True)),
        ("steps", {}, (True, True)),  # one stand at a time: the same thing
        ("steps", {"direction": LEG}, (True, False)),
        ("settles", {"leg": LEG}, (False, False)),
    ],
)
def test_kind_and_place_must_be_those_of_the_truth_or_the_same_on_this_plan(
    how: str, where: dict[str, str], right: tuple[bool, bool]
) -> None:
    described = _described(how, where)
    assert (described.how_right, described.where_right) == right
    assert described.held_out == pytest.approx(0.2)
    assert described.inside == [True, True, False]
    assert described.wider == pytest.approx([2.5] * 3)


def test_only_clear_sessions_are_demanded() -> None:
    good, bad = _described("steps", {}), _described("drifts", {}, after=0.02)
    missed = failures_beyond([good, bad, bad] * 10)
    assert [text.split(":")[0] for text in missed] == [
        "how", "how and where", "coverage", "held-out ratio of steps", "U with steps"
    ]  # fmt: skip
    faint = _described("drifts", {}, far=3.9)
    assert not any("how" in text for text in failures_beyond([good, faint]))
    assert "33.3%" in report_beyond([good, bad, bad])


def test_an_answer_without_a_description_is_wrong() -> None:
    far = _described("steps", {}).far
    silent = Described(HIDDEN, far, _answer(HIDDEN), _answer(HIDDEN))
    failed = Described(HIDDEN, far, Answer({"input": "a.csv", "error": "no"}), _answer(HIDDEN))
    for described in (silent, failed):
        assert not described.how_right
        assert described.held_out is None
        assert not described.released
    assert failed.inside == failed.wider == []
    causes = [{"id": "stand_shift"}]
    named = replace(silent, answer=Answer({"verdict": "named", "causes": causes}))
    assert named.misnamed
    assert not silent.misnamed
    assert any("does not act: 1 of 2" in text for text in failures_beyond([silent, named]))


@pytest.mark.slow
def test_the_bench_of_effects_beyond_the_list_runs(capsys: pytest.CaptureFixture[str]) -> None:
    one = "--beyond 1 --seed 4 --machine prototype --gauge micron"
    assert main(one.split()) in (0, 1)
    printed = capsys.readouterr().out
    assert "hidden  drawn  clear" in printed
    assert {"repeats", "drifts", "nothing"} <= set(printed.split())


LONGER = replace(OFF, arms=np.array([0.6, -0.4, 0.1]))


def put(folder: Path, name: str, truth: Truth, noise: float = 0.0) -> str:
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    text = printer_cfg(V400, truth, noise=noise, seed=sum(name.encode()))
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_names_that_differ_in_a_date_are_of_one_machine(tmp_path: Path) -> None:
    names = ("v400_2023-08-20.cfg", "v400_2023-09-10.cfg", "printer-20241223_204558.cfg", "k/a.cfg")
    for name in (*names, "k/b.cfg", "README.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name, encoding="utf-8")
    (tmp_path / "k/c.cfg").write_text("k/a.cfg", encoding="utf-8")  # the same again
    found = {name: [path.name for path in paths] for name, paths in real.machines(tmp_path)}
    assert found == {"v400": list(names[:2]), "printer": [names[2]], "k": ["a.cfg", "b.cfg"]}


def test_arms_of_one_date_predict_another(tmp_path: Path) -> None:
    """They are the reason here: what parameters alone leave is gone."""
    moved = replace(LONGER, endstops=np.array([0.1, 0.3, -0.2]))
    files = put(tmp_path, "one.cfg", LONGER), put(tmp_path, "two.cfg", moved)
    first, second = (read_input(path, stored="mesh") for path in files)
    # Second-order terms: (0.6 mm)² by the length of an arm.
    assert real.with_arms(first, second) < 2e-4
    # Arms of a machine whose arms are right say nothing of those that are not.
    sound = read_input(put(tmp_path, "sound.cfg", OFF), stored="mesh")
    assert real.with_arms(sound, second) > 1e-3


@pytest.mark.slow
def test_a_folder_gives_a_table_and_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("one/2024-01-01.cfg", "one/2024-02-01.cfg"):
        put(tmp_path, name, LONGER, noise=0.012)
    (tmp_path / "broken.cfg").write_text("[printer]\nkinematics: delta\n", encoding="utf-8")
    assert real.main([str(tmp_path), "--json", str(tmp_path / "out.json")]) == 0
    said = capsys.readouterr().out
    assert "2 predictions; extension by the better baseline" in said
    assert len(re.findall("^one +2024-0", said, re.MULTILINE)) == 4
    assert '"earlier_map"' in (tmp_path / "out.json").read_text(encoding="utf-8")
