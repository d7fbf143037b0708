"""Printers: what is named from touches, left open or kept from evidence; what lasts over dates."""

import re
from dataclasses import replace
from datetime import date
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.input import Input, read_input, together
from orthoglide_cal.files.machine_file import machine_text, stored_machine
from orthoglide_cal.inference.data import Candidates, Linearised, Whitened
from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.inference.fit import fit_hypothesis
from orthoglide_cal.inference.hypothesis import Hypothesis
from orthoglide_cal.inference.prediction import Later
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.planning.next_measurement import best_next
from orthoglide_cal.report.sentences import sentence
from orthoglide_cal.results.making import answer_to
from tests.inference.sessions import given, ids
from tests.printer_files import OFF, printer_cfg
from tests.printers import true_values
from tests.sentences import sentences
from tests.truth.delta import (
    V400,
    Delta,
    DeltaSession,
    Layout,
    Surface,
    Truth,
    grain,
    make_delta_session,
    places_of,
    probe_bed,
)
from tests.truth.delta_separation import GRAIN, clear_delta_outside
from tests.truth.plan import frozen

ARMS = ((345.35, 341.55, 337.79), (347.0, 344.0, 345.0), (340.0, 345.0, 345.0))
TRUE_ARM = 345.0
BENT_MM = 0.040
LOST = frozen([0.07, 0.06, 0.02])


def quartic(rng: np.random.Generator, size: float, radius: float = 150.0) -> Surface:
    """A quartic surface of this r.m.s. about its mean plane."""
    powers = [(j, k - j) for k in (2, 3, 4) for j in range(k + 1)]
    sizes = rng.normal(size=len(powers))
    at = places_of(Layout(400, reach=1.0), radius)
    height = Surface(radius, dict(zip(powers, sizes.tolist(), strict=True))).height(*at.T)
    plane = np.column_stack((np.ones(len(at)), at))
    left = height - plane @ np.linalg.lstsq(plane, height)[0]
    sizes *= size / np.sqrt(np.mean(left**2))
    return Surface(radius, dict(zip(powers, sizes.tolist(), strict=True)))


def stored_arms(
    arms: tuple[float, float, float], bent: bool, seed: int, places: int = 149
) -> DeltaSession:
    """Touches, 10 µm noise, of a sound machine whose firmware has these arms.

    It is homed so that the height in the middle of the bed is right.
    """
    rng = np.random.default_rng([seed, int(1e3 * arms[0]), bent])
    machine = replace(V400, arms=arms, noise=0.010)
    stored, true = (np.sqrt(np.square(a) - V400.radius**2) for a in (arms, TRUE_ARM))
    truth = Truth(
        arms=frozen(TRUE_ARM - np.array(arms)), endstops=frozen(stored - true),
        bed=quartic(rng, BENT_MM) if bent else None,
    )  # fmt: skip
    return probe_bed(machine, truth, (), Layout(places), rng)


@pytest.mark.slow
def test_stored_arms_that_differ_are_in_the_answer() -> None:
    """And no lean stands there alone."""
    for arms, bent, seed in product(ARMS, (False, True), range(8)):
        read = given(stored_arms(arms, bent, seed))
        found = diagnose(read.measured, read.model)
        named = [cause.id for cause in found.causes]
        assert "leg_length" in {*named, *found.ambiguous_with}, (arms, bent, seed)
        assert found.verdict is not Verdict.NAMED or "tower_lean" not in named, (arms, bent, seed)


def test_what_stored_arms_are_doubted_by_is_told_and_counted() -> None:
    """Half a millimetre is how well arms are cut; 5 mm makes the radius that much less sure."""
    sure, doubted = (
        answer_to(given(stored_arms(arms, False, 1, 41)))
        for arms in ((345.0, 345.4, 345.0), (340.0, 345.0, 345.0))
    )
    assert not any("equal arms" in note for note in sentences(sure.notes))
    (note,) = (note for note in sentences(doubted.notes) if "equal arms" in note)
    assert "340.0, 345.0 and 345.0 mm" in note
    assert [each.within for each in sure.undetermined] == [0.3]
    within = {each.name: each.within for each in doubted.undetermined}
    assert within["leg_length"] == pytest.approx(np.hypot(0.3, 5.0))
    radius = [
        next(each.expanded for each in answer.parameters if each.name == "radius")
        for answer in (sure, doubted)
    ]
    assert radius[1] > 1.5 * radius[0]


