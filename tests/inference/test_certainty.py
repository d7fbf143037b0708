"""How sure a verdict is: one remedy, two causes, an unfinished session, sizes with tails.

And a name survives what it did not see, and what it calls wrong may be left out.
"""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.inference.data import Whitened
from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.inference.fit import HeldOut, leave_out, left_out
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import Model, Place
from tests import truth
from tests.decisions import diagnose_anew
from tests.inference.sessions import given, ids, known
from tests.inference.test_printers import quartic
from tests.readings import some
from tests.sentences import sentences
from tests.truth.delta import KOSSEL, V400, Layout, Truth, make_delta_session, probe_bed
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


def test_a_miscounted_turn_is_named_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    """A reading one turn off, where a misreading of that size is only three tolerances.

    Also with places tried a few at a time, as those of many readings are.
    """
    for row, at_once in ((17, 1 << 18), (23, 1 << 10)):
        monkeypatch.setattr("orthoglide_cal.inference.hypothesis.AT_ONCE", at_once)
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

    Unless it left one reading before it or, the stand being gone, one after it; that is seen in
    `tests/bench/test_bench.py`.
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
    first, second = setup[:2].tolist()
    assert again["gauge_slip"](plan, Place((second, 1))) == (first,)
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
    (effect,) = found.extend("axis_gap", ON).accepted
    assert effect.cause.id == "axis_gap"
    with pytest.raises(UnusableResultError):
        found.extend("gauge_slip", ON)


def test_an_unfinished_session_is_diagnosed() -> None:
    """A set-up that leaves with its cell takes its zero along; it is not scored."""
    session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
    readings, model = known(session)
    plan = readings.plan
    started = (plan.setup != 5) | (plan.displacement == 0.0) & (plan.order < 50)
    white = Whitened.of(some(readings, started), model)
    assert 0 < np.sum(white.plan.setup == 5) < 10
    assert ids(diagnose(some(readings, started), model)) == ["axis_gap"]
    fit = Diagnosis.about(some(readings, started), model).fit_of(("axis_gap",))
    # Predicted from less, and said to be: the errors are as large as stated.
    assert 0.7 < leave_out(fit, left_out(white))[2].ratio < 1.3


def test_a_second_cause_that_may_be_chance_is_said_to_be_open() -> None:
    hidden = ("stand_shift", "encoder_scale")
    session = truth.make_session(1_100_000, truth.PROTOTYPE, truth.DIAL, hidden, exact=True)
    found = diagnose(*known(session))
    assert set(ids(found)) == {"stand_shift", "encoder_scale"}
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
    assert lack.left_mm > 1.5 * lack.expected_mm
    hidden = with_legs((0.3, 0.0, 0.0), 1.0, seed)
    assert hidden.verdict is Verdict.CONSISTENT
    assert np.all(hidden.std_mm > 0.9)


def test_the_parameters_alone_are_the_same_whatever_may_be_named() -> None:
    """Legs of which 0.2 mm are plausible, and would show: they are uncertain all the same."""
    found = with_legs((0.0, 0.0, 0.0), 0.2, 1)
    alone, solved = found.alone, solve(found.measured, found.model)
    assert not found.at.complete
    assert alone.offsets_mm == pytest.approx(solved.offsets_mm, rel=1e-12)
    assert alone.budget.expanded_mm == pytest.approx(solved.budget.expanded_mm, rel=1e-12)


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


def touched(truth: Truth, layout: Layout, seed: int) -> tuple[Readings, Model]:
    read = given(probe_bed(V400, truth, (), layout, np.random.default_rng(seed)))
    return read.measured, read.model


def test_thirteen_heights_of_anything_have_no_name() -> None:
    """And a shape has at most a third as many terms as there are places."""
    readings, model = touched(Truth(), Layout(13), 0)
    junk = np.random.default_rng(0).uniform(-5.0, 2.2, 13)
    found = diagnose(replace(readings, value=junk), model)
    assert found.verdict is not Verdict.NAMED
    assert all(len(cause.parameters) <= 4 for cause in found.causes if cause.id == "bed_shape")


def test_readings_left_out_refute_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    readings, model = known(truth.make_session(4, truth.PROTOTYPE, truth.MICRON, ("axis_gap",)))
    assert diagnose(readings, model).refuted is None
    held = HeldOut(rms_mm=0.75, ratio=44.0, chance=1e-6)
    place = "orthoglide_cal.inference.diagnose.leave_out"
    monkeypatch.setattr(place, lambda *_: (None, None, held))
    found = diagnose_anew(readings, model)
    assert (found.verdict, found.causes) == (Verdict.UNEXPLAINED, ())
    assert found.refuted.code == "refuted_left_out"


