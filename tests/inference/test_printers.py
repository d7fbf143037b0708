"""Printers on several dates: what lasts, what is carried, and stored arms that differ."""

from dataclasses import replace
from datetime import date
from itertools import product

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.input import together
from orthoglide_cal.files.machine_file import machine_from_text, machine_text
from orthoglide_cal.inference import Diagnosis, Verdict, diagnose, extend
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.results import answer_to, with_dates
from tests.inference.sessions import given
from tests.printers import true_values
from tests.sentences import sentences
from tests.truth.delta import (
    V400,
    DeltaSession,
    Layout,
    Surface,
    Truth,
    grain,
    places_of,
    probe_bed,
)
from tests.truth.delta_separation import GRAIN
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
    assert [each.within for each in doubted.undetermined] == [pytest.approx(np.hypot(0.3, 5.0))]
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
    model = extend(first.measured, first.model, "bed_shape", date(2026, 1, 31))
    stored = machine_from_text(machine_text(model), "known.yaml")
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
    answer = with_dates(answer_to(joint, diagnosed=found), found, inputs)
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
