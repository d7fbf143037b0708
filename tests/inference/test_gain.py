"""What an explanation gains on readings that no fit saw."""

from collections.abc import Iterator

import numpy as np
import pytest

from orthoglide_cal.inference.belief import Belief
from orthoglide_cal.inference.data import Whitened
from orthoglide_cal.inference.fit import Fit, leave_out_cells
from orthoglide_cal.model.plan import Floats, Ints
from tests import truth
from tests.inference.sessions import known
from tests.model.test_plan import groups


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def refits(white: Whitened, fit: Fit, cells: list[Ints]) -> Iterator[tuple[Floats, Floats]]:
    """Each cell predicted by a fit to the other readings: (errors, their covariance).

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
        yield fit.sigma * error, fit.sigma**2 * covariance


@pytest.mark.parametrize(
    ("hidden", "seed", "rel"),
    [("axis_squareness", 4, 1e-6), ("stand_shift", 4, 1e-6), ("misread", 2, 1e-4)],
)
def test_leaving_a_cell_out_is_refitting_without_it(hidden: str, seed: int, rel: float) -> None:
    """A wrong reading is not held against the model: it stays where its size takes it up."""
    readings, model = known(truth.make_session(seed, truth.PROTOTYPE, truth.MICRON, (hidden,)))
    white = Whitened.of(readings, model)
    found = Belief.about(white)
    accepted = found.fit((hidden,))
    wrong = accepted.wrong_readings
    assert len(wrong) == (hidden == "misread")
    # Readings of each (leg, direction, posture).
    cells = [np.setdiff1d(cell, wrong) for cell in groups(white.plan.cells)]
    assert len(cells) == 18
    for fit in (found.fit(()), accepted):
        errors, scaled = [], []
        for error, covariance in refits(white, fit, cells):
            errors.append(error)
            scaled.append(np.linalg.solve(np.linalg.cholesky(covariance), error))
        held_out = leave_out_cells(white, fit, accepted)
        assert held_out.rms_mm == pytest.approx(rms(np.concatenate(errors)), rel=rel)
        assert held_out.ratio == pytest.approx(rms(np.concatenate(scaled)), rel=rel)
