"""From what was measured to joint offsets, how sure they are, and whether the model fits.

And the promise: what the gauges will read once they are entered. Computed here and only here.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from pydantic import Field

from orthoglide_cal.causes import UNLISTED
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation.accuracy import (
    Scatter,
    chance_of_residual,
    half_width,
    require_determined,
    require_optimum,
    require_rank,
    rms,
)
from orthoglide_cal.estimation.budget import Budget, budget_of, fixed_influences, influences
from orthoglide_cal.estimation.gaussian import unexplained
from orthoglide_cal.estimation.losses import MISSED_FAULT, NEEDLESS_HOLD, surprising
from orthoglide_cal.estimation.methods import (
    OPTIMAL,
    Method,
    Problem,
    choose_method,
    fit_offsets,
    pose,
    simulate_at,
    table_kind,
)
from orthoglide_cal.model.cause import Effect
from orthoglide_cal.model.contrasts import without_zeros
from orthoglide_cal.model.machine import Origin
from orthoglide_cal.model.measured import DataKind, Differences, Measured, Readings, notes_on
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats, ReadOnly, read_only
from orthoglide_cal.schema import Reason, Schema

# Below this chance the residuals are called larger than the gauge's noise.
SUSPICIOUS = surprising(UNLISTED / (1.0 - UNLISTED), MISSED_FAULT, NEEDLESS_HOLD)
# Nobody measures twice at the same pace: standard deviation of its ratio, assumed.
PACE = 0.1


@dataclass(frozen=True, eq=False)
class OffsetEstimate(ReadOnly):
    """The parameters of a machine as readings know them, and that machine."""

    model: Model  # the machine and its accepted causes, with their uncertainty
    offsets_mm: Floats  # that the controller does not know yet, shape (p,)
    budget: Budget  # where their uncertainty comes from
    noise: Scatter  # of one reading


@dataclass(frozen=True, eq=False)
class Solution(OffsetEstimate):
    """Joint offsets Δρ identified from one file; true joint position = indicated + Δρ."""

    measured: Measured
    method: Method
    problem: Problem  # that was solved
    data: Floats  # its data, shape (k,) [mm]
    residuals_mm: Floats  # what the solver left of the data it compared, shape (k,)
    scatter: Scatter | None  # of one reading, from the residuals; None without degrees of freedom
    stated_mm: float  # of one reading, as stated, with what of a local shape is too fine to show

    @property
    def sigma_residuals_mm(self) -> float | None:
        """Standard deviation of one reading from the residuals; None without degrees of freedom."""
        return None if self.scatter is None else self.scatter.sigma_mm

    @property
    def dof(self) -> int:
        """Degrees of freedom of it (effective ones, rounded)."""
        return 0 if self.scatter is None else round(self.scatter.dof)

    @property
    def lack_of_fit_p(self) -> float:
        """Probability of a residual this large from noise alone; 1 without degrees of freedom."""
        if self.scatter is None:
            return 1.0
        sum_of_squares = self.scatter.dof * self.scatter.sigma_mm**2
        return chance_of_residual(sum_of_squares, self.scatter.dof, self.stated_mm)

    @cached_property
    def _fit(self) -> tuple[float, Floats]:
        """r.m.s. before, and what is predicted for each entry of the file.

        Of readings about the model with fitted gauge zeros; else of the differences that the
        method uses, as in Table 4.
        """
        measured, model = self.measured, self.model
        if isinstance(measured, Differences):
            every, _ = pose(measured, model, measured.kind)
            order = [every.which.index(difference) for difference in measured.which]
            return rms(self.data), read_only(every.predict(self.offsets_mm)[order])
        plan, points = measured.plan, (0.0 * self.offsets_mm, self.offsets_mm)
        simulated = np.stack([simulate_at(model, x, plan)[0] for x in points])
        before, after = without_zeros(plan, measured.value - simulated)
        # Of readings that are less precise than most, as much less counts.
        return rms(plan.precision * before), read_only(measured.value - after)

    @property
    def predicted_mm(self) -> Floats:
        """For each entry of the file, with fitted gauge zeros, shape (count,) [mm]."""
        return self._fit[1]

    @property
    def rms_before_mm(self) -> float:
        """Root mean square of the data with zero offsets."""
        return self._fit[0]

    @property
    def rms_after_mm(self) -> float:
        """Root mean square of the residuals."""
        if isinstance(self.measured, Differences):
            return rms(self.residuals_mm)
        return rms(self.measured.plan.precision * (self.measured.value - self.predicted_mm))

    def require_possible(self) -> None:
        """Refuse offsets that no machine has, or of which nobody knows what they are added to.

        Raises UnusableResultError, with what to check.
        """
        require_settings(self.measured)
        machine, largest = self.model.machine, float(np.abs(self.offsets_mm).max())
        if not _possible(self.offsets_mm, self.model):
            require_determined(self.problem)
            raise UnusableResultError(
                f"The {machine.vocabulary.many} would be as large as {largest:.0f} mm, more than"
                " half of the travel.",
                "Check the unit and the decimal marks of the readings, and the machine file.",
            )

    def at(self, offsets: Floats) -> "Solution":
        """The same model at other offsets, shape (3,) [mm], with what they leave."""
        left = self.data - self.problem.predict(offsets)
        return replace(self, offsets_mm=offsets, residuals_mm=left)

    @property
    def warnings(self) -> tuple[Reason, ...]:
        """Remarks on the data."""
        gauge, scatter = self.model.machine.instrument, self.sigma_residuals_mm
        remarks = (*gauge.doubts(self.measured), *notes_on(self.measured))
        if scatter is None or scatter >= gauge.rounding_mm:
            return remarks
        return (*remarks, Reason.of("below_resolution", floor_mm=gauge.rounding_mm))

    @cached_property
    def converged(self) -> bool:
        """True if the offsets are the optimum of the data held here, recomputed; a NaN is no.

        A nonlinear method: by the step that it would still take. A linear one: by what its own
        estimator finds in its residual.
        """
        problem = self.problem
        if not self.method.linear:
            return bool(problem.remaining(self.data, self.offsets_mm) <= OPTIMAL)
        predicted, jacobian = problem.at_zero
        left = self.data - predicted - jacobian @ self.offsets_mm
        left = self.method.estimator(problem) @ left / self.budget.std_mm
        return bool(np.abs(left).max() <= OPTIMAL)


def solve(measured: Measured, model: Model, method: str | None = None) -> Solution:
    """Identify the joint offsets; as `fit_parameters` and `Solution.require_possible`."""
    solution = fit_parameters(measured, model, method)
    solution.require_possible()
    return solution


def fit_parameters(
    measured: Measured, model: Model, method: str | None = None, offsets: Floats | None = None
) -> Solution:
    """Fit the joint offsets, whatever their size.

    All readings at once are weighted by what is uncertain of them in addition to noise, such as
    where along its leg each gauge stands; the paper's methods are as the paper has them.

    Args:
        measured, model: the data, and what they are of.
        method: name of an estimator; the default for this kind of data if None.
        offsets: those that fit all readings best without those weights, shape (3,) [mm]; they are
            searched for if None.

    Raises:
        UsageError: the method does not exist or cannot use these data.
        UnusableResultError: the data do not determine the offsets, with what to add; or no optimum
            was found.
    """
    chosen = choose_method(measured, method)
    problem, data = pose(measured, model, chosen.uses)
    require_rank(problem)
    plain, all_data = problem, data  # without weights
    if chosen.linear:
        # At zero offsets every gauge of the nominal machine reads zero; known causes do not.
        predicted, at_zero = problem.at_zero
        shifted, estimator = data - predicted, chosen.estimator(problem)
        offsets = estimator @ shifted
        residuals = shifted - at_zero @ offsets
    elif offsets is None:
        offsets = _search(problem, data)
    plan, gauge = problem.plan, model.machine.instrument
    uncertain = influences(model, offsets, plan)
    # Causes that were fitted to these very data are not uncertain in addition to their noise: id →
    # number of parameters.
    here = {
        effect.cause.id: int(np.count_nonzero(effect.std))
        for effect in model.accepted
        if effect.data_sha256 == measured.source.sha256
    }
    left = [influence for influence in uncertain if influence.source not in here]
    stated_mm = math.hypot(gauge.noise_mm, math.sqrt(sum(one.rest for one in left)))
    ratios = [(one.source, one.columns / stated_mm) for one in left]
    # Offsets that no machine has need no weights to be refused.
    if chosen is Method.READINGS and _possible(offsets, model):
        problem = problem.weighted(problem.matrix @ np.hstack([ratio for _, ratio in ratios]))
        data = problem.matrix @ measured.value
        offsets = _search(problem, data, offsets)
    readings, jacobian = simulate_at(model, offsets, plan)
    if not chosen.linear:
        residuals = data - problem.matrix @ readings
        estimator = np.asarray(np.linalg.pinv(problem.matrix @ jacobian), np.float64)
    # Noise of one reading is what no offsets explain, of raw data in all readings, whatever the
    # method; what a cause of the machine would explain is none.
    if isinstance(measured, Readings) and problem.which:
        plain, all_data = pose(measured, model, DataKind.READINGS)
    hidden = set(model.machine.unobservable) - {effect.cause.id for effect in model.accepted}
    ratio = np.hstack([ratio for source, ratio in ratios if source not in hidden])
    # What was fitted to these very readings took its part of their noise away.
    dof = len(all_data) - len(offsets) - sum(here.values())
    scatter, noise, matrix = None, Scatter(stated_mm, math.inf), plain.matrix
    if dof > 0:
        residual, slopes = all_data - matrix @ readings, matrix @ jacobian
        # Generalised least squares: rᵀ Λᵀ P Λ r with (ΛᵀΛ)⁻¹ = G + C Cᵀ/σ², of C what influences
        # add, and P the projector onto what the offsets cannot explain. Whichever estimator left
        # the residual, it is the same.
        left_over = unexplained(*plain.whitened(matrix @ ratio, slopes, residual))
        scatter = Scatter(math.sqrt(left_over @ left_over / dof), dof)
        noise = Scatter(max(scatter.sigma_mm, gauge.rounding_mm), dof)
    uncertain = (*uncertain, *fixed_influences(model, offsets, plan))
    return Solution(
        model=model,
        offsets_mm=offsets,
        budget=budget_of(estimator @ problem.matrix, gauge, scatter, uncertain, plan.precision),
        noise=noise,
        measured=measured,
        method=chosen,
        problem=problem,
        data=data,
        residuals_mm=residuals,
        scatter=scatter,
        stated_mm=stated_mm,
    )


def _possible(offsets: Floats, model: Model) -> bool:
    """True unless a carriage is half of its travel from where it seems to be: it could not move."""
    return float(np.abs(offsets).max()) <= model.machine.travel_mm / 2.0


def require_settings(measured: Measured) -> None:
    """Raise UnusableResultError if nobody knows the settings with which it was measured."""
    if (excerpt := measured.source.excerpt) and excerpt.unknown:
        remedy = "Copy it from the printer (/sys). If there is none, delete M501 from this copy."
        raise UnusableResultError(excerpt.unknown, remedy)


def _search(problem: Problem, data: Floats, start: Floats | None = None) -> Floats:
    """The offsets of one data set by least squares, (3,). Raises UnusableResultError."""
    fit = fit_offsets(problem, data, start)
    require_optimum(problem, fit)
    return fit.offsets_mm


class PromisedDifference(Schema):
    """One difference of readings (Table 4 of the paper)."""

    name: str
    measured_mm: float
    modelled_mm: float
    expected_mm: float = Field(description="after the parameters are entered")
    expanded_mm: float = Field(description="U of the expected value, as many new readings included")


def promise(
    measured: Measured,
    known: OffsetEstimate,
    entered: Floats,
    right: Measured | None = None,
    corrected: Iterable[Effect] = (),
    unsure_mm: Floats | float = 0.0,
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
        unsure_mm: standard deviation of each reading besides its noise, shape (n,).
    """
    if all(kind is DataKind.READINGS for kind in measured.kinds):
        return ()  # no differences of the paper can be made of these data
    kind = table_kind(measured)
    problem, data = pose(measured, known.model, kind)
    kept = data if right is None else pose(right, known.model, kind)[1]
    after = known.offsets_mm - entered
    both = np.stack((known.offsets_mm, after))
    modelled, first = problem.predict_with_jacobian(known.offsets_mm)
    later = replace(problem, model=known.model.extended(corrected))
    left, second = later.predict_with_jacobian(after)
    expected = kept + left - modelled
    # The same readings are taken once before and once after.
    scatter = 2.0 * known.noise.sigma_mm**2 * np.diag(problem.covariance())
    scatter += 2.0 * ((np.asarray(problem.matrix) * unsure_mm) ** 2).sum(axis=1)
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
    rows = np.stack((data, modelled, expected, reach), axis=1).tolist()
    names = ("measured_mm", "modelled_mm", "expected_mm", "expanded_mm")
    return tuple(
        PromisedDifference(name=which.name, **dict(zip(names, row, strict=True)))
        for which, row in zip(problem.which, rows, strict=True)
    )


def exceeds_u(promised: Sequence[PromisedDifference]) -> bool:
    """Return whether more is left after the correction than its uncertainty allows for."""
    left = sum(row.expected_mm**2 for row in promised)
    return left > sum(row.expanded_mm**2 for row in promised)
