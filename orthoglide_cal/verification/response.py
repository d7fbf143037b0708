"""Regression of the change between two sessions on what the model predicts for the correction.

    c = β·g(δ) + noise,  g(δ) = h(Δρ − δ) − h(Δρ)

h: predicted quantities, Δρ: offsets before, δ: entered in the controller. An entered δ is taken
off the offset that remains (true = indicated + Δρ), so theory says β = 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import permutations, product

import numpy as np

from orthoglide_cal.estimation.accuracy import chance_of_residual, half_width
from orthoglide_cal.estimation.solution import SUSPICIOUS
from orthoglide_cal.model import AXES, Floats, ReadOnly
from orthoglide_cal.verification.comparison import Comparison

# Another sign or order of the axes is believed only at these odds against all others together.
ODDS = 20.0
# Confidence with which the response is called other than modelled.
CERTAIN = 0.999
# Stands a millimetre off change what a gauge shows of an offset by up to this share of it.
STANDS = 0.01


class Behaviour(StrEnum):
    """How the machine responded."""

    AS_MODELLED = "as modelled"
    OPPOSITE = "opposite sign"
    EXCHANGED = "axes exchanged"
    NO_RESPONSE = "no response"
    OTHER_GAIN = "other gain"
    PARTLY = "in part"
    UNDETERMINED = "undetermined"


@dataclass(frozen=True)
class Coefficient:
    """A number with its 95 % Student-t interval; theory says 1."""

    value: float
    std: float
    low: float
    high: float

    @property
    def agrees(self) -> bool:
        """True if the interval holds 1."""
        return self.low <= 1.0 <= self.high


@dataclass(frozen=True)
class AxisResponse:
    """What one joint did.

    Attributes:
        axis: "x", "y" or "z".
        applied_mm: change entered in the controller.
        found_mm: change that the readings show.
        low_mm, high_mm: its 95 % interval.
        coefficient: found / applied; None where nothing was applied.
        otherwise: True if something else than what was applied is certain.
    """

    axis: str
    applied_mm: float
    found_mm: float
    low_mm: float
    high_mm: float
    coefficient: Coefficient | None
    otherwise: bool


@dataclass(frozen=True)
class Change:
    """Did anything change that no joint offset explains?

    Attributes:
        rms_mm: root mean square of the unexplained change of a difference, per degree of freedom.
        noise_mm: what the gauge's noise alone gives for it.
        dof: degrees of freedom.
        p_value: probability of a larger one from noise alone.
    """

    rms_mm: float
    noise_mm: float
    dof: int
    p_value: float

    @property
    def found(self) -> bool:
        """True if noise alone would give such a change less than once in a thousand times."""
        return self.p_value < SUSPICIOUS


@dataclass(frozen=True, eq=False)
class Response(ReadOnly):
    """How the machine responded to the correction.

    Attributes:
        coefficient: of the change on the model's prediction, all axes together.
        dof: degrees of freedom of that interval.
        axes: the same for each joint, fitted together.
        behaviour: in a word.
        acted_as_mm: signed permutation of the applied offsets that explains the change better,
            shape (3,); None if what was applied explains it best.
        change: what no offset explains.
    """

    coefficient: Coefficient
    dof: int
    axes: tuple[AxisResponse, ...]
    behaviour: Behaviour
    acted_as_mm: Floats | None
    change: Change


def respond(comparison: Comparison, offsets: Floats, applied: Floats) -> Response:
    """Fit the response.

    Args:
        comparison: k quantities of both sessions.
        offsets: Δρ before the correction, shape (3,) [mm].
        applied: δ, shape (3,) [mm], not all zero.
    """
    problem = comparison.problem
    gauge = problem.model.machine.instrument
    whiten = np.linalg.inv(np.linalg.cholesky(comparison.covariance))
    change = whiten @ comparison.change
    predicted = whiten @ problem.change(offsets, applied)
    # Midway, where a linear model of the change is right to third order.
    slope = -(whiten @ problem.predict_with_jacobian(offsets - applied / 2.0)[1])

    axes, left = _axes(change, slope, applied, gauge.rounding_mm)
    dof = len(change) - 1
    beta = float(predicted @ change / (predicted @ predicted))
    residual = change - beta * predicted
    # No reading is known better than its gauge's resolution allows.
    sigma = max(float(np.sqrt(residual @ residual / dof)), gauge.rounding_mm)
    coefficient = _coefficient(beta, sigma / float(np.sqrt(predicted @ predicted)), dof)
    acted_as = _better_order(change, slope, applied, gauge.noise_mm)
    typical = float(np.sqrt(np.mean(np.diag(comparison.covariance))))
    spare = len(change) - 3
    return Response(
        coefficient=coefficient,
        dof=dof,
        axes=axes,
        behaviour=_behaviour(coefficient, dof, acted_as, applied, axes),
        acted_as_mm=acted_as,
        change=Change(
            rms_mm=typical * float(np.sqrt(left / spare)),
            noise_mm=typical * gauge.noise_mm,
            dof=spare,
            p_value=chance_of_residual(left, spare, gauge.noise_mm),
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
        beyond = half_width(dof, CERTAIN) * np.hypot(std[k], STANDS * size)
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
                otherwise=bool(abs(found[k] - size) > beyond),
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


def _behaviour(
    response: Coefficient,
    dof: int,
    acted_as: Floats | None,
    applied: Floats,
    axes: Sequence[AxisResponse],
) -> Behaviour:
    if acted_as is not None:
        opposite = np.allclose(acted_as, -applied)
        return Behaviour.OPPOSITE if opposite else Behaviour.EXCHANGED
    others = [row.otherwise for row in axes]
    if any(others) and not all(others):
        return Behaviour.PARTLY
    # One healthy machine in twenty lies outside its 95 % interval; few enough outside this one.
    reach = half_width(dof, CERTAIN) * response.std
    moved, full = abs(response.value) > reach, abs(response.value - 1.0) <= reach
    if full:
        return Behaviour.AS_MODELLED if moved else Behaviour.UNDETERMINED
    return Behaviour.OTHER_GAIN if moved else Behaviour.NO_RESPONSE
