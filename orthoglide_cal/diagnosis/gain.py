"""What an explanation gains: residuals in sample, and prediction of readings that no fit saw.

For a linear-Gaussian model of the whitened data d = W y with covariance S, the error of
predicting a block B of readings from all others is (K_BB)⁻¹ (K y)_B with K = Wᵀ S⁻¹ W, and the
model's own statement of its covariance is (K_BB)⁻¹; gauge zeros have no part in K, and no refit
is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats, Ints
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.diagnosis.refine import Fitted


@dataclass(frozen=True)
class HeldOut:
    """Errors of predicting what was not fitted.

    Attributes:
        rms_mm: root mean square error.
        ratio: errors divided by what the model itself states for them, root mean square.
    """

    rms_mm: float
    ratio: float


def leave_out_cells(frame: Frame, fit: Fitted, judged: Fitted) -> HeldOut:
    """Predict each (leg, direction, posture) cell, or each difference, from all others.

    A single reading that the accepted explanation calls wrong cannot be predicted by any model;
    it is not scored.

    Args:
        frame: the data.
        fit: the model that predicts.
        judged: the accepted explanation.
    """
    scaled = fit.columns * fit.stds
    covariance = fit.sigma**2 * np.eye(len(frame)) + scaled @ scaled.T
    solved = np.linalg.solve(covariance, np.column_stack((frame.entries, fit.linear)))
    precision = frame.entries.T @ solved[:, :-1]
    weighted = frame.entries.T @ solved[:, -1]
    errors, scaled_errors = [], []
    for blocks in _by_size(frame, judged):
        own = precision[blocks[:, :, None], blocks[:, None, :]]
        root = np.linalg.cholesky(own)
        scaled_error = np.linalg.solve(root, weighted[blocks][..., None])
        scaled_errors.append(scaled_error.reshape(-1))
        errors.append(np.linalg.solve(root.swapaxes(1, 2), scaled_error).reshape(-1))
    return HeldOut(_rms(np.concatenate(errors)), _rms(np.concatenate(scaled_errors)))


def _by_size(frame: Frame, judged: Fitted) -> list[Ints]:
    """Blocks of entries to be left out; those of one size in one array, shape (blocks, size)."""
    wrong = judged.wrong_reading if frame.timed else None
    by_size: dict[int, list[Ints]] = {}
    for block in frame.blocks():
        kept = block[block != wrong] if wrong is not None else block
        if kept.size:
            by_size.setdefault(kept.size, []).append(kept)
    return [np.stack(blocks) for blocks in by_size.values()]


def predict_later(later: Frame, fit: Fitted, applied: Floats) -> HeldOut:
    """Predict readings taken after the controller was corrected.

    The offsets that remain are those found minus those applied; causes of the contact and the
    record that belong to the first session alone are not expected again.

    Args:
        later: the held-out data.
        fit: from the first data only.
        applied: offsets entered in between, shape (3,) [mm].
    """
    offsets = fit.offsets - applied
    lasting = [act for act in fit.acting if act.cause.lasting]
    model, slope, slopes = later.linearised(offsets, [(act.cause, act.theta) for act in lasting])
    error = later.data - model
    columns = np.hstack([slope, *slopes])
    known = fit.covariance[: columns.shape[1], : columns.shape[1]]
    covariance = fit.sigma**2 * np.eye(len(later)) + columns @ known @ columns.T
    scaled = np.linalg.solve(np.linalg.cholesky(covariance), error)
    return HeldOut(_rms(later.root @ error), _rms(scaled))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
