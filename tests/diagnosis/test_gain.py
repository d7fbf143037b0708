"""What an explanation gains on readings that no fit saw."""

from collections.abc import Iterator

import numpy as np
import pytest

from orthoglide_cal.diagnosis.assess import Assessment, assess
from orthoglide_cal.diagnosis.explanations import Whitened
from orthoglide_cal.diagnosis.fit import Fitted, leave_out_cells, predict_later
from orthoglide_cal.model.model import synthetic_session
from orthoglide_cal.model.orthoglide import double_posture
from orthoglide_cal.model.plan import Floats
from tests import truth
from tests.diagnosis.sessions import known
from tests.machines import NOMINAL, PROTOTYPE


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def cells_of(white: Whitened) -> list[np.ndarray]:
    """Readings of each (leg, direction, posture)."""
    plan = white.plan
    keys = list(zip(plan.leg, plan.direction, plan.displacement, strict=True))
    return [np.array([i for i, k in enumerate(keys) if k == key]) for key in sorted(set(keys))]


def refits(
    white: Whitened, fit: Fitted, cells: list[np.ndarray]
) -> Iterator[tuple[np.ndarray, Floats, Floats]]:
    """Each cell predicted by a fit to the other readings: (cell, errors, their covariance).

    Readings y = Z z + C u + e: gauge zeros z without a prior, offsets and parameters u with the
    one that the fit had. Solved in full for each cell, with the zeros as unknowns.
    """
    n, zeros = len(white.plan), white.plan.zeros
    design = np.hstack((zeros, white.matrix.T @ fit.columns)) / fit.sigma
    values = white.matrix.T @ fit.linear / fit.sigma
    penalty = np.diag(np.concatenate((np.zeros(zeros.shape[1]), 1.0 / fit.sizes**2)))
    for cell in cells:
        kept = np.setdiff1d(np.arange(n), cell)
        spread = np.linalg.inv(design[kept].T @ design[kept] + penalty)
        found = spread @ design[kept].T @ values[kept]
        error = values[cell] - design[cell] @ found
        covariance = np.eye(len(cell)) + design[cell] @ spread @ design[cell].T
        yield cell, fit.sigma * error, fit.sigma**2 * covariance


@pytest.mark.parametrize("hidden", ["axis_squareness", "stand_shift"])
def test_leaving_a_cell_out_is_refitting_without_it(hidden: str) -> None:
    readings, model = known(truth.make_session(4, truth.PROTOTYPE, truth.MICRON, (hidden,)))
    white = Whitened.of(readings, model)
    found = assess(white)
    cells = cells_of(white)
    assert len(cells) == 18
    assert found.judgement.accepted == (hidden,)
    for fit in (found.fit(()), found.accepted):
        errors, scaled = [], []
        for _, error, covariance in refits(white, fit, cells):
            errors.append(error)
            scaled.append(np.linalg.solve(np.linalg.cholesky(covariance), error))
        held_out = leave_out_cells(white, fit, found.accepted)
        assert held_out.rms_mm == pytest.approx(rms(np.concatenate(errors)), rel=1e-6)
        assert held_out.ratio == pytest.approx(rms(np.concatenate(scaled)), rel=1e-6)


def test_a_wrong_reading_is_not_held_against_the_model() -> None:
    readings, model = known(truth.make_session(2, truth.PROTOTYPE, truth.DIAL, ("misread",)))
    white = Whitened.of(readings, model)
    found = assess(white)
    assert found.judgement.accepted == ("misread",)
    wrong = found.accepted.wrong_reading
    assert wrong is not None
    cells = [cell[cell != wrong] for cell in cells_of(white)]
    errors = [error for _, error, _ in refits(white, found.accepted, cells)]
    held_out = leave_out_cells(white, found.accepted, found.accepted)
    # The wrong reading stays in the fits, where its unknown size takes it up.
    assert held_out.rms_mm == pytest.approx(rms(np.concatenate(errors)), rel=1e-4)


