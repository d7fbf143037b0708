"""The promise: what the gauges will read once offsets are entered. Computed here and only here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from orthoglide_cal.estimation.accuracy import Scatter, half_width, rms
from orthoglide_cal.estimation.influences import influences
from orthoglide_cal.estimation.least_squares import Problem
from orthoglide_cal.estimation.methods import pose_differences, table_kind
from orthoglide_cal.model import DataKind, Difference, Floats, Measured, Model, ReadOnly
from orthoglide_cal.model.influence import Origin

# Nobody measures twice at the same pace: standard deviation of its ratio, assumed.
PACE = 0.1


@dataclass(frozen=True)
class PromisedDifference:
    """One difference of the paper's Table 4, before the offsets are entered and after.

    Attributes:
        difference: which.
        measured_mm: from the data.
        modelled_mm: what the model with its offsets gives for it.
        expected_mm: what is left after the correction: what will be measured once the offsets are
            entered.
        expanded_mm: expanded uncertainty U of that, with the noise of the readings that will show
            it: as many as showed it before.
    """

    difference: Difference
    measured_mm: float
    modelled_mm: float
    expected_mm: float
    expanded_mm: float


@dataclass(frozen=True, eq=False)
class Known(ReadOnly):
    """What is known of the machine when something is entered in its controller.

    Attributes:
        model: the machine and its accepted causes, with their uncertainty.
        offsets_mm: Δρ that the controller does not know yet, shape (3,).
        covariance_mm2: of these, shape (3, 3).
    """

    model: Model
    offsets_mm: Floats
    covariance_mm2: Floats


def promise(
    measured: Measured,
    known: Known,
    entered: Floats,
    noise: Scatter,
    right: Measured | None = None,
) -> tuple[PromisedDifference, ...]:
    """Measured, modelled and expected differences, in the order of Table 4.

    expected = measured + R·h(Δρ − entered) − R·h(Δρ): entering offsets takes away what they do on
    this machine with all its accepted causes, and nothing else. On the nominal machine that is
    the paper's measured − modelled. Its uncertainty is that of the readings before and after,
    and of what the change depends on.

    Args:
        measured: readings or differences.
        known: offsets and accepted causes, each with its uncertainty.
        entered: added to the controller's offsets, shape (3,) [mm].
        noise: of one reading.
        right: the data without faults that will not return, such as a misreading; None if there
            are none.
    """
    if not _shown(measured):
        return ()
    posed, kept = (
        pose_differences(data, known.model, table_kind(measured))
        for data in (measured, right or measured)
    )
    problem = posed.problem
    modelled = problem.predict(known.offsets_mm)
    expected = kept.data + problem.change(known.offsets_mm, entered)
    # The same readings are taken once before and once after.
    scatter = 2.0 * noise.sigma_mm**2 * np.diag(problem.covariance())
    variance = scatter + (_columns(problem, known, entered) ** 2).sum(axis=1)
    # Effective degrees of freedom by Welch–Satterthwaite, all but the noise known without end.
    factor = [half_width(noise.dof * ratio**2) for ratio in (variance / scatter).tolist()]
    reach = np.array(factor) * np.sqrt(variance)
    columns = (posed.data, modelled, expected, reach)
    rows = zip(posed.which, *(column.tolist() for column in columns), strict=True)
    return tuple(PromisedDifference(*row) for row in rows)


def _shown(measured: Measured) -> bool:
    """Whether differences of the paper can be made of the data."""
    return any(kind is not DataKind.READINGS for kind in measured.kinds)


def _columns(problem: Problem, known: Known, entered: Floats) -> Floats:
    """What one standard deviation of each source but the noise adds to a promise, (k, p) [mm].

    A source adds what it changes in the effect of the offsets that are entered.
    """
    before, after = known.offsets_mm, known.offsets_mm - entered
    root = np.linalg.cholesky(known.covariance_mm2)
    first, second = (problem.predict_with_jacobian(at)[1] for at in (before, after))
    columns = [(second - first) @ root, _pace(problem, after)]
    pairs = zip(*(influences(known.model, at, problem.plan) for at in (before, after)), strict=True)
    for one, other in pairs:
        was, left = problem.matrix @ one.columns, problem.matrix @ other.columns
        # The stands are put there anew; machine and gauge are the same.
        columns += [was, left] if one.source == Origin.GAUGE_PLACEMENT else [left - was]
    return np.hstack(columns)


def _pace(problem: Problem, after: Floats) -> Floats:
    """What another pace changes where time plays a part in an accepted cause, (k, 0 or 1) [mm]."""
    if problem.model.repeats:
        return np.zeros((len(problem.matrix), 0))
    slower = replace(problem.plan, hours=(1.0 + PACE) * problem.plan.hours)
    later = replace(problem, plan=slower).predict(after)
    return (later - problem.predict(after))[:, None]


def stays(promised: Sequence[PromisedDifference]) -> bool:
    """Whether more is left after the correction than its uncertainty allows for."""
    if not promised:
        return False
    left = rms(np.array([row.expected_mm for row in promised]))
    return left > rms(np.array([row.expanded_mm for row in promised]))
