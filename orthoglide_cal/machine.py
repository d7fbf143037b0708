"""What is known of a machine before it is measured: nominal geometry, gauge, tolerances.

Everything here is a frozen value in mm; nothing reads files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from orthoglide_cal.axes import Floats


@dataclass(frozen=True)
class Gauge:
    """A dial indicator.

    Attributes:
        resolution_mm: smallest step that it shows.
        range_mm: travel of the plunger.
        revolution_mm: travel of one turn of the dial; None for a gauge without a dial.
        repeatability_mm: standard deviation of one reading as the maker or the last check states.
    """

    resolution_mm: float
    range_mm: float
    revolution_mm: float | None
    repeatability_mm: float

    @property
    def rounding_mm(self) -> float:
        """Standard deviation q/√12 that the resolution q alone gives to a reading [mm]."""
        return self.resolution_mm / math.sqrt(12.0)

    @property
    def noise_mm(self) -> float:
        """Standard deviation to expect of one reading: repeatability and rounding [mm]."""
        return math.hypot(self.repeatability_mm, self.rounding_mm)


@dataclass(frozen=True)
class Estimate:
    """A value with its standard deviation, in `unit` (the unit of the files)."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class IdentifiedCause:
    """A cause accepted for this machine, as it stands under `identified:` in the machine file.

    Attributes:
        id: cause id, e.g. "axis_gap".
        where: place of the cause ("" where the whole machine is meant).
        parameters: name → estimate, in the contract's unit.
        date: ISO date of acceptance.
        data_sha256: digest of the readings that it came from.
        correlation: of the parameters, rows in their order; empty if they are independent.
    """

    id: str
    where: str
    parameters: Mapping[str, Estimate]
    date: str
    data_sha256: str
    correlation: tuple[tuple[float, ...], ...] = ()

    def covariance(self, names: Sequence[str]) -> Floats:
        """Covariance of the parameters in the order of `names`, in the contract's unit."""
        order = [list(self.parameters).index(name) for name in names]
        correlation = np.array(self.correlation or np.eye(len(self.parameters)))
        stds = np.array([self.parameters[name].std for name in names])
        return np.asarray(np.outer(stds, stds) * correlation[np.ix_(order, order)])


@dataclass(frozen=True)
class Machine:
    """An Orthoglide-type machine: three actuated rails, three legs, one tool centre point.

    Attributes:
        name: for people.
        leg_length_mm: L, parallelogram length.
        parallelogram_width_mm: d.
        tool_offset_mm: r, from the leg's end C to the tool centre point.
        joint_limits_mm: (min, max) displacement from the isotropic posture (errata, eq. 2).
        workspace_mm: edge of the cube-like workspace.
        gauge: the indicator normally used on it.
        offsets_mm: joint offsets already active in the controller (x, y, z).
        tolerances: cause id → plausible size (one standard deviation, contract's unit).
        identified: causes accepted earlier; part of the model from then on.
    """

    name: str
    leg_length_mm: float
    parallelogram_width_mm: float
    tool_offset_mm: float
    joint_limits_mm: tuple[float, float]
    workspace_mm: float
    gauge: Gauge
    offsets_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tolerances: Mapping[str, float] = field(default_factory=dict)
    identified: tuple[IdentifiedCause, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "tolerances", MappingProxyType(dict(self.tolerances)))

    def displacement_mm(self, posture: str) -> float:
        """Displacement of the leg's own carriage at posture "iso", "max" or "min" [mm]."""
        low, high = self.joint_limits_mm
        return {"iso": 0.0, "max": high, "min": low}[posture]
