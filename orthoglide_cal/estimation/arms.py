"""Arms of a linear delta that are free, as in Klipper, where its file stores distances."""

import math
from dataclasses import replace

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.input import Input
from orthoglide_cal.files.printer_file import ARMS
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import Effect, Model, differentiate
from orthoglide_cal.schema import Reason

# Of a distance by that of a height in DELTA_CALIBRATE, where both are as many.
_TRUST = 0.5
_STEPS = 8  # of a search that converges quadratically
_NEGLIGIBLE = 1e-9  # singular values below this share of the largest are zero


def free_arms(given: Input) -> Input:
    """The input, and others of its file, on a machine with the arms that its distances show.

    As it is where the arms are known, or where so few distances fit any arms.
    """
    measured, model = given.measured, given.model
    if not isinstance(measured, Readings) or measured.source.excerpt is None:
        return given
    others = tuple(map(free_arms, given.others))
    if (arms := _fitted(model, measured)) is None:
        return replace(given, others=others)
    remark = Reason.of("arms_freed", arms=model.called(arms))
    measured = replace(measured, remarks=(remark, *measured.remarks))
    return replace(given, measured=measured, model=model.extended([arms]), others=others)


def _fitted(model: Model, readings: Readings) -> Effect | None:
    """Excess of the arms over those stored, fitted with all else [mm]; None if it cannot be.

    The weights are those of DELTA_CALIBRATE; how sure the arms are follows from what is stated of
    probe and calliper, or from what is left if that is more.
    """
    machine, plan, cause = model.machine, readings.plan, CAUSES[ARMS]
    distance = ~plan.touches
    known = any(effect.cause is cause for effect in model.accepted)
    if known or distance.sum() < 2 * cause.unknowns or not cause.size(machine):
        return None
    weight = np.where(distance, math.sqrt(_TRUST * plan.touches.sum() / distance.sum()), 1.0)
    unknowns = np.zeros(len(machine.parameter_names) + cause.unknowns)
    rest, arms = np.split(np.arange(len(unknowns)), [-cause.unknowns])
    for _ in range(_STEPS):
        lengths = cause.at(unknowns[arms])
        predicted, jacobian = differentiate(model, unknowns[rest], plan, [lengths], strict=False)
        left, jacobian = weight * (readings.value - predicted), weight[:, None] * jacobian
        if not np.isfinite(jacobian).all():
            return None
        if np.linalg.matrix_rank(jacobian, _NEGLIGIBLE) < len(unknowns):
            return None
        estimator = np.linalg.pinv(jacobian)
        unknowns += estimator @ left
    local = machine.local_shape(plan)
    shape = plan.touches * (local.size or 0.0) if local else 0.0
    apart = weight * np.hypot(machine.instrument.noise_mm / plan.precision, shape)
    scatter = float(np.sum((left / apart) ** 2)) / max(len(plan) - len(unknowns), 1)
    spread = estimator[arms] * apart * math.sqrt(max(scatter, 1.0))
    digest = readings.source.sha256
    return Effect(cause, unknowns[arms], covariance=spread @ spread.T, data_sha256=digest)
