"""Separations of causes before a reading is taken, against those of the independent truth."""

from collections.abc import Mapping

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import OFFSET_MM, Orthoglide
from orthoglide_cal.planning.forecast import session_of
from orthoglide_cal.planning.separation import Separations, separations
from orthoglide_cal.planning.steps import MeasuringProtocol
from tests import truth
from tests.inference.sessions import known
from tests.machines import NOMINAL, both_models, sure
from tests.truth.effects import Effect
from tests.truth.forward import PARTS, prior_sd
from tests.truth.machines import TOLERANCES
from tests.truth.plan import SETUPS, standard_plan

OWN = [id for id, cause in CAUSES.items() if Orthoglide in cause.sizes]

DOUBLE, SINGLE, BEST = MeasuringProtocol
HIDDEN = (truth.PROTOTYPE, truth.MICRON)


def sigma(found: Separations, a: str, b: str) -> float:
    ids = [cause.id for cause in found.causes]
    return float(found.sigma[ids.index(a), ids.index(b)])


def effects(cause: str, plan: truth.Plan, rng: np.random.Generator, count: int) -> list[Effect]:
    """Of plausible size: sizes of random signs, places drawn from all; in the truth's own terms."""
    found = []
    for _ in range(count):
        if cause in PARTS:
            size = prior_sd(cause) * rng.choice([-1.0, 1.0], len(prior_sd(cause)))
            if cause == "backlash":
                size[:3] = np.abs(size[:3])
            found.append(Effect(cause, parameters=tuple(size.tolist())))
            continue
        setup = int(rng.integers(6))
        rows = np.flatnonzero(plan.setup == setup)
        row = int(rng.choice(rows[1:] if cause == "stand_shift" else rows))
        size_one = (TOLERANCES[cause],)
        found.append(Effect(cause, "", size_one, setup=setup, row=row, leg=SETUPS[setup][0]))
    return found


def drawn(cause: str, plan: truth.Plan, count: int) -> list[Mapping[str, float]]:
    """How far each explanation is from sessions of one cause [σ]."""
    rng = np.random.default_rng(5)
    found = []
    for effect in effects(cause, plan, rng, count):
        offsets = OFFSET_MM * rng.choice([-1.0, 1.0], 3)
        session = truth.measure(*HIDDEN, plan, offsets, (effect,), rng)
        found.append(truth.separation(session).distances)
    return found


def of_truth(a: str, b: str, of_a: list[Mapping[str, float]]) -> float:
    """How much worse b explains what a does, than a itself; typically [σ]."""
    margins = []
    for distances in of_a:
        # The truth has no sign flip of the whole table: that is what opposite offsets give.
        rival = min(distances[b], distances[truth.HEALTHY] if b == "sign_flip" else np.inf)
        margins.append(max(rival**2 - distances[a] ** 2, 0.0))
    return float(np.sqrt(np.mean(margins)))


PAIRS = [
    ("axis_gap", "bar_skew"),
    ("axis_gap", "axis_squareness"),
    ("encoder_scale", "backlash"),
    ("stand_shift", "misread"),
    ("misread", "axis_gap"),
    ("sign_flip", "swapped_gauges"),
    ("bar_skew", "swapped_gauges"),
]
QUICK = [("axis_gap", "bar_skew")]
ALONE = ("encoder_scale", "thermal_drift", "gauge_drift", "backlash")


@pytest.mark.parametrize(
    ("pairs", "alone"),
    [(QUICK, ("gauge_drift",)), pytest.param(PAIRS, ALONE, marks=pytest.mark.slow)],
    ids=["quick", "all"],
)
def test_separations_are_those_of_the_truth(
    pairs: list[tuple[str, str]], alone: tuple[str, ...]
) -> None:
    """60 draws of a cause in each direction: a mean of squares is met within 35 %, its root in 17.

    The truth's distances come from fits with another forward model at the sizes drawn. A trace is
    how far a cause is from nothing.
    """
    plan = standard_plan(HIDDEN[0], np.random.default_rng(1))
    session = truth.measure(*HIDDEN, plan, np.zeros(3), (), np.random.default_rng(2))
    readings, model = known(session)
    found = separations(sure(model), readings.plan)
    draws = {cause: drawn(cause, plan, 60) for cause in dict.fromkeys((*sum(pairs, ()), *alone))}
    for a, b in pairs:
        expected = min(of_truth(a, b, draws[a]), of_truth(b, a, draws[b]))
        assert sigma(found, a, b) == pytest.approx(expected, rel=0.17, abs=0.1), (a, b)
    traces = dict(zip([cause.id for cause in found.causes], found.trace.tolist(), strict=True))
    for cause in alone:
        expected = of_truth(cause, truth.HEALTHY, draws[cause])
        assert traces[cause] == pytest.approx(expected, rel=0.17)


@both_models
@pytest.mark.parametrize("protocol", [DOUBLE, SINGLE, BEST])
def test_a_longer_leg_is_never_seen(model: Model, protocol: MeasuringProtocol) -> None:
    found = separations(model, session_of(model, protocol, 3).plan)
    assert CAUSES["leg_length"] in found.invisible
    assert CAUSES["leg_length"] not in found.visible.causes
    assert CAUSES["axis_gap"] in found.visible.causes


def test_the_table_is_symmetric_and_its_pairs_are_sorted() -> None:
    found = separations(NOMINAL, session_of(NOMINAL, DOUBLE, 3).plan)
    count = len(found.causes)
    assert found.sigma == pytest.approx(found.sigma.T)
    assert np.all(np.diag(found.sigma) == 0.0)
    assert len(found.pairs) == count * (count - 1) // 2
    sigmas = [*found.pairs.values()]
    assert sigmas == sorted(sigmas)
    for causes, apart in found.pairs.items():
        assert apart == sigma(found, *causes)