def test_later_readings_refute_a_name_and_never_make_one() -> None:
    """The bed is another one, or the same: then the answer is that of the first readings alone."""
    bent = Truth(bed=quartic(np.random.default_rng(2), 0.08))
    readings, model = touched(bent, Layout(61), 1)
    alone = diagnose(readings, model)
    assert (alone.verdict, ids(alone)) == (Verdict.NAMED, ["bed_shape"])

    def held(later: Truth, **changes: object) -> Diagnosis:
        return diagnose(readings, model, holdout=touched(later, Layout(61), 2)[0], **changes)  # type: ignore[arg-type]

    for same in (held(bent), held(Truth(), applied=np.full(6, 1e-3))):
        assert (same.verdict, same.explanations) == (alone.verdict, alone.explanations)
    other = held(Truth())
    assert (other.verdict, other.causes) == (Verdict.UNEXPLAINED, ())
    assert other.refuted.code == "refuted_later"
    # What is consistent alone stays so, however well a shape would predict.
    faint = Truth(bed=quartic(np.random.default_rng(1), 0.012))
    few, few_model = touched(faint, Layout(29), 1)
    verdicts = {
        diagnose(few, few_model, holdout=holdout).verdict
        for holdout in (None, touched(faint, Layout(29), 2)[0])
    }
    assert verdicts == {Verdict.CONSISTENT}


# --- several wrong readings -------------------------------------------------------------------

PRINTER = ("", "tower_lean", "bed_shape", "backlash", "probe_tilt", "encoder_scale")
GAUGES = ("", *truth.MACHINE_CAUSES, "bar_skew")


def misread(seed: int) -> tuple[str, Readings, Model, set[int]]:
    """A hidden cause, readings of which up to a tenth are wrong by 0.1 to 2 mm, and which."""
    rng = np.random.default_rng([seed, 77])
    cause = str(rng.choice(PRINTER if seed % 2 else GAUGES))
    hidden = (cause,) if cause else ()
    if seed % 2:
        layout = Layout(int(rng.choice([41, 61])))
        read = given(make_delta_session(seed, (V400, KOSSEL)[seed // 2 % 2], hidden, layout))
        readings, model = read.measured, read.model
    else:
        gauges = list(truth.GAUGES.values())
        gauge = gauges[seed // 2 % len(gauges)]
        readings, model = known(truth.make_session(seed, truth.PROTOTYPE, gauge, hidden))
    wrong = rng.choice(len(readings), int(rng.integers(1, len(readings) // 10 + 1)), replace=False)
    size = np.exp(rng.uniform(np.log(0.1), np.log(2.0), wrong.size))
    size *= rng.choice([-1.0, 1.0], wrong.size)
    value = readings.value.copy()
    value[wrong] += size
    return cause, replace(readings, value=value), model, set(wrong.tolist())


@pytest.mark.parametrize("seeds", [range(1, 2), pytest.param(range(300), marks=pytest.mark.slow)])
def test_leaving_out_what_is_wrong_reverses_no_right_answer(seeds: range) -> None:
    """No wrong name, and of the named nine in ten with exactly the readings that are wrong."""
    named = exact = 0
    for seed in seeds:
        cause, readings, model, wrong = misread(seed)
        found = diagnose(readings, model)
        if found.verdict is not Verdict.NAMED:
            continue
        told = set(found.wrong_readings)
        # One that is wrong by a whole turn is a slip.
        slips = {effect.place[0] for effect in found.effects if effect.cause.id == "gauge_slip"}
        faults = {"misread", "gauge_slip"} if slips and slips <= wrong else {"misread"}
        told |= slips & wrong
        rest = set(ids(found)) - faults
        assert rest <= {cause}, seed
        named += 1
        if told != wrong:
            continue
        exact += 1
        kept = ~np.isin(np.arange(len(readings)), [*told])
        then = diagnose(some(readings, kept), model)
        if rest:
            assert rest <= {*ids(then), *then.ambiguous_with}, seed
        else:
            assert then.verdict in (Verdict.CONSISTENT, Verdict.AMBIGUOUS), seed
    assert named >= 0.6 * len(seeds)
    assert exact >= 0.9 * named


def test_a_gauge_out_of_all_proportion_is_refused_with_its_reason() -> None:
    """Sizes of metres beside a noise of a nanometre leave no digit of any evidence."""
    readings, model = known(truth.make_session(4, truth.PROTOTYPE, truth.MICRON, ("axis_gap",)))
    machine = model.machine
    gauge = machine.instrument.changed(repeatability_mm=1e-6, resolution_mm=1e-6)
    sizes = {id: 990.0 * CAUSES[id].stated(machine) for id in machine.tolerances}
    wild = replace(model, machine=machine.changed(gauge=gauge, tolerances=sizes))
    with pytest.raises(UnusableResultError, match="cannot be weighed"):
        diagnose(readings, wild)