def dates(
    seed: int, layouts: tuple[Layout, Layout], lost: Floats = LOST
) -> tuple[DeltaSession, DeltaSession]:
    """Two days of a bent bed and lost motion; the controller was calibrated again in between."""
    rng = np.random.default_rng(seed)
    truth = Truth(bed=quartic(rng, BENT_MM), lost=lost)
    later = replace(V400, radius=162.3, angles=(210.1, 329.9, 90.0), endstops=(420.6, 419.7, 420.2))
    moved = replace(truth, endstops=frozen([0.05, -0.04, 0.03]), radius=-0.02)
    return (
        probe_bed(V400, truth, (), layouts[0], rng),
        probe_bed(later, moved, (), layouts[1], rng),
    )


@pytest.mark.parametrize("seeds", [1, pytest.param(16, marks=pytest.mark.slow)])
def test_what_is_carried_predicts_better_than_a_surface_and_than_the_earlier_map(
    seeds: int,
) -> None:
    """Held-out errors by those of the better baseline, on other places."""
    ratios = []
    for seed in range(seeds):
        first, second = map(given, dates(seed, (Layout(121), Layout(149))))
        found = diagnose(
            first.measured, first.model, holdout=second.measured, then=second.model
        ).baselines
        ratios.append(found.extension_mm / min(found.quartic_mm, found.earlier_map_mm))
    assert np.mean(np.array(ratios) <= 1.0) >= 2 / 3
    assert np.median(ratios) <= 0.95


def test_a_shape_is_accepted_stored_and_carried() -> None:
    """Whatever makes it; the same touches are then explained without it."""
    first, second = map(given, dates(5, (Layout(61), Layout(61)), frozen(np.zeros(3))))
    model = diagnose(first.measured, first.model).extend("bed_shape", date(2026, 1, 31))
    stored = stored_machine(machine_text(model), "known.yaml").model
    (kept,) = stored.accepted
    assert kept.cause is CAUSES["bed_shape"]
    theta = model.accepted[0].theta
    assert 7 < theta.size <= 61 // 3
    assert kept.theta[: theta.size] == pytest.approx(theta, rel=1e-9, abs=1e-15)
    later = replace(second.model, accepted=stored.accepted)
    bare, known = (diagnose(second.measured, each) for each in (second.model, later))
    assert known.lack_of_fit.left_mm < 0.7 * bare.lack_of_fit.left_mm
    assert "bed_shape" not in {cause.id for cause in known.causes}


def test_dates_together_share_one_shape_and_have_their_own_parameters() -> None:
    """Each date's parameters are found within three of their own standard deviations."""
    sessions = dates(5, (Layout(61), Layout(73)))
    inputs = list(map(given, sessions))
    joint = together(inputs)
    found = diagnose(joint.measured, joint.model)
    assert {"bed_shape", "backlash"} <= {c.id for c in found.causes} | set(found.ambiguous_with)
    assert found.lack_of_fit.dof == 61 + 73 - 12
    answer = answer_to(joint, diagnosed=found, dates=inputs)
    assert [each.readings for each in answer.inputs] == [61, 73]
    for session, each in zip(sessions, answer.dates, strict=True):
        true = true_values(session.machine, session.truth)
        for parameter, value in zip(each.parameters, true.tolist(), strict=True):
            assert abs(parameter.found - value) < 3.0 * parameter.std
    assert any(
        "other endstops, delta radius, tower angles in force" in n for n in sentences(answer.notes)
    )


def test_a_date_refutes_the_shape_of_those_before_it() -> None:
    """A flat bed, touched at few places, hardly weighs against a name found of all dates."""
    bent = Truth(bed=quartic(np.random.default_rng(2), 0.06))
    inputs = [
        given(probe_bed(V400, truth, (), Layout(places), np.random.default_rng(places)))
        for truth, places in ((bent, 121), (bent, 61), (Truth(), 19))
    ]
    joint = together(inputs)
    found = diagnose(joint.measured, joint.model)
    assert (found.verdict, found.causes) == (Verdict.UNEXPLAINED, ())
    assert found.refuted.code == "refuted_later"


def test_later_readings_refute_all_that_is_left_open() -> None:
    """Towers that lean, or a bent bed; a week later the same the other way round."""
    leans = np.array([[3.0, -1.0], [0.5, -4.0], [1.0, 3.0]])
    first, same, other = (
        given(probe_bed(V400, Truth(leans=sign * leans), (), Layout(61), np.random.default_rng(n)))
        for n, sign in enumerate((1.0, 1.0, -1.0))
    )
    kept, refuted = (
        diagnose(first.measured, first.model, later.measured) for later in (same, other)
    )
    assert (kept.verdict, kept.refuted) == (Verdict.AMBIGUOUS, None)
    assert (refuted.verdict, refuted.refuted.code) == (Verdict.UNEXPLAINED, "refuted_later")


