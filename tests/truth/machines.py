"""Two machines and two gauges the truth simulator knows, and their machine-file text.

Lengths are in mm. The tolerances are one standard deviation of each cause, in the contract's units.
"""

from dataclasses import dataclass
from pathlib import Path
from string import Template

import yaml


def machine_file(name: str) -> tuple[Template, dict[str, float]]:
    """The machine file of a kind, open in what its machines differ in, and its tolerances."""
    text = (Path(__file__).parent / f"{name}.yaml").read_text(encoding="utf-8")
    return Template(text), yaml.safe_load(text)["tolerances"]


FILE, TOLERANCES = machine_file("orthoglide")

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
    return FILE.substitute(vars(gauge) | vars(machine))