@pytest.mark.parametrize("hidden", ["axis_gap", "axis_squareness", "encoder_scale", "backlash"])
def test_a_wrong_cause_predicts_clearly_worse(hidden: str) -> None:
    """Every rival that the truth calls distinguishable (4σ and more), the nearest ones included."""
    for seed in (1, 2):
        session = truth.make_session(seed, truth.PROTOTYPE, truth.MICRON, (hidden,))
        readings, model = known(session)
        white = Whitened.of(readings, model)
        found = assess(white)
        assert found.judgement.accepted == (hidden,)

        def error(cause: str, white: Whitened = white, found: Assessment = found) -> float:
            return leave_out_cells(white, found.fit((cause,)), found.accepted).rms_mm

        distances = truth.separation(session).distances
        rivals = [
            rival
            for rival, distance in distances.items()
            # Legs thirty times their size predict as well as what is hidden; their size is known.
            if (rival,) in found.scores and rival not in (hidden, "leg_length")
            if distance >= 4.0
        ]
        assert len(rivals) >= 9
        for rival in rivals:
            clearly = 1.5 if distances[rival] >= 10.0 else 1.15
            assert error(rival) > clearly * error(hidden), rival


@pytest.mark.parametrize("hidden", ["axis_gap", "encoder_scale"])
def test_another_day_is_predicted_to_the_noise(hidden: str) -> None:
    """The truth's second session of the same machine, other zeros, other noise, other clock.

    Demanded is 1.3 of the noise of one reading; chance of a false failure below 1e-3.
    """
    floors, without, ratios = [], [], []
    for seed in range(1, 7):
        session = truth.make_session(seed, truth.LARGE, truth.MICRON, (hidden,))
        readings, model = known(session)
        found = assess(Whitened.of(readings, model))
        if found.judgement.accepted != (hidden,):
            continue
        later = Whitened.of(known(truth.second_session(session, seed))[0], model)
        floors.append(predict_later(later, found.accepted, np.zeros(3)).rms_mm)
        ratios.append(predict_later(later, found.accepted, np.zeros(3)).ratio)
        without.append(predict_later(later, found.fit(()), np.zeros(3)).rms_mm)
    assert len(floors) >= 4
    sigma = truth.MICRON.sigma
    assert rms(np.array(floors)) < 1.3 * sigma
    assert 0.8 < rms(np.array(ratios)) < 1.25
    assert rms(np.array(without)) > 1.5 * rms(np.array(floors))


def test_what_was_applied_is_no_longer_expected() -> None:
    """Offsets entered in between are taken off those found; their sign matters."""
    session = truth.make_session(2, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
    readings, model = known(session)
    found = assess(Whitened.of(readings, model))
    applied = np.array([0.21, -0.34, 0.55])
    corrected = truth.measure(
        session.machine,
        session.gauge,
        session.plan,
        session.offsets - applied,
        session.effects,
        np.random.default_rng(3),
    )
    later = Whitened.of(known(corrected)[0], model)
    # 54 contrasts of one session: 1.1 of the noise expected, ± 0.11.
    assert predict_later(later, found.accepted, applied).rms_mm < 1.5 * truth.MICRON.sigma
    assert predict_later(later, found.accepted, -applied).rms_mm > 0.05
    assert predict_later(later, found.accepted, np.zeros(3)).rms_mm > 0.03


def test_leaving_out_one_of_few_readings_is_still_a_number() -> None:
    """One cycle: every cell is one reading, and the isotropic one carries the zero."""
    plan = double_posture(PROTOTYPE, cycles=1, closing=False)
    rng = np.random.default_rng(3)
    session = synthetic_session(NOMINAL, plan, np.array([0.3, -0.5, 0.2]), rng)
    white = Whitened.of(session, NOMINAL)
    found = assess(white)
    held_out = leave_out_cells(white, found.fit(()), found.fit(()))
    assert 0.0 < held_out.rms_mm < 0.05
    assert 0.3 < held_out.ratio < 2.0