def test_a_place_that_is_off_on_every_date_is_no_misreading() -> None:
    """Seven heights, one of them 0.4 mm off on each of four dates."""
    inputs, one = [], 0.4 * (np.arange(7) == 3)
    for number in range(4):
        session = probe_bed(V400, Truth(), (), Layout(7), np.random.default_rng(number))
        off = replace(session, readings=session.readings + one)
        inputs.append(given(off))
    alone = diagnose(inputs[0].measured, inputs[0].model)
    joint = together(inputs)
    found = diagnose(joint.measured, joint.model)
    assert "misread" in {cause.id for cause in alone.causes} | set(alone.ambiguous_with)
    assert "misread" not in {cause.id for cause in found.causes} | set(found.ambiguous_with)
    assert found.verdict is not Verdict.CONSISTENT


def _again(found: Diagnosis) -> bool:
    return any("repeat" in note for note in sentences(found.notes))


def test_maps_that_repeat_are_not_noise_once_they_are_judged_together() -> None:
    """A local shape of 20 µm is what is stated of this bed, until it comes back."""
    rng = np.random.default_rng(2)
    machine = replace(V400, noise=0.004)
    rough = Truth(bed=Surface(150.0, {}, grain(rng, machine.texture, GRAIN)))
    for truth, repeats in ((rough, True), (Truth(), False)):
        first, second = (given(probe_bed(machine, truth, (), Layout(25), rng)) for _ in range(2))
        alone = diagnose(first.measured, first.model)
        assert alone.verdict is Verdict.CONSISTENT
        joint = together([first, second])
        held = diagnose(first.measured, first.model, holdout=second.measured)
        # Readings that no fit may see decide nothing, but that they repeat is said.
        assert held.verdict is Verdict.CONSISTENT
        both = diagnose(joint.measured, joint.model)
        assert (both.verdict is Verdict.CONSISTENT) is not repeats
        assert _again(held) is _again(both) is repeats


def test_a_probe_that_reads_on_its_way_shows_no_lost_motion() -> None:
    """The same touches; what depends on the approach is not claimed, and not carried."""
    truth = Truth(bed=quartic(np.random.default_rng(4), 2.0 * BENT_MM), lost=LOST)
    read = given(probe_bed(V400, truth, (), Layout(61), np.random.default_rng(4)))
    machine = read.model.machine
    scanner = machine.changed(probe=machine.instrument.changed(scanning=True))
    touched, scanned = (
        diagnose(read.measured, replace(read.model, machine=each)) for each in (machine, scanner)
    )
    assert "backlash" in {cause.id for cause in touched.causes}
    assert "backlash" not in {cause.id for cause in scanned.causes} | set(scanned.ambiguous_with)
    assert "bed_shape" in {cause.id for cause in scanned.causes} | set(scanned.ambiguous_with)


# As the towers of a real printer are: 36 µm r.m.s. on its bed, for weeks.
LEANING = Truth(
    leans=frozen(np.array([[3.0, -1.5], [1.0, -8.5], [1.0, -7.5]])),
    lost=frozen([0.07, 0.07, 0.015]),
)
# The same, calibrated again: other values in its controller.
MOVED = replace(V400, radius=162.3, angles=(210.1, 329.9, 90.0), endstops=(420.6, 419.7, 420.2))
HOMED = replace(LEANING, endstops=frozen([0.4, -0.2, 0.3]), radius=-0.4)
MESH = Layout(150)


def diagnosed(session: DeltaSession) -> Diagnosis:
    read = given(session)
    return diagnose(read.measured, read.model)


def day(
    seed: int, machine: Delta, truth: Truth, bed_seed: int = 1, layout: Layout = MESH
) -> DeltaSession:
    """A mesh of the same bed, probed to and fro."""
    waves = grain(np.random.default_rng(bed_seed), machine.texture, GRAIN)
    bed = Surface(machine.bed, {}, waves)
    return probe_bed(
        machine, replace(truth, bed=bed), ("tower_lean",), layout, np.random.default_rng(seed)
    )


@pytest.fixture(scope="module")
def leaning() -> tuple[Input, Input]:
    """A printer, and the same after it was calibrated again."""
    return given(day(1, V400, LEANING)), given(day(2, MOVED, HOMED))


@pytest.fixture(scope="module")
def held_out(leaning: tuple[Input, Input]) -> Diagnosis:
    """What is said of it, and how well that predicts the second day."""
    before, after = leaning
    return diagnose(before.measured, before.model, holdout=after.measured, then=after.model)


