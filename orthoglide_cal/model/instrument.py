"""What reads: a gauge on a leg, or the probe of a printer, with what is stated of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from orthoglide_cal.schema import Number, Schema, told

# Where the machine file says nothing of a gauge: a stand put by eye or with a rule is within a
# millimetre or so; dial indicators may be off by 15 µm in 10 mm, and a plunger that leans by 2°
# reads 0.06 % short.
PLACEMENT_MM = 1.0
SCALE_U = 0.001
# Where it says nothing of a calliper: it shows hundredths, but is put to edges that were printed.
CALLIPER_MM = 0.06
# Where it says nothing of a bed: foil, glue and magnets under a plate.
TEXTURE_MM = 0.02

Fine = Annotated[Number, Field(ge=1e-6, le=100.0)]
Travel = Annotated[Number, Field(ge=1e-3, le=1e3)]
Step = Annotated[Number, Field(ge=0.0, le=10.0)]


class Instrument(Schema):
    """What is known of any gauge or probe; each declares it in the order of the machine file."""

    if TYPE_CHECKING:
        resolution_mm: float
        repeatability_mm: float

    @property
    def travel_mm(self) -> float:
        """The largest difference of two of its readings [mm]."""
        return math.inf

    @property
    def rounding_mm(self) -> float:
        """Standard deviation q/√12 that the resolution q alone gives to a reading [mm]."""
        return self.resolution_mm / math.sqrt(12.0)

    @property
    def noise_mm(self) -> float:
        """Standard deviation to expect of one reading: repeatability and rounding [mm]."""
        return math.hypot(self.repeatability_mm, self.rounding_mm)


class Gauge(Instrument):
    """A dial indicator."""

    resolution_mm: Annotated[Fine, told("Gauge: one division", "the smallest step that it shows")]
    range_mm: Annotated[Travel, told("Gauge: range", "travel of its plunger")]
    revolution_mm: Annotated[
        Travel | None,
        told("Gauge: one turn", "travel of one turn; 0 without a dial"),
    ] = None
    repeatability_mm: Annotated[
        Fine, told("Gauge: repeatability", "standard deviation of one reading")
    ]
    # How well its stand is put at its place along the leg, one standard deviation, and standard
    # uncertainty of its scale (1); None if nobody stated it.
    placement_mm: Annotated[Number, Field(ge=0.0, le=1e3)] | None = None
    scale_u: Annotated[Number, Field(ge=0.0, le=1.0)] | None = None

    @property
    def travel_mm(self) -> float:
        return self.range_mm

    @property
    def placement_std_mm(self) -> float:
        """`placement_mm`, or its default."""
        return PLACEMENT_MM if self.placement_mm is None else self.placement_mm

    @property
    def scale_std(self) -> float:
        """`scale_u`, or its default."""
        return SCALE_U if self.scale_u is None else self.scale_u


class Probe(Instrument):
    """The probe of a printer, its bed, and the calliper for what it printed."""

    resolution_mm: Annotated[Step, told("Probe: resolution", "the smallest step that it resolves")]
    repeatability_mm: Annotated[
        Annotated[Number, Field(ge=1e-6, le=10.0)],
        told("Probe: repeatability", "standard deviation of one touch"),
    ]
    calliper_mm: Annotated[
        Annotated[Number, Field(ge=1e-6, le=10.0)],
        told("Calliper", "standard deviation of a distance on a printed object"),
    ] = CALLIPER_MM
    # Standard deviation of the local shape of the bed; None if nobody stated it.
    texture_mm: Step | None = None
    scanning: bool = False  # it reads while it moves

    @property
    def texture_std_mm(self) -> float:
        """`texture_mm`, or its default."""
        return TEXTURE_MM if self.texture_mm is None else self.texture_mm
