"""Two machines and two gauges the truth simulator knows, and their machine-file text.

Lengths are in mm. The tolerances are one standard deviation of each cause, in the contract's units.
"""

from dataclasses import dataclass

TOLERANCES: dict[str, float] = {
    "axis_gap": 0.3,
    "axis_squareness": 1.0,
    "leg_length": 0.01,
    "encoder_scale": 1.0,
    "backlash": 0.02,
    "thermal_drift": 0.05,
    "bar_skew": 1.0,
    "gauge_drift": 0.05,
    "stand_shift": 0.1,
    "gauge_slip": 1.0,
    "misread": 0.1,
    "sign_flip": 1.0,
    "swapped_gauges": 1.0,
    "exchanged_columns": 1.0,
    "wrong_unit": 1.0,
}


# Standard deviations that a machine file need not state: of a stand's place along the leg [mm], and
# of a gauge's scale.
PLACEMENT = 1.0
SCALE = 0.001


@dataclass(frozen=True)
class Gauge:
    """One kind of dial indicator; all lengths in mm."""

    name: str
    resolution: float
    noise: float
    range: float
    revolution: float

    @property
    def sigma(self) -> float:
        """Standard deviation of one reading [mm]: repeatability and rounding together."""
        return float((self.noise**2 + self.resolution**2 / 12.0) ** 0.5)

    @property
    def decimals(self) -> int:
        """How many decimals of a millimetre its readings have."""
        return 3 if self.resolution < 0.005 else 2


@dataclass(frozen=True)
class Machine:
    """Nominal dimensions [mm]; limits are displacements from the isotropic posture, the workspace
    is the edge of a cube."""

    name: str
    leg: float
    width: float
    tool: float
    lower: float
    upper: float
    workspace: float


MICRON = Gauge("micron", resolution=0.001, noise=0.003, range=12.0, revolution=1.0)
DIAL = Gauge("dial", resolution=0.01, noise=0.006, range=10.0, revolution=1.0)
PROTOTYPE = Machine("prototype", 310.25, 80.0, 31.0, -100.0, 60.0, 200.0)
LARGE = Machine("large", 420.0, 110.0, 45.0, -140.0, 90.0, 270.0)

GAUGES: dict[str, Gauge] = {g.name: g for g in (MICRON, DIAL)}
MACHINES: dict[str, Machine] = {m.name: m for m in (PROTOTYPE, LARGE)}


def machine_yaml(machine: Machine, gauge: Gauge) -> str:
    """The machine file (schema_version 1) that states this machine, gauge and the tolerances."""
    sizes = "\n".join(f"  {cause}: {size}" for cause, size in TOLERANCES.items())
    return f"""\
schema_version: 1
name: truth-{machine.name}
leg_length_mm: {machine.leg}
parallelogram_width_mm: {machine.width}
tool_offset_mm: {machine.tool}
joint_limits_mm: [{machine.lower}, {machine.upper}]
workspace_mm: {machine.workspace}
gauge:
  resolution_mm: {gauge.resolution}
  range_mm: {gauge.range}
  revolution_mm: {gauge.revolution}
  repeatability_mm: {gauge.noise}
offsets_mm: {{x: 0.0, y: 0.0, z: 0.0}}
tolerances:
{sizes}
"""
