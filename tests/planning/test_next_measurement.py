"""Which causes these data cannot distinguish, and the measurement that can."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.inference.evidence import Gaussian, NoiseGrid
from orthoglide_cal.inference.prediction import expect
from orthoglide_cal.inference.result import NextMeasurement, Verdict
from orthoglide_cal.model.measured import DataKind, Readings
from orthoglide_cal.model.model import synthetic_session
from orthoglide_cal.model.orthoglide import double_posture
from orthoglide_cal.model.plan import Floats, Plan
from orthoglide_cal.model.readings import GaugePlan, Posture
from orthoglide_cal.planning.next_measurement import (
    best_next,
    options,
    predictions,
    rank_measurements,
)
from orthoglide_cal.report.sentences import sentence
from orthoglide_cal.results.making import answer_to
from tests import truth
from tests.bench.ambiguous import continued
from tests.inference.sessions import given, known, model_of, readings_of, reduced
from tests.readings import some
from tests.truth.delta import DeltaSession, Layout, make_delta_session
from tests.truth.effects import state_with
from tests.truth.forward import signals

MODEL = model_of(truth.PROTOTYPE, truth.MICRON)
MACHINE = MODEL.machine
OFFSETS = np.array([0.4, -0.7, 0.3])
SIZES = {
    "axis_gap": (0.3, -0.4, 0.5),
    "bar_skew": (1.1, -0.6, 0.4, 0.9, -1.3, 0.5),
    "axis_squareness": (1.3, -0.8, 1.7),
}
# Only the two limits: what slopes and gaps add is then the same difference.
ENDS = (Posture.MAX, Posture.MIN)
LIMITS = double_posture(MACHINE, postures=ENDS, closing=False)


def chosen(found: Diagnosis, *words: str) -> NextMeasurement:
    """The best option whose instruction holds these words."""
    return next(
        each for each in rank_measurements(found) if all(w in sentence(each.what) for w in words)
    )


def measured(plan: GaugePlan, cause: str, seed: int = 3) -> Readings:
    rng = np.random.default_rng(seed)
    acting = CAUSES[cause].at(np.array(SIZES[cause]) * CAUSES[cause].scale)
    return synthetic_session(MODEL.extended([acting]), plan, OFFSETS, rng)


def mentioned(found: Diagnosis) -> set[str]:
    told = *found.causes, *found.unshown
    return {*(each.id for each in told), *found.ambiguous_with}


ALIASES = [("bar_skew", "axis_gap"), ("axis_squareness", "axis_gap")]


@pytest.mark.parametrize(("cause", "rival"), ALIASES)
def test_aliases_are_those_of_the_data_set(cause: str, rival: str) -> None:
    """The same machine: open from two postures, closed by a third or by a second gauge place."""
    found = diagnose(measured(LIMITS, cause), MODEL)
    assert found.verdict == "ambiguous"
    assert mentioned(found) >= {cause, rival}
    # Each says who could stand in its place. Beside a skew an exchange is open as well, but stands
    # in nobody's place.
    first = found.causes[0]
    assert {rival} <= set(first.aliases) | {first.id}
    assert set(found.ambiguous_with) - set(first.aliases) <= {"sign_flip", "swapped_gauges"}
    assert first.id not in first.aliases
    far = chosen(found, "mm from the carriage joint", "one cycle").plan
    for plan in (double_posture(MACHINE, cycles=2), Plan.joined(LIMITS, far)):
        found = diagnose(measured(plan, cause), MODEL)
        assert set(found.ambiguous_with) <= {"swapped_gauges"}
        assert [c.id for c in found.causes] == [cause]
        assert found.causes[0].aliases == ()
        following = best_next(found)
        if following is not None:
            # What is still open adds to the cause; it is named together with it.
            assert following.between == ((cause,), (cause, *found.ambiguous_with))
            assert following.separation_sigma > 5.0


def assessed(readings: Readings) -> Diagnosis:
    return Diagnosis.about(readings, MODEL)


def log_odds(found: Diagnosis, first: str, second: str) -> float:
    """With the gauge's stated noise: a rival that fits badly cannot call the gauge worse."""
    stated = NoiseGrid(np.array([MACHINE.gauge.noise_mm]), np.zeros(1))
    logs = []
    for cause in (first, second):
        fit = found.fit_of((cause,))
        density = Gaussian(fit.columns, fit.sizes[None], stated)
        logs.append(float(density.by_noise(fit.linear)[0, 0]))
    return logs[0] - logs[1]


