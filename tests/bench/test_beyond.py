"""What is demanded of an answer to an effect beyond the list, and that the bench of these runs."""

from dataclasses import replace
from typing import Any

import pytest

from tests.truth import MICRON, PROTOTYPE
from tests.truth.beyond import Beyond, Distinction, Rival, Where, draw_beyond

from .__main__ import main
from .beyond import Described, failures_beyond, report_beyond
from .scoring import Answer

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
