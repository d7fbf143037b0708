"""What a diagnosis holds: in the order of the file, one form of a cause."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.input import read_input
from orthoglide_cal.inference import Diagnosis, Verdict, diagnose
from orthoglide_cal.inference.data import Whitened
from orthoglide_cal.inference.decision import decide
from orthoglide_cal.inference.fit import Fit
from orthoglide_cal.inference.patterns import PLANNED
from orthoglide_cal.model.cause import Effect
from orthoglide_cal.model.measured import DIFFERENCES, DataKind
from orthoglide_cal.model.model import simulate
from orthoglide_cal.model.orthoglide import ideal_plan, reduction
from orthoglide_cal.model.plan import without_zeros
from orthoglide_cal.paper.tables import experiment
from tests import truth
from tests.inference.sessions import OPTIMAL, known, step_left
from tests.machines import NOMINAL, PROTOTYPE, SAMPLES, sure

SIX = DIFFERENCES[DataKind.SIX]


@pytest.fixture(scope="module")
def named() -> Diagnosis:
    session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
    return diagnose(*known(session))


def test_every_explanation_is_held_once(named: Diagnosis) -> None:
    belief = decide(Whitened.of(named.measured, named.model)).belief
    shares = [*belief.probability.values()]
    assert sum(shares) == pytest.approx(1.0)
    assert shares == sorted(shares, reverse=True)
    best = named.explanations[0]
    assert (best.ids, best.pattern) == (("axis_gap",), None) == ((named.causes[0].id,), None)
    assert best.probability == named.causes[0].probability
    assert best.rms_mm == named.causes[0].rms_after_mm
    assert () in belief.listed
    # Every how but of a temperature, which was not recorded.
    hows = {label.partition(" ")[0] for label in belief.unlisted}
    assert hows == {*PLANNED, "hysteresis", "scatters"}


def test_what_is_known_is_simulated() -> None:
    """A long leg in the model moves the offset that the same readings give by its excess."""
    readings, model = known(truth.make_session(21, truth.PROTOTYPE, truth.MICRON))
    leg = CAUSES["leg_length"]
    longer = model.extended([leg.at(np.array([0.2, 0.0, 0.0]))])
    both = longer.extended([CAUSES["axis_gap"].at(np.zeros(3))])
    assert [effect.cause.id for effect in both.accepted] == ["leg_length", "axis_gap"]
    plain, told = diagnose(readings, model), diagnose(readings, longer)
    assert told.model is longer
    assert told.offsets_mm - plain.offsets_mm == pytest.approx([0.2, 0.0, 0.0], abs=3e-3)
    unsure = model.extended([Effect(leg, np.zeros(3), covariance=np.diag([0.02, 0.0, 0.0]) ** 2)])
    assert diagnose(readings, unsure).std_mm == pytest.approx(
        np.hypot(told.std_mm, [0.02, 0.0, 0.0]), rel=0.03
    )


def test_differences_are_shown_in_the_order_of_the_file() -> None:
    data = experiment(2)
    backwards = replace(data, which=data.which[::-1], value=data.value[::-1])
    straight, reverse = (diagnose(each, NOMINAL) for each in (data, backwards))
    assert reverse.measured.value.tolist() == data.value.tolist()[::-1]
    alone = [found.alone.predicted_mm for found in (reverse, straight)]
    np.testing.assert_allclose(alone[0][::-1], alone[1], atol=1e-9)
    np.testing.assert_allclose(reverse.explained_mm[::-1], straight.explained_mm, atol=1e-6)
    assert np.ptp(alone[1]) > 0.5


@pytest.mark.parametrize(
    "hidden", [("axis_gap",), ("sign_flip",), ("swapped_gauges",), ("gauge_slip", "axis_gap")]
)
def test_readings_are_explained_by_the_whole_model(hidden: tuple[str, ...]) -> None:
    """What all effects together simulate, but for the gauges' zeros; tenths of a micrometre."""
    session = truth.make_session(3, truth.PROTOTYPE, truth.MICRON, hidden, exact=True)
    readings, model = known(session)
    found = diagnose(readings, sure(model))
    assert {cause.id for cause in found.causes} == set(hidden)
    simulated = simulate(model.extended(found.effects), found.offsets_mm, readings.plan)
    left = without_zeros(readings.plan, found.explained_mm - simulated)
    assert np.abs(left).max() < 2e-4
    assert np.abs(without_zeros(readings.plan, found.alone.predicted_mm - simulated)).max() > 0.02


