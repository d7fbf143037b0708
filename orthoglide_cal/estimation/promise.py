"""The promise: what the gauges will read once offsets are entered. Computed here and only here."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from orthoglide_cal.estimation.accuracy import Scatter, half_width
from orthoglide_cal.estimation.budget import Budget, influences
from orthoglide_cal.estimation.methods import pose, table_kind
from orthoglide_cal.model.cause import Effect
from orthoglide_cal.model.machine import Origin
from orthoglide_cal.model.measured import DataKind, Measured
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats, ReadOnly
from orthoglide_cal.schema import Schema

# Nobody measures twice at the same pace: standard deviation of its ratio, assumed.
PACE = 0.1


class PromisedDifference(Schema):
    """One difference of readings (Table 4 of the paper)."""

    name: str
    measured_mm: float
    modelled_mm: float
    expected_mm: float = Field(description="after the parameters are entered")
    expanded_mm: float = Field(description="U of the expected value, as many new readings included")


@dataclass(frozen=True, eq=False)
class OffsetEstimate(ReadOnly):
    """The parameters of a machine as readings know them, and that machine."""

    model: Model  # the machine and its accepted causes, with their uncertainty
    offsets_mm: Floats  # that the controller does not know yet, shape (p,)
    budget: Budget  # where their uncertainty comes from
    noise: Scatter  # of one reading


def promise(
    measured: Measured,
    known: OffsetEstimate,
    entered: Floats,
    right: Measured | None = None,
    corrected: Iterable[Effect] = (),
) -> tuple[PromisedDifference, ...]:
    """Measured, modelled and expected differences, in the order of Table 4.

    expected = measured + R·h(Δρ − entered) − R·h(Δρ): entering offsets takes away what they do on
    this machine with all its accepted causes, and nothing else. On the nominal machine that is
    the paper's measured − modelled. Its uncertainty is that of the readings before and after,
    and of what the change depends on.

    Args:
        measured, known: the data, and what is known of the machine.
        entered: added to the controller's offsets, shape (3,) [mm].
        corrected: what the controller does from then on against causes, besides the offsets.
        right: the data without faults that will not return, such as a misreading; None if there
            are none.
    """
    if all(kind is DataKind.READINGS for kind in measured.kinds):
        return ()  # no differences of the paper can be made of these data
    kind = table_kind(measured)
    posed = pose(measured, known.model, kind)
    kept = posed if right is None else pose(right, known.model, kind)
    problem = posed.problem
    after = known.offsets_mm - entered
    both = np.stack((known.offsets_mm, after))
    modelled, first = problem.predict_with_jacobian(known.offsets_mm)
    later = replace(problem, model=known.model.extended(corrected))
    left, second = later.predict_with_jacobian(after)
    expected = kept.data + left - modelled
    # The same readings are taken once before and once after.
    scatter = 2.0 * known.noise.sigma_mm**2 * np.diag(problem.covariance())
    # What one standard deviation of each other source changes in the effect of what is entered.
    sources = [(second - first) @ np.linalg.cholesky(known.budget.covariance_mm2)]
    for influence in influences(known.model, both, problem.plan):
        was, is_left = problem.matrix @ influence.columns
        # The stands are put there again; machine and gauge are the same.
        anew = influence.source == Origin.GAUGE_PLACEMENT
        sources += [was, is_left] if anew else [is_left - was]
    if not problem.model.repeats:
        # The effect of a drift depends on the pace of measuring.
        slower = replace(problem.plan, hours=(1.0 + PACE) * problem.plan.hours)
        sources.append((replace(later, plan=slower).predict(after) - left)[:, None])
    variance = scatter + (np.hstack(sources) ** 2).sum(axis=1)
    # Effective degrees of freedom by Welch–Satterthwaite, all but the noise known without end.
    factor = [half_width(known.noise.dof * ratio**2) for ratio in (variance / scatter).tolist()]
    reach = np.array(factor) * np.sqrt(variance)
    columns = (posed.data, modelled, expected, reach)
    rows = zip(posed.which, *(column.tolist() for column in columns), strict=True)
    return tuple(
        PromisedDifference(
            name=which.name, measured_mm=was, modelled_mm=model, expected_mm=to_come, expanded_mm=u
        )
        for which, was, model, to_come, u in rows
    )


def stays(promised: Sequence[PromisedDifference]) -> bool:
    """Return whether more is left after the correction than its uncertainty allows for."""
    left = sum(row.expected_mm**2 for row in promised)
    return left > sum(row.expanded_mm**2 for row in promised)
