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
    """Unknowns of one source.

    Attributes:
        source: an `Origin` or a cause id.
        size: one standard deviation, in `unit`; None where the unknowns differ.
        unit: of the size; "" without one.
        assumed: True if nobody stated the size: a default.
        columns: what one standard deviation of each unknown adds to the data, shape (n, p) [mm].
        local: True for as many unknowns as readings, shared by neighbours: what is put down to
            them is not explained.
    """

    source: str
    size: float | None
    unit: str
    assumed: bool
    columns: Floats
    local: bool = False

    def reduced(self, matrix: Floats) -> Influence:
        """The same in data R·readings, R of shape (k, n)."""
        return replace(self, columns=matrix @ self.columns)
