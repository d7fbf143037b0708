"""A cause of many parameters of which one acts."""

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import diagnose
from orthoglide_cal.diagnosis.evidence import NoiseGrid
from orthoglide_cal.diagnosis.sparse import ALL, with_single
from tests import truth
from tests.diagnosis.sessions import known
from tests.diagnosis.test_evidence import dense
from tests.truth.effects import Effect


def test_evidence_is_the_mean_over_all_and_each() -> None:
    """By dense covariances; the first positions of backlash are always free."""
    rng = np.random.default_rng(3)
    noise, cause = NoiseGrid.around(0.004), CAUSES["backlash"]
    others, own = rng.normal(0.0, 0.02, (20, 3)), rng.normal(0.0, 0.02, (20, 6))
    residual = own[:, 1] + rng.normal(0.0, 0.004, 20)

    def averaged(columns: np.ndarray) -> float:
        logs = [dense(columns, float(sigma), residual) for sigma in noise.sigma]
        return float(np.logaddexp.reduce(noise.log_weight + logs))

    together = averaged(np.hstack((others, own)))
    each = [averaged(np.column_stack((others, own[:, 3:], own[:, k]))) for k in range(3)]
    expected = np.log(ALL * np.exp(together) + (1.0 - ALL) * np.mean(np.exp(each)))
    gap = rng.normal(0.0, 0.02, (20, 3))
    alone = with_single([(cause, own, together)], others, residual, noise)
    both = [(CAUSES["axis_gap"], gap, 0.0), (cause, own, together)]
    assert alone == pytest.approx([expected], abs=1e-6)
    assert with_single(both, others, residual, noise)[1] == pytest.approx(expected, abs=1e-6)
    assert each[1] == max(*each, together)


def one_alone(cause: str, size: float, place: int, seed: int) -> truth.Session:
    rng = np.random.default_rng([seed, place])
    plan = truth.standard_plan(truth.PROTOTYPE, rng)
    parameters = np.zeros(len(CAUSES[cause].names))
    parameters[place] = size * rng.choice([-1.0, 1.0])
    effect = Effect(cause, "", tuple(parameters.tolist()))
    offsets = rng.normal(0.0, 0.5, 3)
    return truth.measure(truth.PROTOTYPE, truth.MICRON, plan, offsets, (effect,), rng)


@pytest.mark.parametrize(
    ("cause", "size", "places"),
    [("bar_skew", 0.2, 6), ("axis_gap", 0.06, 3), ("axis_squareness", 0.4, 3)],
)
def test_one_that_acts_alone_is_found(cause: str, size: float, places: int) -> None:
    """Small beside its tolerance: priced for all its parameters it would lose its name."""
    first = 0
    for place in range(places):
        for seed in (1, 2, 3):
            found = diagnose(*known(one_alone(cause, size, place, seed)))
            ids = [named.id for named in found.causes]
            assert cause in {*ids, *found.ambiguous_with}, (place, seed)
            assert found.verdict in ("named", "ambiguous")
            first += ids[:1] == [cause]
    assert first >= 0.8 * 3 * places
