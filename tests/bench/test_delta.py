"""The blind bench of printers, small and full (-m slow)."""

import numpy as np
import pytest

from tests.truth.delta import V400, Layout, Truth, probe_bed
from tests.truth.delta_separation import DELTA_CAUSES, delta_separation
from tests.truth.plan import frozen

from .delta import DeltaCounts, report, run
from .scoring import Judged, rates


@pytest.fixture(scope="module")
def quick() -> list[Judged]:
    """Two sessions per cause, of no more than 41 places."""
    return run(DeltaCounts(single=2, healthy=12, largest=41), seed=11)


@pytest.mark.slow
def test_quick_bench_is_not_below_the_demands(quick: list[Judged]) -> None:
    """Fails a rate only if a method exactly at the demanded one had less than 1e-3 chance."""
    assert {item.case.session.label for item in quick} == {"healthy", *DELTA_CAUSES}
    for rate in rates(quick):
        assert rate.chance_if_met > 1e-3, report(quick)


@pytest.mark.slow
def test_full_bench_meets_the_demands() -> None:
    judged = run(DeltaCounts(), seed=1)
    assert all(rate.met for rate in rates(judged)), report(judged)


def _stands(layout: Layout) -> dict[str, float]:
    truth = Truth(leans=frozen(np.array([[3.0, -1.5], [1.0, -8.0], [1.0, -7.0]])))
    rng = np.random.default_rng(3)
    return delta_separation(probe_bed(V400, truth, ("tower_lean",), layout, rng)).distances


def test_three_heights_tell_a_lean_from_a_bent_bed_and_one_does_not() -> None:
    """At the same number of touches."""
    flat, high = _stands(Layout(75)), _stands(Layout(25, (0.0, 25.0, 50.0)))
    assert min(flat["healthy"], high["healthy"]) > 6.0
    assert high["bed_shape"] > 2.0 * flat["bed_shape"]


def test_its_own_cause_costs_no_more_than_its_size() -> None:
    """The best fit of the true cause is at least as good as the truth: squares of its sizes."""
    distances = _stands(Layout(41))
    own = np.sqrt(sum(lean**2 for lean in (3.0, 1.5, 1.0, 8.0, 1.0, 7.0))) / 2.0
    assert 0.0 < distances["tower_lean"] <= 1.02 * own
    assert distances["tower_lean"] < distances["healthy"]
