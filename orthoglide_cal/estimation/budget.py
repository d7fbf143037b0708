"""The uncertainty budget of the joint offsets (GUM): every source, its size, and what it adds.

Sources are independent of each other, so their covariances add up; the expanded uncertainty is
U = k·u with Student's t of the effective degrees of freedom (Welch–Satterthwaite, GUM G.4).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Container, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, computed_field
from scipy.special import stdtrit

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.gaussian import root_of
from orthoglide_cal.model.machine import Influence, Instrument, Origin
from orthoglide_cal.model.model import CONFIDENCE, Model, differentiate_absent, simulate
from orthoglide_cal.model.plan import Floats, Plan, read_only
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.schema import Schema


@dataclass(frozen=True)
class Scatter:
    """A standard deviation of one reading [mm] and its (effective) degrees of freedom."""

    sigma_mm: float
    dof: float


def half_width(dof: float, confidence: float = CONFIDENCE) -> float:
    """Student-t factor of a two-sided interval; the normal one for infinite dof."""
    below = 0.5 + confidence / 2.0
    return NormalDist().inv_cdf(below) if dof == math.inf else float(stdtrit(dof, below))


class Contribution(Schema):
    """Share of one source in the uncertainty of the parameters."""

    source: str = Field(description="an origin or a cause id")
    # How its size is known (GUM 4): from the scatter of these readings, or otherwise.
    type: Literal["A", "B"]
    size: float | None = Field(description="its standard uncertainty, in `unit`")
    unit: str = Field(description='of the size; "" without one')
    assumed: bool = Field(False, description="nobody stated its size")
    # Of the parameters, from this source alone, shape (p, p).
    covariance_mm2: Floats = Field(exclude=True)
    # Degrees of freedom of its size; infinite for type B.
    dof: float = Field(math.inf, exclude=True, allow_inf_nan=True)
    possible: bool = Field(False, description="may be there or not")

    @classmethod
    def of(
        cls, source: str, moved: Floats, size: float | None = None, unit: str = "", **more: Any
    ) -> Self:
        """Take a source of which one σ of each unknown moves the parameters, (p, q); of type B."""
        fields: dict[str, Any] = {"type": "B", "size": size, "unit": unit, **more}
        return cls(source=source, covariance_mm2=read_only(moved @ moved.T), **fields)

    @classmethod
    def beyond(cls, source: str, covariance: Floats, possible: bool = False) -> Self:
        """Remainder of a covariance (p, p) besides other sources; never negative."""
        return cls.of(source, root_of(covariance), possible=possible)

    @computed_field(description="what it adds to each parameter's std")
    @property
    def std(self) -> tuple[float, ...]:
        return tuple(np.sqrt(np.maximum(self.covariance_mm2.diagonal(), 0.0)).tolist())


@dataclass(frozen=True)
class Budget:
    """All contributions, at least one."""

    contributions: tuple[Contribution, ...]

    def without(self, sources: Container[str]) -> Budget:
        return Budget(tuple(part for part in self.contributions if part.source not in sources))

    def extended(self, more: Iterable[Contribution]) -> Budget:
        return replace(self, contributions=(*self.contributions, *more))

    @cached_property
    def covariance_mm2(self) -> Floats:
        """Covariance of the offsets from all sources, shape (3, 3)."""
        return read_only(sum(part.covariance_mm2 for part in self.contributions))

    @property
    def std_mm(self) -> Floats:
        """Combined standard uncertainties u, shape (3,) [mm]."""
        return np.sqrt(self.covariance_mm2.diagonal())

    @cached_property
    def dof(self) -> float:
        """Effective degrees of freedom u⁴/Σ(uᵢ⁴/νᵢ), of the offset that has the fewest."""
        spent = sum(p.covariance_mm2.diagonal() ** 2 / p.dof for p in self.contributions)
        worst = float(np.max(spent / self.covariance_mm2.diagonal() ** 2))
        return 1.0 / worst if worst > 0.0 else math.inf

    @cached_property
    def k(self) -> float:
        """Coverage factor, U/u."""
        return half_width(self.dof)

    @property
    def expanded_mm(self) -> Floats:
        """Expanded uncertainties U, shape (3,) [mm]."""
        return self.k * self.std_mm

    @property
    def largest(self) -> Contribution:
        """The source that adds most to the three offsets together."""
        return max(self.contributions, key=lambda part: float(np.trace(part.covariance_mm2)))


def budget_of(
    estimator: Floats,
    gauge: Instrument,
    scatter: Scatter | None,
    uncertain: Iterable[Influence],
    precision: Floats | float = 1.0,
) -> Budget:
    """The budget of offsets that a linear estimator (3, n) makes of readings, of precision (n,).

    The scatter is that of one reading, as found; None takes what is stated of the gauge.
    """
    moved, rounding = estimator / precision, gauge.rounding_mm
    evaluation, noise2, dof, dof_of_rounding = "B", gauge.repeatability_mm**2, math.inf, math.inf
    if scatter is not None:
        evaluation, noise2 = "A", max(scatter.sigma_mm**2 - rounding**2, 0.0)
        # The scatter holds the rounding, too; what is left of it is known no better. Rounding in
        # place of a smaller scatter is known no better than that.
        if noise2 > 0.0:
            dof = scatter.dof * (noise2 / scatter.sigma_mm**2) ** 2
        else:
            dof_of_rounding = scatter.dof
    size, of = math.sqrt(noise2), Contribution.of
    parts = [
        of(Origin.NOISE, size * moved, size, "mm", type=evaluation, dof=dof),
        of(Origin.RESOLUTION, rounding * moved, rounding, "mm", dof=dof_of_rounding),
    ]
    for one in uncertain:
        shift = estimator @ one.columns
        parts.append(of(one.source, shift, one.size, one.unit, assumed=one.assumed))
    return Budget(tuple(parts))


# Of steel; the legs of other machines may differ, which is why the size is an assumed one.
EXPANSION_PER_K = 11.5e-6
REFERENCE_C = 20.0  # ISO 1


def warmth(mean_c: float | None, length_mm: float) -> tuple[Contribution, ...]:
    """Contribution of a mean temperature off the reference [°C]; none if it is unknown.

    The legs L [mm] grow by α·L per kelvin and so do the rails; how much of it is left over between
    the two is not known: anything up to all of it (rectangular).
    """
    if mean_c is None:
        return ()
    kelvin = abs(mean_c - REFERENCE_C)
    std = EXPANSION_PER_K * length_mm * kelvin / math.sqrt(3.0)
    return (Contribution.of(Origin.TEMPERATURE, np.full((len(AXES), 1), std), kelvin, "K"),)


def influences(model: Model, offsets: Floats, plan: Plan) -> tuple[Influence, ...]:
    """Unknowns of plausible size in n readings besides noise; hardly any reading shows them.

    They are unknowns of every fit, as the gauges' zeros are. At offsets Δρ (..., 3) [mm], of
    columns (..., n, p); machine and gauge give the sizes, accepted causes their own uncertainty.
    """
    return _influences(model, offsets.shape, offsets.tobytes(), plan)


@functools.lru_cache(maxsize=8)  # a solution begins where a diagnosis asked for them
def _influences(
    model: Model, shape: tuple[int, ...], point: bytes, plan: Plan
) -> tuple[Influence, ...]:
    offsets = np.frombuffer(point).reshape(shape)
    readings, hidden = plausible_causes(model.machine.unobservable, model, offsets, plan)
    gauges = model.machine.uncertain(
        plan, lambda other: readings if other is plan else simulate(model, offsets, other)
    )
    acting = [*gauges, *hidden]
    for k, effect in enumerate(model.accepted):
        # Its parameters, moved by one standard deviation along each of their uncertainties.
        theta = effect.theta + np.expand_dims(effect.spread, tuple(range(1, offsets.ndim)))
        moved = (*model.accepted[:k], replace(effect, theta=theta), *model.accepted[k + 1 :])
        change = simulate(replace(model, accepted=moved), offsets, plan) - readings
        # What has no uncertainty changes nothing, in no column.
        change = np.broadcast_to(change, (len(effect.spread), *readings.shape))
        acting.append(Influence(effect.cause.id, None, "", False, np.moveaxis(change, 0, -1)))
    if offsets.ndim == 1:
        return tuple(acting)
    # What does not depend on the offsets is the same at all of them.
    pairs = zip(acting, ((*shape[:-1], *one.columns.shape[-2:]) for one in acting), strict=True)
    return tuple(replace(one, columns=np.broadcast_to(one.columns, s)) for one, s in pairs)


def fixed_influences(model: Model, offsets: Floats, plan: Plan) -> tuple[Influence, ...]:
    """Causes taken as the controller has it, although nobody knows it exactly.

    A diagnosis may contradict it; the parameters found have its uncertainty in any case.
    """
    return tuple(plausible_causes(model.machine.fixed_parameters, model, offsets, plan)[1])


def plausible_causes(
    ids: Iterable[str], model: Model, offsets: Floats, plan: Plan
) -> tuple[Floats, list[Influence]]:
    """Readings (..., n) [mm], and causes at plausible size; not those that the model knows of."""
    machine = model.machine
    known = {effect.cause.id for effect in model.accepted}
    causes = [CAUSES[id] for id in ids if id not in known and CAUSES[id].size(machine) > 0.0]
    readings, (_, *jacobians) = differentiate_absent(model, offsets, plan, causes)
    hidden = [
        Influence(
            cause.id,
            cause.size(machine),
            cause.unit,
            cause.assumed(machine),
            derivatives * cause.prior_std(machine),
        )
        for cause, derivatives in zip(causes, jacobians, strict=True)
    ]
    return readings, hidden
