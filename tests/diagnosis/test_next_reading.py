"""Which causes these data cannot tell apart, and the measurement that can."""

from dataclasses import fields, replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Diagnosis, diagnose
from orthoglide_cal.diagnosis.assess import Assessment, assess
from orthoglide_cal.diagnosis.evidence import Gaussian, NoiseGrid
from orthoglide_cal.diagnosis.explanations import Whitened
from orthoglide_cal.model import Effect, Plan, Posture, Readings, double_posture
from orthoglide_cal.model.synthetic import synthetic_session
from tests import truth
from tests.diagnosis.sessions import model_of
from tests.readings import some

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


def acting(cause: str) -> Effect:
    kind = CAUSES[cause]
    return kind.at(np.array(SIZES[cause]) * kind.scale)


def joined(first: Plan, second: Plan) -> Plan:
    """One plan of two: the second later, with gauges set up afresh."""
    parts = {
        item.name: np.concatenate((getattr(first, item.name), getattr(second, item.name)))
        for item in fields(Plan)
    }
    parts["setup"][len(first) :] += first.setups
    parts["order"][len(first) :] += first.order.max() + 1
    parts["hours"][len(first) :] += first.hours.max() + 0.1
    return Plan(**parts)


def measured(plan: Plan, cause: str, seed: int = 3) -> Readings:
    rng = np.random.default_rng(seed)
    return synthetic_session(MODEL.extended([acting(cause)]), plan, OFFSETS, rng)


def mentioned(found: Diagnosis) -> set[str]:
    return {*(cause.id for cause in found.causes), *found.ambiguous_with}


ALIASES = [("axis_gap", "bar_skew"), ("bar_skew", "axis_gap"), ("axis_squareness", "axis_gap")]


@pytest.mark.parametrize(("cause", "rival"), ALIASES)
def test_aliases_are_those_of_the_data_set(cause: str, rival: str) -> None:
    """The same machine: open from two postures, closed by a third or by a second gauge place."""
    found = diagnose(measured(LIMITS, cause), MODEL)
    assert found.verdict == "ambiguous"
    assert mentioned(found) >= {cause, rival}
    quarter = double_posture(MACHINE, postures=ENDS, closing=False, gauge_at=0.25)
    for plan in (double_posture(MACHINE, cycles=2), joined(LIMITS, quarter)):
        found = diagnose(measured(plan, cause), MODEL)
        assert set(found.ambiguous_with) <= {"swapped_gauges"}
        assert [c.id for c in found.causes] == [cause]


@pytest.mark.parametrize(("cause", "rival"), ALIASES)
def test_each_says_who_could_stand_in_its_place(cause: str, rival: str) -> None:
    found = diagnose(measured(LIMITS, cause), MODEL)
    first = found.causes[0]
    # Beside a skew an exchange is open as well, but stands in nobody's place.
    assert {rival} <= set(first.aliases) | {first.id}
    assert set(found.ambiguous_with) - set(first.aliases) <= {"sign_flip", "swapped_gauges"}
    assert first.id not in first.aliases
    named = diagnose(measured(double_posture(MACHINE), cause), MODEL)
    assert named.causes[0].aliases == ()
    if named.next_measurement is not None:
        # What is still open adds to the cause; it is named together with it.
        assert named.next_measurement.separates == ((cause,), (cause, *named.ambiguous_with))
        assert "two more postures" in named.next_measurement.what
        assert named.next_measurement.separation_sigma > 5.0


def assessed(readings: Readings) -> Assessment:
    return assess(Whitened.of(readings, MODEL))


def log_odds(found: Assessment, first: str, second: str) -> float:
    """With the gauge's stated noise: a rival that fits badly cannot call the gauge worse."""
    stated = NoiseGrid(np.array([MACHINE.gauge.noise_mm]), np.zeros(1))
    logs = []
    for cause in (first, second):
        fit = found.fit((cause,))
        density = Gaussian(fit.columns * fit.sizes, stated)
        logs.append(float(density.by_noise(fit.linear)[0]))
    return logs[0] - logs[1]


@pytest.mark.parametrize(("cause", "rival"), ALIASES)
def test_the_next_measurement_separates_as_far_as_it_says(cause: str, rival: str) -> None:
    """Taken on a machine as either explanation has it, and judged with the first data.

    For two explanations s standard deviations apart the new readings change the log odds by
    s²/2 on average, each in favour of the machine they were taken on.
    """
    readings = measured(LIMITS, cause)
    before = assessed(readings)
    following = diagnose(readings, MODEL).next_measurement
    assert following is not None
    assert set(following.separates) == {(cause,), (rival,)}
    assert "a quarter of the leg from the carriage" in following.what
    plan = joined(LIMITS, double_posture(MACHINE, gauge_at=0.25))
    gained = []
    for true, other in ((cause, rival), (rival, cause)):
        fit = before.fit((true,))
        rng = np.random.default_rng(8)
        later = synthetic_session(MODEL.extended(fit.effects), plan, fit.offsets, rng)
        value = np.concatenate((readings.value, later.value[len(readings) :]))
        after = assessed(replace(later, value=value))
        assert after.judgement.accepted == (true,)
        assert other not in after.judgement.ambiguous_with
        gained.append(log_odds(after, true, other) - log_odds(before, true, other))
    stated = 0.5 * following.separation_sigma**2
    assert stated > 50.0
    assert 0.8 * stated < np.mean(gained) < 1.5 * stated


def with_a_last_reading(step: float) -> Readings:
    """Healthy but for the very last reading."""
    rng = np.random.default_rng(4)
    readings = synthetic_session(MODEL, double_posture(MACHINE), OFFSETS, rng)
    value = readings.value.copy()
    value[-1] += step
    return replace(readings, value=value)


@pytest.mark.parametrize("shifted", [True, False], ids=["knocked", "misread"])
def test_one_more_reading_tells_a_knock_from_a_wrong_reading(shifted: bool) -> None:
    readings = with_a_last_reading(0.06)
    following = diagnose(readings, MODEL).next_measurement
    assert following is not None
    assert set(following.separates) == {("misread",), ("stand_shift",)}
    assert "leg z" in following.what
    assert following.separation_sigma > 10.0
    plan = readings.plan
    last = len(plan) - 1
    parts = {
        item.name: np.append(getattr(plan, item.name), getattr(plan, item.name)[last])
        for item in fields(Plan)
    }
    parts["order"][-1] += 1
    parts["hours"][-1] += 0.01
    again = readings.value[last] - (0.0 if shifted else 0.06) + 0.002
    more = replace(
        some(readings, np.append(np.arange(len(plan)), last)),
        plan=Plan(**parts),
        value=np.append(readings.value, again),
    )
    found = diagnose(more, MODEL)
    assert found.verdict == "named"
    assert [c.id for c in found.causes] == ["stand_shift" if shifted else "misread"]


def test_nothing_is_asked_for_where_nothing_is_open() -> None:
    rng = np.random.default_rng(6)
    healthy = synthetic_session(MODEL, double_posture(MACHINE), OFFSETS, rng)
    found = diagnose(healthy, MODEL)
    assert found.verdict == "consistent"
    assert found.next_measurement is None