@pytest.mark.parametrize(("cause", "rival"), ALIASES)
def test_the_next_measurement_separates_as_far_as_it_says(cause: str, rival: str) -> None:
    """Taken on a machine as either explanation has it, and judged with the first data.

    For two explanations s standard deviations apart the new readings change the log odds by
    s²/2 on average, each in favour of the machine they were taken on.
    """
    readings = measured(LIMITS, cause)
    before = assessed(readings)
    found = diagnose(readings, MODEL)
    # With new zeros, as the later readings below have them.
    new_stands = [each for each in rank_measurements(found) if not each.continues]
    following = max(new_stands, key=lambda each: each.separation_sigma)
    assert following.between
    assert set(following.between) == {(cause,), (rival,)}
    plan = Plan.joined(LIMITS, following.plan)
    gained = []
    for true, other in ((cause, rival), (rival, cause)):
        fit = before.fit_of((true,))
        rng = np.random.default_rng(8)
        later = synthetic_session(MODEL.extended(fit.effects), plan, fit.offsets, rng)
        value = np.concatenate((readings.value, later.value[len(readings) :]))
        both = replace(later, value=value)
        known = diagnose(both, MODEL)
        assert [one.id for one in known.causes] == [true]
        assert other not in known.ambiguous_with
        gained.append(log_odds(assessed(both), true, other) - log_odds(before, true, other))
    stated = 0.5 * following.separation_sigma**2
    assert stated > 50.0
    assert 0.8 * stated < np.mean(gained) < 1.5 * stated


UNTELLABLE = [
    # Exchanging two gauges that read nearly the same changes nothing else either.
    (7_500_003, truth.MICRON, ("thermal_drift",), 2.5, "swapped_gauges"),
    # A stand that is gone crept, or was knocked.
    pytest.param(
        7_500_002, truth.DIAL, ("gauge_drift",), 2.5, "stand_shift", marks=pytest.mark.slow
    ),
]  # fmt: skip


@pytest.mark.parametrize(("seed", "gauge", "causes", "pace", "rival"), UNTELLABLE)
def test_what_no_reading_tells_is_not_looked_for(
    seed: int, gauge: truth.Gauge, causes: tuple[str, ...], pace: float, rival: str
) -> None:
    """The truth measures the longest session that could be recommended: it tells as little."""
    session = truth.make_session(seed, truth.LARGE, gauge, causes, pace=pace)
    found = diagnose(*known(session))
    assert found.verdict == "ambiguous"
    assert found.ambiguous_with == (rival,)
    assert best_next(found) is None
    ranking = rank_measurements(found)
    assert all(each.chance == 0.0 for each in ranking)
    longest = max(ranking, key=lambda each: each.minutes)
    after = [diagnose(*known(continued(session, longest, n))) for n in range(3)]
    assert sum(rival in mentioned(each) for each in after) >= 2


