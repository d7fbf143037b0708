"""The blind bench against the program: small ones, and the full ones (-m slow)."""

from collections import Counter

import numpy as np
import pytest

from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.planning.next_measurement import best_next
from tests.inference.sessions import known
from tests.truth import (
    CAUSES,
    GAUGES,
    HEALTHY,
    MACHINES,
    MICRON,
    OUTSIDE,
    PROTOTYPE,
    all_pairs,
    make_session,
)
from tests.truth.delta import V400, Layout, Truth, probe_bed
from tests.truth.delta_separation import DELTA_CAUSES, delta_separation
from tests.truth.plan import frozen

from .ambiguous import draw, is_named, joined_diagnosis, tally
from .cases import FULL, FULL_PRINTERS, Counts, draw_gauges, draw_printers
from .report import failures, full_report
from .run import run_bench
from .scoring import rates


def test_quick_bench_is_not_below_the_demands() -> None:
    """Fails a rate only if a method exactly at the demanded one had less than 1e-4 chance.

    Chance of false failure for a method at the demands: below 3e-4 over three rates; for a sound
    one (99 %) below 1e-7. Pairs and effects beyond the list are those of `test_verdicts`.
    """
    counts = Counts(single=1, healthy=6, outside=0, pair=0)
    bench = run_bench(draw_gauges([PROTOTYPE], [MICRON], counts, seed=11))
    assert "error" not in {judged.answer.verdict for judged in bench.judged}
    for rate in rates(bench.judged):
        assert rate.chance_if_met > 1e-4, full_report(bench)


@pytest.mark.slow
def test_full_bench_meets_the_demands() -> None:
    """All demands with 20 sessions per cause on two machines with two gauges, 500 healthy ones.

    Chance of false failure for a sound method, as the table prints it: distinct 3e-5 (99 % true
    against 97 % of 630), close 2e-4 (99.5 % against 97 % of 225), healthy 6e-4 (99.8 % against
    99 % of 500), outside 2e-5 (97 % against 90 % of 140), pairs 1e-5 (97 % against 90 % of 167);
    coverage 2e-3 for each of some ten causes at the bounds, far less inside them.
    """
    drawn = draw_gauges(list(MACHINES.values()), list(GAUGES.values()), FULL, seed=1)
    bench = run_bench(drawn, holdouts=2)
    print(full_report(bench))
    kinds = Counter(item.case.session.label for item in bench.judged)
    assert kinds[HEALTHY] == 500
    assert {kinds[cause] for cause in CAUSES} == {4 * 20}
    assert {kinds[f"outside:{kind}"] for kind in OUTSIDE} == {4 * 5}
    assert not failures(bench)


@pytest.mark.slow
def test_full_bench_of_printers_meets_the_demands() -> None:
    bench = run_bench(draw_printers(FULL_PRINTERS, seed=1))
    assert {item.case.session.label for item in bench.judged} >= {HEALTHY, *DELTA_CAUSES}
    assert not failures(bench), full_report(bench)


def test_three_heights_tell_a_lean_from_a_bent_bed_and_one_does_not() -> None:
    """At the same number of touches; and the lean itself costs no more than its size."""
    leans = np.array([[3.0, -1.5], [1.0, -8.0], [1.0, -7.0]])
    truth, rng = Truth(leans=frozen(leans)), np.random.default_rng(3)
    flat, high = (
        delta_separation(probe_bed(V400, truth, ("tower_lean",), layout, rng)).distances
        for layout in (Layout(75), Layout(25, (0.0, 25.0, 50.0)))
    )
    assert min(flat["healthy"], high["healthy"]) > 6.0
    assert high["bed_shape"] > 2.0 * flat["bed_shape"]
    # The best fit of the true cause is at least as good as the truth: squares of its sizes.
    for distances in (flat, high):
        assert 0.0 < distances["tower_lean"] <= 1.02 * np.linalg.norm(leans) / 2.0
        assert distances["tower_lean"] < distances["healthy"]


def test_a_knock_that_nothing_can_show_is_one_wrong_reading() -> None:
    """Before the last reading of a stand that is gone, or after the first of any: no open choice.

    Before the last reading of the leg that was read last it stays open, and the next reading tells.
    """
    told, shown = 0, 0
    for n in (2, 26, 27, 32, 35, 36, 37, 38):  # mostly at either end of a stand's readings
        session = make_session(8_100_000 + n, PROTOTYPE, MICRON, ("stand_shift",))
        (knock,), plan = session.effects, session.plan
        rows = np.flatnonzero(plan.setup == knock.setup)
        found = diagnose(*known(session))
        if knock.row == rows[1] or (knock.row == rows[-1] and plan.leg[rows[0]] != plan.leg[-1]):
            told += 1
            assert is_named(session, found, aliases=True)
            assert not is_named(session, found)
            assert [(c.id, c.aliases) for c in found.causes] == [("misread", ("stand_shift",))]
            wrong = rows[0] if knock.row == rows[1] else rows[-1]
            assert f"(reading {wrong + 1})" in found.causes[0].where
            assert best_next(found) is None
        elif knock.row == rows[-1]:
            shown += 1
            assert found.verdict is Verdict.AMBIGUOUS
            following = best_next(found)
            assert set(following.between) == {("misread",), ("stand_shift",)}
            assert is_named(session, joined_diagnosis(session, following, n))
        else:
            assert is_named(session, found)
    assert told >= 5
    assert shown >= 1


@pytest.mark.slow
def test_of_all_pairs_that_occur_nine_in_ten_are_decided() -> None:
    """Every cause and every pair of causes, both machines, both gauges: over 100 sessions.

    All recommendations count. A knock that no reading can show is counted both ways: by its id it
    is missed, as the answer it is right.
    """
    hidden = *((cause,) for cause in CAUSES), *all_pairs()
    found = tally(draw(77, hidden, 8, MACHINES.values(), GAUGES.values()), 77)
    print(found)
    assert found.counts["asked"] >= 60, found
    assert found.share() >= 0.90, found
    assert found.share("answered") >= 0.90, found
    # Few are left without a recommendation, and what is foretold is neither boast nor modesty.
    assert found.counts["silent"] <= 0.1 * found.counts["asked"], found
    assert abs(found.chance / found.counts["asked"] - found.share("answered")) < 0.07, found
    assert found.share("bottom") <= 0.5 * found.share(), found
