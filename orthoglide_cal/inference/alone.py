"""The calibrated parameters alone: the fit of the empty hypothesis, or a method of the paper."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation.gaussian import shrink, shrinking
from orthoglide_cal.estimation.solution import (
    Method,
    Solution,
    choose_method,
    conclude,
    fitted_here,
    require_settings,
    solve_by,
)
from orthoglide_cal.inference.data import NOTHING, Linearised, Whitened
from orthoglide_cal.inference.fit import Fit, fit_hypothesis
from orthoglide_cal.inference.hypothesis import Hypothesis
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import Measured
from orthoglide_cal.model.model import Model


def solve(measured: Measured, model: Model, method: str | None = None) -> Solution:
    """Identify the joint offsets by a method of this name; None: the default of such data.

    All readings at once are weighted by what is uncertain of them in addition to noise, such as
    where along its leg each gauge stands; the methods of the paper know no weights.

    Raises UsageError: the method does not exist or cannot use these data. UnusableResultError: the
    data do not determine the offsets, with what to add; no optimum was found; no machine has these
    offsets; or nobody knows what they are added to.
    """
    require_settings(measured)
    chosen = choose_method(measured, method)
    if chosen is not Method.READINGS:
        return solve_by(chosen, measured, model)
    known = model
    if here := fitted_here(measured, model):
        # What was fitted to these readings is no unknown of a fit to them.
        exact = (replace(e, covariance=None) if e.cause.id in here else e for e in model.accepted)
        known = replace(model, accepted=tuple(exact))
    with weighing(model.machine):
        nothing = Hypothesis(Linearised.of(Whitened.of(measured, known), NOTHING), 0.0)
        return solution_of(fit_hypothesis(nothing), measured, model)


@contextmanager
def weighing(machine: Machine) -> Iterator[None]:
    """Raise UnusableResultError for data that noise and sizes of causes leave no digit of."""
    try:
        # What cannot be weighed shows as NaN and is refused; warnings would say nothing more.
        with np.errstate(invalid="ignore"):
            yield
    except np.linalg.LinAlgError as error:
        raise UnusableResultError(
            "These data cannot be weighed: the gauge's stated noise"
            f" ({machine.instrument.noise_mm:.2g} mm) is out of all proportion to the readings.",
            "Check gauge and tolerances in the machine file.",
        ) from error


def solution_of(fit: Fit, measured: Measured, model: Model) -> Solution:
    """The fit of the empty hypothesis to all readings at once, with its uncertainty budget."""
    white, uncertain = fit.white, slice(fit.first_uncertain, None)
    shrunk = shrinking(fit.columns[:, uncertain] * (fit.sizes[uncertain] / fit.stated))
    problem = replace(white.problem, model=model).weighted(shrunk)
    data = shrink(white.data, *shrunk)
    estimator, scale = fit.estimator(fit.stated) @ white.matrix, fit.scale_factor
    return conclude(Method.READINGS, measured, problem, data, fit.offsets, estimator, scale)