def test_one_flat_mesh_leaves_leaning_towers_and_a_bent_bed_open(held_out: Diagnosis) -> None:
    """And something unexplained."""
    found = held_out
    assert found.verdict is Verdict.AMBIGUOUS
    assert {cause.id for cause in found.causes} == {"tower_lean", "backlash"}
    assert found.causes[0].id == "tower_lean"
    assert found.ambiguous_with == ("bed_shape",)
    following = best_next(found)
    assert "block of known height" in sentence(following.what)
    assert following.between == (("tower_lean",), ("bed_shape",))
    assert any("backlash" in note and "not certain" in note for note in sentences(found.notes))
    left = found.causes[0].rms_after_mm
    assert 0.018 < left < 0.026
    (note,) = (note for note in sentences(found.notes) if note.startswith("Unexplained"))
    assert f"{1e3 * left:.0f} µm r.m.s." in note
    assert "13 µm is the probe's noise" in note


def test_a_recalibrated_machine_is_held_out_with_its_parameters_free(
    leaning: tuple[Input, Input], held_out: Diagnosis
) -> None:
    """Noise of 13 µm and a local shape of 20 µm: nothing predicts better than 24 µm."""
    before, after = leaning
    lean = held_out.causes[0]
    assert lean.heldout_before_mm > 0.035
    assert lean.heldout_after_mm < 0.026
    assert lean.heldout_ratio == pytest.approx(1.0, abs=0.3)
    assert any("was recalibrated" in note for note in sentences(held_out.notes))
    # Held to the parameters of the first day, but for the endstops, it is another machine.
    fixed = diagnose(before.measured, before.model, holdout=after.measured)
    assert fixed.causes[0].heldout_after_mm > 2.0 * lean.heldout_after_mm
    assert not any("was recalibrated" in note for note in sentences(fixed.notes))
    assert any("origin of the endstops has moved" in note for note in sentences(fixed.notes))
    told = diagnose(before.measured, before.model, holdout=after.measured, recalibrated=True)
    assert told.causes[0].heldout_after_mm == pytest.approx(lean.heldout_after_mm, rel=0.05)
    assert any("was recalibrated" in note for note in sentences(told.notes))


@pytest.mark.slow
def test_few_touches_of_a_recalibrated_machine_are_predicted_as_well_as_is_stated() -> None:
    """Six parameters are fitted to 16 touches, and count: the mean square of error/stated is 1.

    40 beds, and of each its first day, which says how rough it is to ± 8 %: 400 degrees of freedom,
    ± 0.07; outside ± 0.25 in 0.04 % of cases. Uncounted, it would be 0.6.
    """
    causes = CAUSES["backlash"], CAUSES["tower_lean"]
    squares = []
    for seed in range(40):
        days = day(seed, V400, LEANING, seed), day(100 + seed, MOVED, HOMED, seed, Layout(16))
        white, later = (Whitened.of(one.measured, one.model) for one in map(given, days))
        at = Linearised.of(white, Candidates(causes, (), (), {}))
        fit = fit_hypothesis(Hypothesis(at, 0.0, causes))
        squares.append(Later(later, later.machine, np.zeros(6), 6).held_out(fit).ratio ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.25)


def test_of_the_same_parameters_only_a_moved_origin_is_fitted_again() -> None:
    """Not calibrated again, the next day's machine is predicted wholly but for its endstops."""
    before = given(day(1, V400, LEANING))
    shifted = replace(LEANING, endstops=frozen([0.3, 0.3, 0.3]))
    after = given(day(2, V400, shifted))
    found = diagnose(before.measured, before.model, holdout=after.measured, then=after.model)
    assert found.causes[0].heldout_after_mm < 0.03
    (note,) = (note for note in sentences(found.notes) if "origin of the endstops" in note)
    moved = [float(size) for size in re.findall(r"\+\d\.\d+", note)]
    assert moved == pytest.approx([0.3, 0.3, 0.3], abs=0.03)
    entered = np.array([-0.3, -0.3, -0.3])
    found = diagnose(before.measured, before.model, after.measured, entered, after.model)
    assert found.causes[0].heldout_after_mm < 0.03
    assert not any("origin of the endstops" in note for note in sentences(found.notes))