def test_differences_are_explained_under_the_label_that_was_written_down() -> None:
    """The paper's first experiment, for which exchanged gauges are likeliest."""
    measured = read_input(str(SAMPLES / "experiment1.csv")).measured
    found = diagnose(measured, NOMINAL)
    assert "swapped_gauges" in {cause.id for cause in found.causes}
    fit = decide(Whitened.of(measured, NOMINAL)).fit
    plan = ideal_plan(DataKind.TWELVE, PROTOTYPE)
    simulated = simulate(NOMINAL.extended(fit.effects), fit.offsets, plan)
    expected = reduction(DataKind.SIX, SIX, PROTOTYPE, plan) @ simulated
    assert found.explained_mm == pytest.approx(expected, abs=2e-4)


def optima() -> Iterator[tuple[str, Diagnosis]]:
    """Of readings, of differences, and of readings that nothing explains."""
    yield "differences", diagnose(read_input(str(SAMPLES / "experiment3.csv")).measured, NOMINAL)
    hidden = ("axis_gap", "backlash", "misread", "gauge_slip", "swapped_gauges", "gauge_drift")
    for cause in hidden:
        session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON, (cause,))
        yield cause, diagnose(*known(session))
    readings, model = known(truth.make_session(1, truth.PROTOTYPE, truth.MICRON))
    yield "healthy", diagnose(readings, model)
    wild = np.random.default_rng(5).normal(0.0, 0.05, len(readings))
    yield "unexplained", diagnose(replace(readings, value=readings.value + wild), model)


def test_open_explanations_are_optima_and_the_offsets_their_mean() -> None:
    """Neither other offsets nor, where there are some, other parameters are an optimum."""
    for name, found in optima():
        white = Whitened.of(found.measured, found.model)
        apart = found.offsets_mm - sum(share * fit.offsets for share, fit in found.left_open)
        assert np.all(np.abs(apart) < OPTIMAL * found.std_mm)
        assert all(step_left(fit, white) < OPTIMAL for _, fit in found.left_open), name
        (share, fit), *others = found.left_open
        assert (found.verdict is Verdict.UNEXPLAINED) == (name == "unexplained")
        assert name != "unexplained" or (share, fit.effects, others) == (1.0, (), [])
        moved = [replace(fit, start=fit.start + np.sqrt(np.diag(fit.covariance)[:3]))]
        for effect in fit.effects:
            wide = 1.0 if effect.covariance is None else np.sqrt(np.diag(effect.covariance))
            other = replace(effect, theta=effect.theta + 2.0 * wide)
            if len(effect.theta):
                effects = tuple(other if each is effect else each for each in fit.effects)
                moved.append(replace(fit, effects=effects))
        assert all(step_left(each, white) > OPTIMAL for each in moved), name


def test_causes_that_act_together_are_one_rival(named: Diagnosis) -> None:
    """Each that is open alone as well is told alone; a part of the answer is no rival."""
    (_, answer), *_ = named.left_open
    acting = {
        id: replace(answer.effects[0], cause=CAUSES[id])
        for id in ("axis_gap", "misread", "bar_skew", "sign_flip")
    }

    def open_(*ids: str) -> tuple[float, Fit]:
        return 0.1, replace(answer, effects=tuple(acting[id] for id in ids))

    order = ("misread", "bar_skew", "sign_flip")
    sets = (
        open_("axis_gap", "bar_skew"),
        open_("misread", "bar_skew"),
        open_("axis_gap"),
        open_("misread"),
        open_("misread", "sign_flip"),
        open_(),
    )
    left = (open_("axis_gap"), *sets)
    found = replace(named, left_open=left, ambiguous_with=order)
    assert found.rivals == (("misread",), ("misread", "sign_flip"), ("bar_skew",))
