"""What readings hold besides noise: what nobody knows exactly, and hardly any reading shows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

from orthoglide_cal.model.plan import Floats, ReadOnly


class Origin(StrEnum):
    """Sources that are no causes; those are named by their cause id."""

    NOISE = "noise"
    RESOLUTION = "resolution"
    GAUGE_SCALE = "gauge_scale"
    GAUGE_PLACEMENT = "gauge_placement"
    BED_TEXTURE = "bed_texture"
    TEMPERATURE = "temperature"
    EXPLANATIONS = "explanations"  # that the data leave open


@dataclass(frozen=True, eq=False)
class Influence(ReadOnly):
    """Unknowns of one source."""

    source: str  # an `Origin` or a cause id
    size: float | None  # one standard deviation, in `unit`; None where the unknowns differ
    unit: str  # "" without one
    assumed: bool  # nobody stated the size: a default
    columns: Floats  # what one standard deviation of each adds to the data, shape (n, p) [mm]
    # As many unknowns as readings, shared by neighbours: what is put down to them is not explained.
    local: bool = False

    def reduced(self, matrix: Floats) -> Influence:
        """The same in data R·readings, R of shape (k, n)."""
        return replace(self, columns=matrix @ self.columns)