@pytest.mark.parametrize(
    "change",
    [
        {"arms": (344.6, 344.6, 344.6)},
        {"radius": 161.9},
        {"angles": (210.1, 330.0, 90.0)},
        {"endstops": (420.1, 420.0, 420.0)},
        {},
    ],
    ids=lambda change: "".join(change) or "nothing",
)
def test_any_other_parameter_in_the_controller_leaves_them_free(change: dict[str, Any]) -> None:
    before = given(make_delta_session(1, V400, layout=Layout(25)))
    after = given(make_delta_session(1, replace(V400, **change), layout=Layout(25)))
    found = diagnose(before.measured, before.model, after.measured, np.zeros(6), after.model)
    assert any("was recalibrated" in note for note in sentences(found.notes)) is bool(change)


@pytest.mark.parametrize(
    ("drift", "layout", "seed"),
    [(0.15, Layout(9, cycles=12, pace=0.28), 0), (1.4, Layout(13, cycles=5), 0)],
)
def test_a_series_that_drifts_is_named_drift(drift: float, layout: Layout, seed: int) -> None:
    """Half an hour at 0.15 mm/h; and 28 times what is usual, which endstops do not do, too."""
    rng = np.random.default_rng(seed)
    session = probe_bed(V400, Truth(drift=drift), ("probe_drift",), layout, rng)
    found = diagnosed(session)
    assert (found.verdict, ids(found)) == (Verdict.NAMED, ["probe_drift"])
    (estimate,) = found.causes[0].parameters
    assert abs(estimate.value - drift) < 3.0 * estimate.std


def test_several_wrong_touches_are_all_named() -> None:
    """On a bed that could be four times as rough as stated, so that each alone might be its own."""
    session = clear_delta_outside(0, V400, Layout(61), "scattered_misreads")
    found = diagnosed(session)
    assert (found.verdict, ids(found)) == (Verdict.NAMED, ["misread"])
    wrong = np.flatnonzero(session.contact)
    assert sorted(found.effects[0].place) == wrong.tolist()
    sizes = {each.value: each.std for each in found.causes[0].parameters}
    true = session.contact[list(found.effects[0].place)]
    assert np.all(np.abs(np.array([*sizes]) - true) < 4.0 * np.array([*sizes.values()]))


def test_repeats_tell_the_repeatability() -> None:
    """Twenty places four times: 60 degrees of freedom, off by a third with p < 1e-5."""
    read = given(make_delta_session(5, V400, (), Layout(20, cycles=4), (0.03, GRAIN)))
    found = diagnose(read.measured, read.model)
    assert found.lack_of_fit.noise.repeats_mm == pytest.approx(V400.noise, rel=0.33)
    assert found.lack_of_fit.repeats_p_value is not None


@pytest.mark.parametrize(("seed", "expected"), [(1, True), (2, False)])
def test_consistent_is_what_noise_leaves(seed: int, expected: bool, tmp_path: Path) -> None:
    """Stored calibrations whose heights scatter four times as much as is usual.

    With p = 0.04 and 0.0003.
    """
    file = tmp_path / "printer.cfg"
    file.write_text(printer_cfg(V400, OFF, seed=seed, noise=0.05, sections="c"))
    found = answer_to(read_input(str(file)))
    assert (found.verdict is Verdict.CONSISTENT, found.release.usable) == (expected,) * 2


def test_every_page_has_the_same_root_mean_square(tmp_path: Path) -> None:
    """Of heights and distances together: each by its precision, as the fit weighed it."""
    file = tmp_path / "printer.cfg"
    file.write_text(printer_cfg(V400, OFF, noise=0.02))
    read = read_input(str(file))
    found = answer_to(read, details=True)
    left = np.array([row.measured_mm - row.modelled_mm for row in found.residuals])
    calliper = LinearDelta.require(read.model.machine)
    weight = np.array([1.0] * 7 + [calliper.probe.noise_mm / calliper.probe.calliper_mm] * 3)
    expected = float(np.sqrt(np.mean((weight * left) ** 2)))
    assert found.rms.after_mm == pytest.approx(expected, rel=1e-6)
    assert found.lack_of_fit.left_mm == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("size", [1.0, 2.5])
def test_a_rough_bed_is_told_to_be_rough(size: float) -> None:
    rough = (size * V400.texture, GRAIN)
    session = make_delta_session(1, V400, (), Layout(121), rough)
    found = answer_to(given(session))
    assert found.release.usable
    said = " ".join(sentences(found.release.cautions))
    assert ("times its stated or usual size" in said) == (size > 2.0)


@pytest.mark.parametrize(("places", "rough"), [(41, False), (41, True), (800, True)])
def test_a_sound_machine_has_no_name(places: int, rough: bool) -> None:
    """Of 800 points a part of the bed's local shape counts as noise."""
    session = make_delta_session(0, V400, (), Layout(places), (rough * V400.texture, GRAIN))
    assert diagnosed(session).verdict is Verdict.CONSISTENT
