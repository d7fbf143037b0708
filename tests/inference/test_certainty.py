"""How sure a verdict is: one remedy, two causes, an unfinished session, sizes with tails."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.inference import Diagnosis, Verdict, diagnose, extend
from orthoglide_cal.inference.belief import Belief
from orthoglide_cal.inference.data import Whitened
from orthoglide_cal.inference.fit import leave_out_cells
from orthoglide_cal.model.cause import Place
from tests import truth
from tests.inference.sessions import ids, known
from tests.readings import some
from tests.sentences import sentences
from tests.truth.effects import Effect
from tests.truth.forward import MACHINE_CAUSES

ON = date(2024, 5, 6)


def measured(
    *effects: Effect, seed: int, gauge: truth.Gauge = truth.MICRON, cycles: int = 3
) -> truth.Session:
    rng = np.random.default_rng([seed, 7])
    plan = truth.standard_plan(truth.PROTOTYPE, rng, cycles=cycles)
    offsets = rng.normal(0.0, 0.5, 3)
    return truth.measure(truth.PROTOTYPE, gauge, plan, offsets, effects, rng)


def test_a_miscounted_turn_is_named_although_the_reading_may_just_be_wrong() -> None:
    """A reading one turn off, where a misreading of that size is only three tolerances."""
    for row in (17, 23):
        session = measured(Effect("gauge_slip", "", (1.0,), row=row), seed=row, gauge=truth.DIAL)
        readings, model = known(session)
        tolerances = {**model.machine.tolerances, "misread": 0.3}
        wide = replace(model, machine=model.machine.changed(tolerances=tolerances))
        found = diagnose(readings, wide)
        assert (found.verdict, ids(found)) == ("named", ["gauge_slip"])
        assert found.causes[0].aliases in ((), ("misread",))
        assert f"reading {row + 1})" in found.causes[0].where


def test_readings_to_take_again() -> None:
    """A wrong reading is taken again; a stand that moved is not corrected by that.

    Unless it left one reading before it or, the stand being gone, one after it: nothing that is
    read later can tell such a knock from one wrong reading.
    """
    plan = known(measured(seed=1))[0].plan
    setup = np.flatnonzero(plan.setup == plan.setup[13])
    later = tuple(i for i in setup.tolist() if plan.order[i] >= plan.order[13])
    again = {id: cause.to_read_again for id, cause in CAUSES.items()}
    assert again["misread"](plan, Place((13,))) == (13,)
    assert again["gauge_slip"](plan, Place((13, 0))) == (13,)
    assert again["gauge_slip"](plan, Place((13, 1))) == later
    assert len(later) > 3
    assert again["stand_shift"](plan, Place((13,))) == ()
    rows = setup.tolist()
    assert plan.leg[rows[0]] == 0
    assert again["stand_shift"](plan, Place((rows[1],))) == (rows[0],)
    assert again["gauge_slip"](plan, Place((rows[1], 1))) == (rows[0],)
    assert again["stand_shift"](plan, Place((rows[2],))) == ()
    assert again["stand_shift"](plan, Place((rows[-2],))) == ()
    assert again["stand_shift"](plan, Place((rows[-1],))) == (rows[-1],)
    # On the leg that was read last the next reading will show it; not what was at its start.
    rows = np.flatnonzero(plan.setup == plan.setup[plan.in_time[-1]]).tolist()
    assert again["stand_shift"](plan, Place((rows[-1],))) == ()
    assert again["stand_shift"](plan, Place((rows[1],))) == (rows[0],)
    assert again["bar_skew"](plan, Place()) == ()


def test_two_real_causes_are_still_named_together() -> None:
    """Nine parameters of a skew and a lean that are there, for the check that refuses a screw."""
    session = truth.make_session(5, truth.PROTOTYPE, truth.MICRON, ("bar_skew", "axis_squareness"))
    assert set(ids(diagnose(*known(session)))) == {"bar_skew", "axis_squareness"}


def test_a_doubt_about_the_record_is_no_doubt_about_the_machine() -> None:
    """A gap is in every explanation; a turn miscounted or a line misread is one answer."""
    session = truth.make_session(3, truth.PROTOTYPE, truth.DIAL, ("gauge_slip", "axis_gap"))
    readings, model = known(session)
    found = diagnose(readings, model)
    record = set(ids(found)) - {"axis_gap"}
    assert len(found.causes) == 2
    aliases = {other for cause in found.causes for other in cause.aliases}
    assert record | aliases == {"gauge_slip", "misread"}
    assert found.verdict == "named"
    assert {cause.id for cause in found.causes if cause.recommended} == {"axis_gap"}
    (effect,) = extend(readings, model, "axis_gap", ON).accepted
    assert effect.cause.id == "axis_gap"
    with pytest.raises(UnusableResultError):
        extend(readings, model, "gauge_slip", ON)


def test_an_unfinished_session_is_diagnosed() -> None:
    """A set-up that leaves with its cell takes its zero along; it is not scored."""
    session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
    readings, model = known(session)
    plan = readings.plan
    started = (plan.setup != 5) | (plan.displacement == 0.0) & (plan.order < 50)
    white = Whitened.of(some(readings, started), model)
    assert 0 < np.sum(white.plan.setup == 5) < 10
    assert ids(diagnose(some(readings, started), model)) == ["axis_gap"]
    fit = Belief.about(white).fit(("axis_gap",))
    # Predicted from less, and said to be: the errors are as large as stated.
    assert 0.7 < leave_out_cells(white, fit, fit).ratio < 1.3


def test_a_second_cause_that_may_be_chance_is_said_to_be_open() -> None:
    hidden = ("stand_shift", "encoder_scale")
    session = truth.make_session(1_100_000, truth.PROTOTYPE, truth.DIAL, hidden, exact=True)
    found = diagnose(*known(session))
    assert set(ids(found)) == {"stand_shift", "encoder_scale"}
    alone, both = (("stand_shift",), ("encoder_scale", "stand_shift"))
    shares = {each.ids: each.probability for each in found.explanations}
    assert 0.01 < shares[alone] < 0.5 * shares[both]
    (note,) = [note for note in sentences(found.notes) if "alone" in note]
    assert note.startswith("stand_shift alone is also possible")
    assert "encoder_scale may be absent" in note
    clear = truth.make_session(3, truth.PROTOTYPE, truth.MICRON, ("gauge_slip", "axis_gap"))
    assert not [note for note in sentences(diagnose(*known(clear)).notes) if "alone" in note]


def with_legs(legs: tuple[float, float, float], stated: float, seed: int) -> Diagnosis:
    """Legs that are off, with a stated size of them."""
    readings, model = known(measured(Effect("leg_length", "", legs), seed=seed))
    sizes = {**model.machine.tolerances, "leg_length": stated}
    return diagnose(readings, replace(model, machine=model.machine.changed(tolerances=sizes)))


@pytest.mark.parametrize("seed", [1])
def test_a_stated_size_hides_nothing(seed: int) -> None:
    """Legs 1.4 mm off: visible although 1 mm is stated; 0.3 mm are not, and count in U."""
    found = with_legs((1.4, -0.3, 0.5), 1.0, seed)
    assert (found.verdict, ids(found)) == (Verdict.NAMED, ["leg_length"])
    assert found.causes[0].times_stated is None
    lack = found.lack_of_fit
    assert lack.p_value < 1e-6
    assert lack.left_mm > 1.5 * lack.expected_mm
    hidden = with_legs((0.3, 0.0, 0.0), 1.0, seed)
    assert hidden.verdict is Verdict.CONSISTENT
    assert np.all(hidden.std_mm > 0.9)


def test_what_only_a_size_beyond_all_scales_explains_is_unexplained() -> None:
    """Legs 1.4 mm off, in a file that calls a micrometre plausible and nothing else."""
    session = measured(
        Effect("leg_length", "", (1.4, -0.3, 0.5)), seed=1, gauge=truth.DIAL, cycles=8
    )
    readings, model = known(session)
    sizes = dict.fromkeys(model.machine.tolerances, 0.0) | {"leg_length": 0.001}
    found = diagnose(readings, replace(model, machine=model.machine.changed(tolerances=sizes)))
    assert found.verdict is Verdict.UNEXPLAINED
    assert found.beyond_tolerance == ()


@pytest.mark.parametrize("cause", [c for c in MACHINE_CAUSES if c != "leg_length"])
def test_ten_and_thirty_times_the_stated_size_are_named(cause: str) -> None:
    for times, gauge in ((10.0, truth.MICRON), (30.0, truth.DIAL)):
        session = truth.make_session(31, truth.PROTOTYPE, gauge, (cause,), times=(times, times))
        found = diagnose(*known(session))
        assert (found.verdict, ids(found)) == (Verdict.NAMED, [cause])
        stated = found.causes[0].times_stated
        assert 0.4 * times < stated < 1.1 * times
