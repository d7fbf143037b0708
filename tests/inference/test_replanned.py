"""Data read under another plan: exchanged gauges where readings are missing, several sittings."""

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference import data
from orthoglide_cal.inference.data import Candidates, Linearised, Whitened
from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.inference.fit import fit_hypothesis
from orthoglide_cal.inference.hypothesis import score_all
from orthoglide_cal.model.model import Place
from tests import truth
from tests.inference.sessions import ids, known
from tests.machines import sure
from tests.readings import some
from tests.truth import again

SWAP = CAUSES["swapped_gauges"]


def swapped(
    seed: int, gauge: truth.Gauge, beside: tuple[str, ...] = (), exact: bool = False
) -> truth.Session:
    hidden = ("swapped_gauges", *beside)
    return truth.make_session(seed, truth.PROTOTYPE, gauge, hidden, exact=exact)


@pytest.mark.parametrize(("seed", "gauge"), [(1, truth.MICRON), (4, truth.DIAL)])
def test_a_missing_reading_does_not_hide_them(seed: int, gauge: truth.Gauge) -> None:
    session = swapped(seed, gauge)
    readings, model = known(session)
    whole = diagnose(readings, model)
    assert [cause.id for cause in whole.causes] == ["swapped_gauges"]
    own = readings.plan.leg == "xyz".index(whole.causes[0].where[-1])
    dropped = np.arange(len(readings)) == np.random.default_rng(seed).choice(np.flatnonzero(own))
    found = diagnose(some(readings, ~dropped), model)
    assert [cause.id for cause in found.causes] == ["swapped_gauges"]
    assert found.causes[0].where == whole.causes[0].where
    assert np.all(np.abs(found.offsets_mm - session.offsets) < 4.5 * found.std_mm)
    # One reading in sixty moves the offsets by a fraction of their uncertainty.
    assert np.all(np.abs(found.offsets_mm - whole.offsets_mm) < whole.std_mm)
    assert found.causes[0].heldout_after_mm == pytest.approx(gauge.sigma, rel=0.4)
    left = found.measured.value - found.explained_mm
    assert np.sqrt(np.mean(left**2)) < 1.3 * gauge.sigma


def test_nor_does_a_cause_of_the_machine_beside_it() -> None:
    session = swapped(2, truth.MICRON, ("axis_squareness",))
    readings, model = known(session)
    whole = diagnose(readings, model)
    assert {cause.id for cause in whole.causes} == {"swapped_gauges", "axis_squareness"}
    (where,) = (cause.where for cause in whole.causes if cause.id == "swapped_gauges")
    own = readings.plan.leg == "xyz".index(where[-1])
    found = diagnose(some(readings, ~(own & (readings.cycle == 2))), model)
    assert set(ids(found)) == {"swapped_gauges", "axis_squareness"}


def test_healthy_sessions_with_gaps_are_healthy() -> None:
    for seed in range(1, 3):
        readings, model = known(truth.make_session(seed, truth.PROTOTYPE, truth.DIAL))
        dropped = np.random.default_rng(seed).random(len(readings)) < 0.1
        assert diagnose(some(readings, ~dropped), model).verdict == "consistent"


def test_where_nothing_is_missing_it_is_as_undoing_it_in_the_data(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Evidence, offsets and residuals of each leg's exchange, by either way."""
    readings, model = known(swapped(3, truth.MICRON, exact=True))
    model = sure(model)
    white = Whitened.of(readings, model)
    candidates = Candidates.of(model, ordered=True)
    score = score_all(Linearised.of(white, candidates))[("swapped_gauges",)]
    assert score.replanned is None
    undone = fit_hypothesis(score)
    monkeypatch.setattr(type(SWAP), "reversible", lambda *_: False)
    data.places_of.cache_clear()
    other = score_all(Linearised.of(white, candidates))[("swapped_gauges",)]
    under = fit_hypothesis(other)
    assert other.replanned is not None
    assert other.extra.place == score.extra.place
    assert [effect.cause for effect in under.effects] == [SWAP]
    assert under.log_evidence == pytest.approx(undone.log_evidence, abs=0.05)
    assert under.offsets == pytest.approx(undone.offsets, abs=1e-5)
    spread = under.offsets_covariance
    assert np.diag(spread) == pytest.approx(np.diag(undone.offsets_covariance), rel=2e-3)
    assert under.residual @ under.residual == pytest.approx(undone.residual @ undone.residual)
    assert Diagnosis.about(readings, model).settled().accepted == ("swapped_gauges",)


@pytest.mark.parametrize("fault", ["sign_flip", "swapped_gauges", "gauge_drift"])
def test_a_fault_is_named_with_its_part(fault: str) -> None:
    # A slow technician sees what creeps.
    session = truth.make_session(3, truth.PROTOTYPE, truth.MICRON, (fault,), pace=3.0)
    found = diagnose(*known(again(session)))
    assert [cause.id for cause in found.causes] == [fault]
    (effect,), (cause,) = session.effects, found.causes
    assert cause.where.endswith(", part 1")
    own = f"leg {effect.where[0]}" if effect.leg is not None else f"leg {effect.where[0]}, "
    assert cause.where.startswith(own)
    assert np.all(np.abs(found.offsets_mm - session.offsets) < 4.5 * found.std_mm)
    whole = diagnose(*known(session))
    assert whole.causes[0].where == cause.where.removesuffix(", part 1")


def test_places_of_the_parts() -> None:
    """Gauges of each part have their own faults; of the whole table none, where two were joined."""
    session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON)
    one, model = known(session)
    two, _ = known(again(session))
    both = {
        id: (cause.places(one.plan, model.machine), cause.places(two.plan, model.machine))
        for id, cause in CAUSES.items()
    }
    for id in ("sign_flip", "gauge_drift", "swapped_gauges"):
        single, joined = (tuple(p for p in each if p) for each in both[id])
        assert joined == (*single, *(Place((*place[:-1], 1)) for place in single))
    assert both["exchanged_columns"] == ((Place(),), ())
    assert both["wrong_unit"][1] == ()
    assert Place() in both["sign_flip"][0]
    assert Place() not in both["sign_flip"][1]
    swap, later = CAUSES["swapped_gauges"], Place((1, 1))
    index, _ = swap.relabel(two.plan, later)
    moved = index != np.arange(120)
    assert moved.tolist() == ((two.plan.leg == 1) & (two.plan.part == 1)).tolist()
    really = swap.really_read(two.plan, later)
    assert (really.direction != two.plan.direction).tolist() == moved.tolist()
    assert swap.label(later, two.plan, model.machine) == "leg y, part 2"
    flip = CAUSES["sign_flip"]
    _, signs = flip.relabel(two.plan, Place((0, 1, 1)))
    assert np.flatnonzero(signs < 0.0).tolist() == list(range(60, 80, 2))


def test_gauges_are_exchanged_only_where_the_step_was_the_same() -> None:
    """A reading with another offset entered is none of the same step."""
    session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON)
    step = np.outer(np.arange(60) == 59, [0.5, 0.0, 0.0])
    readings, _ = known(again(session, entered=step))
    swap = CAUSES["swapped_gauges"]
    assert swap.reversible(readings.plan, Place((2, 0)))
    assert not swap.reversible(readings.plan, Place((2, 1)))