SESSIONS = [
    (3, truth.MICRON, ("backlash",)),
    pytest.param(8, truth.DIAL, ("axis_gap",), marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("seed", "gauge", "causes"), SESSIONS)
def test_what_u_will_be_is_what_solve_prints(
    seed: int, gauge: truth.Gauge, causes: tuple[str, ...]
) -> None:
    """Of all readings together, on average over sittings that the truth measures.

    A cause that bars the offsets, and one that is only a part of their U.
    """
    session = truth.make_session(seed, truth.PROTOTYPE, gauge, causes)
    ranking = rank_measurements(diagnose(*known(session)))
    for following in ranking[:: len(ranking) // 2]:
        became = [printed_u(continued(session, following, n)) for n in range(4)]
        largest = np.mean(became, axis=0).max()
        assert following.expanded.max() == pytest.approx(largest, rel=0.05)


def test_what_is_taken_from_the_firmware_stays_as_unsure_as_it_is() -> None:
    """Arms of a printer: most of U of its endstops and radius, whatever is touched next."""
    session = make_delta_session(5, layout=Layout(81))
    read, now = given(session), printed_u(session)
    for following in rank_measurements(diagnose(read.measured, read.model)):
        ratio = following.expanded / now
        assert np.all((ratio > 0.9) & (ratio < 1.05))


def printed_u(session: truth.Session | DeltaSession) -> Floats:
    """U of the parameters that `solve` gives out [mm, deg]."""
    return np.array([each.expanded for each in answer_to(given(session)).parameters])


def test_readings_are_expected_as_the_truth_has_them() -> None:
    """After a lost motion the carriages come from where they stood: so far the readings differ.

    How far the expectations of two explanations are apart does not depend on the combinations in
    which they are looked at; the truth reads both machines. New stands begin from the last place.
    """
    session = truth.make_session(3, truth.PROTOTYPE, truth.MICRON, ("backlash",), exact=True)
    readings, model = known(session)
    found = Diagnosis.about(readings, model)
    fits = [found.fit_of(("backlash",)), found.fit_of(())]
    theta = fits[0].effects[0].theta
    motion = replace(session.effects[0], parameters=(*theta[:3], *-theta[3:]))
    lost, none = state_with(fits[0].offsets, [motion]), state_with(fits[1].offsets, ())
    every = [*options(readings.plan, model.machine)]
    predicted = predictions(model, readings.plan, every, [(0.5, fit) for fit in fits])
    for option, seen in zip(every, predicted, strict=True):
        plan = continued(session, option, 1).plan
        read = signals(plan, session.machine, np.stack((lost, none)))
        gap, n = read[0] - read[1], len(readings)
        before = readings.plan if option.continues else option.plan
        same = (option.plan.setup[:, None] == before.setup).astype(float)
        mean = same / same.sum(axis=1, keepdims=True)
        apart = gap[n:] - mean @ (gap[:n] if option.continues else gap[n:])
        if option.continues:
            root = np.linalg.cholesky(np.eye(len(mean)) + mean @ mean.T)
            apart = np.linalg.solve(root, apart)
        # What nobody would see is left out of the expectations.
        expected = np.linalg.norm((seen.means[0] - seen.means[1])[:-3, 0])
        assert expected == pytest.approx(np.linalg.norm(apart), rel=1e-3)


def test_what_no_cause_makes_is_a_rival_like_any_other() -> None:
    """What returns with its posture is read again there; a lag has any size at a new stand."""
    session = truth.make_session(
        7_700_001, truth.PROTOTYPE, truth.DIAL, ("gauge_drift", "backlash")
    )
    readings, model = known(session)
    found, plan, n = diagnose(readings, model), readings.plan, len(readings)
    assert (found.ambiguous_with, found.is_nameable) == ((), False)
    later = replace(plan, setup=plan.setup + plan.setups, part=plan.part + 1, order=plan.order + n)
    both, white, lasting = Plan.joined(plan, later), found.white, []
    for _, fit in found.by_place[1:]:
        mean, _, root = expect(fit, model, both, plan)
        assert white.matrix @ (readings.value - mean[:n]) == pytest.approx(fit.left, abs=3e-4)
        before, after = (white.matrix @ root[part] for part in (slice(n), slice(n, 2 * n)))
        lasting.append(np.linalg.norm(after) < 1.01 * np.linalg.norm(before))
    assert lasting == [True, False, False]
    following = best_next(found)
    assert following.separates == ("backlash", "repeats direction x")
    after = diagnose(*known(continued(session, following, 1)))
    assert (after.verdict, after.accepted) == ("named", ("backlash",))


# --- beside data that no readings can be joined to: a session of its own ----------------------


def measured_alone(session: truth.Session, option: NextMeasurement, seed: int) -> Readings:
    """The recommended session on the same machine, a day later, without the first one."""
    first, plan = readings_of(session).plan, option.plan
    later = replace(
        plan,
        setup=plan.setup + first.setups,
        part=plan.part + 1,
        order=plan.order + len(first),
        hours=plan.hours + float(first.hours.max()) + 24.0,
    )
    both = readings_of(continued(session, option.changed(plan=later), seed))
    return some(both, np.arange(len(first), len(both)))


@pytest.mark.parametrize("cause", ["axis_gap", "bar_skew"])
@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3, 4))]
)
def test_a_gap_and_a_skewed_bar_are_told_apart_afterwards(cause: str, seed: int) -> None:
    """By the measurement that is recommended: all of 24 are named rightly."""
    (rival,) = {"axis_gap", "bar_skew"} - {cause}
    session = truth.make_session(seed, truth.PROTOTYPE, truth.MICRON, (cause,))
    readings, model = known(session)
    found = diagnose(reduced(DataKind.SIX, readings, model), model)
    assert found.verdict is Verdict.AMBIGUOUS
    following = best_next(found)
    assert following.session is not None
    assert following.between
    assert following.minutes < 25.0
    for again in range(3):
        after = diagnose(measured_alone(session, following, again), model)
        assert [each.id for each in after.causes] == [cause]
        assert rival not in after.ambiguous_with


def test_u_is_that_of_the_session_alone() -> None:
    """On average over sessions of it, whatever the differences knew before."""
    session = truth.make_session(5, truth.PROTOTYPE, truth.MICRON)
    readings, model = known(session)
    for following in rank_measurements(diagnose(reduced(DataKind.SIX, readings, model), model)):
        sessions = [measured_alone(session, following, seed) for seed in range(6)]
        reach = [solve(readings, model).budget.expanded_mm.max() for readings in sessions]
        assert following.expanded.max() == pytest.approx(np.mean(reach), rel=0.1)


def test_readings_along_the_leg_are_not_gone_on_with_either() -> None:
    """Only what `measure` takes as a session is ranked, and each names its options."""
    session = truth.make_session(5, truth.PROTOTYPE, truth.DIAL)
    readings, model = known(session)
    assert {each.session for each in rank_measurements(diagnose(readings, model))} == {None}
    found = rank_measurements(diagnose(reduced(DataKind.SIX, readings, model), model))
    told = {each.session for each in found}
    assert told == {"--cycles 1", "--cycles 2", "", "--cycles 5"}
    assert not any(each.continues for each in found)
