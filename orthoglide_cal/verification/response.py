"""Regression of the change between two sessions on what the model predicts for the correction.

    c = β·g(δ) + noise,  g(δ) = h(Δρ − δ) − h(Δρ)

h: predicted quantities, Δρ: offsets before, δ: entered in the controller. An entered δ is taken
off the offset that remains (true = indicated + Δρ), so theory says β = 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from scipy.special import chdtrc

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.estimation.accuracy import half_width
from orthoglide_cal.verification.comparison import Comparison
from orthoglide_cal.verification.result import (
    AS_MODELLED,
    EXCHANGED,
    NO_RESPONSE,
    OPPOSITE,
    OTHER_GAIN,
    UNDETERMINED,
    AxisResponse,
    Change,
    Coefficient,
)

# Another sign or order of the axes is believed only at these odds against all others together.
ODDS = 20.0
# Confidence with which the response is called other than modelled.
CERTAIN = 0.999


@dataclass(frozen=True, eq=False)
class Response:
    """How the machine responded; fields as in `result.Verification`."""

    response: Coefficient
    sigma_mm: float
    dof: int
    axes: tuple[AxisResponse, ...]
    answer: str
    acted_as_mm: Floats | None
    change: Change


def respond(
    comparison: Comparison,
    offsets: Floats,
    applied: Floats,
    noise_mm: float,
    floor_mm: float,
) -> Response:
    """Fit the response.

    Args:
        comparison: k quantities of both sessions.
        offsets: Δρ before the correction, shape (3,) [mm].
        applied: δ, shape (3,) [mm], not all zero.
        noise_mm: standard deviation of one reading that the gauge's maker states.
        floor_mm: smallest standard deviation that its resolution allows.
    """
    whiten = np.linalg.inv(np.linalg.cholesky(comparison.covariance))
    change = whiten @ comparison.change
    problem = comparison.problem
    predicted = whiten @ (problem.model(offsets - applied) - problem.model(offsets))
    # Midway, where a linear model of the change is right to third order.
    slope = -(whiten @ problem.model_with_jacobian(offsets - applied / 2.0)[1])

    axes, left = _axes(change, slope, applied, floor_mm)
    count = len(change)
    beta = float(predicted @ change / (predicted @ predicted))
    residual = change - beta * predicted
    sigma = max(float(np.sqrt(residual @ residual / (count - 1))), floor_mm)
    response = _coefficient(beta, sigma / float(np.sqrt(predicted @ predicted)), count - 1)
    acted_as = _better_order(change, slope, applied, noise_mm)
    typical = float(np.sqrt(np.mean(np.diag(comparison.covariance))))
    dof = count - 3
    return Response(
        response=response,
        sigma_mm=sigma,
        dof=count - 1,
        axes=axes,
        answer=_answer(response, count - 1, acted_as, applied),
        acted_as_mm=acted_as,
        change=Change(
            rms_mm=typical * float(np.sqrt(left / dof)),
            noise_mm=typical * noise_mm,
            dof=dof,
            p_value=float(chdtrc(dof, left / noise_mm**2)),
        ),
    )


def _coefficient(value: float, std: float, dof: int) -> Coefficient:
    reach = half_width(dof) * std
    return Coefficient(value, std, value - reach, value + reach)


def _axes(
    change: Floats, slope: Floats, applied: Floats, floor_mm: float
) -> tuple[tuple[AxisResponse, ...], float]:
    """Change of each joint, fitted together; and the sum of squares that is left."""
    inverse = np.linalg.pinv(slope)
    found = inverse @ change
    residual = change - slope @ found
    left = float(residual @ residual)
    dof = len(change) - 3
    sigma = max(float(np.sqrt(left / dof)), floor_mm)
    std = sigma * np.sqrt(np.diag(inverse @ inverse.T))
    rows = []
    for k, axis in enumerate(AXES):
        reach = half_width(dof) * std[k]
        size = float(applied[k])
        rows.append(
            AxisResponse(
                axis=axis,
                applied_mm=size,
                found_mm=float(found[k]),
                low_mm=float(found[k] - reach),
                high_mm=float(found[k] + reach),
                coefficient=(
                    _coefficient(float(found[k]) / size, float(std[k]) / abs(size), dof)
                    if size
                    else None
                ),
            )
        )
    return tuple(rows), left


def _better_order(change: Floats, slope: Floats, applied: Floats, noise_mm: float) -> Floats | None:
    """The signed order of the applied offsets that explains the change clearly better.

    Of those that explain it about as well as the best one, the simplest: everything with the
    opposite sign, then axes exchanged with their signs kept, then any other.
    """
    # The first entry is what was applied.
    hypotheses = [
        (order, signs) for order in permutations(range(3)) for signs in product((1, -1), repeat=3)
    ]
    orders = np.array([np.array(signs) * applied[list(order)] for order, signs in hypotheses])
    misfit = ((change - orders @ slope.T) ** 2).sum(axis=-1)
    # Nobody knows these readings better than their noise: keeps the odds finite.
    misfit = misfit + len(change) * noise_mm**2
    behind = 0.5 * len(change) * np.log(misfit / misfit.min())
    if behind[0] <= np.log(len(hypotheses) * ODDS):
        return None

    def rank(k: int) -> tuple[int, float]:
        order, signs = hypotheses[k]
        if behind[k] > np.log(ODDS):
            simple = 3
        elif order == (0, 1, 2) and set(signs) == {-1}:
            simple = 0
        else:
            simple = 1 if set(signs) == {1} else 2
        return simple, float(behind[k])

    return np.asarray(orders[min(range(len(hypotheses)), key=rank)])


def _answer(response: Coefficient, dof: int, acted_as: Floats | None, applied: Floats) -> str:
    if acted_as is not None:
        return OPPOSITE if np.allclose(acted_as, -applied) else EXCHANGED
    # One healthy machine in twenty lies outside its 95 % interval; few enough outside this one.
    reach = half_width(dof, CERTAIN) * response.std
    moved, full = abs(response.value) > reach, abs(response.value - 1.0) <= reach
    if full:
        return AS_MODELLED if moved else UNDETERMINED
    return OTHER_GAIN if moved else NO_RESPONSE
