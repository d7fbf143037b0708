"""Numbers printed in the paper, for comparison with computed ones; nothing is derived from them.

A. Pashkevich, D. Chablat, P. Wenger, "Kinematic calibration of Orthoglide-type mechanisms from
observation of parallel leg motions". Where the print is wrong, the correction is stated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from orthoglide_cal.model.measured import DataKind

Six = tuple[float, float, float, float, float, float]
Offsets = tuple[float, float, float]


@dataclass(frozen=True)
class Experiment:
    """One experiment of Tables 4 and 5; lengths in mm."""

    measured: Six  # Δx_y, Δx_z, Δy_x, Δy_z, Δz_x, Δz_y (max − min)
    expected: Six  # expected improvement: measured minus modelled
    rms_before: float
    rms_after: float
    six_offsets: Offsets  # Δρ by the six-equation method (Table 5)
    twelve_offsets: Offsets
    twelve_rms: float


EXPERIMENTS: Mapping[int, Experiment] = MappingProxyType(
    {
        1: Experiment(  # Initial settings
            # Printed Δx_z = +1.58: only +1.48 gives the printed r.m.s., residuals and offsets.
            (0.52, 1.48, 2.37, -0.25, -0.57, -0.04),
            (-0.94, 0.63, 1.07, -0.84, -0.27, 0.35),
            1.19,
            0.74,
            (2.17, 1.69, -1.42),
            (2.07, 1.66, -1.30),
            0.75,
        ),
        2: Experiment(  # After mechanical tuning
            (-0.43, -0.37, 0.42, -0.18, -1.14, -0.70),
            (-0.28, 0.25, 0.21, -0.14, -0.13, 0.09),
            0.62,
            0.20,
            (-0.53, 0.59, -1.76),
            (-0.52, 0.55, -1.69),
            0.21,
        ),
        3: Experiment(  # After calibration
            (-0.23, 0.27, 0.34, -0.10, -0.09, 0.11),
            (-0.29, 0.23, 0.25, -0.17, -0.10, 0.08),
            0.21,
            0.20,
            (0.07, 0.14, 0.00),
            (0.12, 0.00, 0.10),
            0.21,
        ),
    }
)

# Table 3: (method, offset in mm) → std(Δρ) and its spread over 20 replications [mm].
TABLE_3: Mapping[tuple[DataKind, float], tuple[float, float]] = MappingProxyType(
    {
        (DataKind.SIX, 0.1): (0.0198, 0.0003),
        (DataKind.SIX, 1.0): (0.0199, 0.0002),
        (DataKind.TWELVE, 0.1): (0.0207, 0.0003),
        (DataKind.TWELVE, 1.0): (0.0207, 0.0004),
    }
)

# Sec. 3.5: σ_ρ/σ.
ACCURACY: Mapping[DataKind, float] = MappingProxyType({DataKind.SIX: 1.98, DataKind.TWELVE: 2.06})

TWELVE_NOT_REPRODUCIBLE = (
    "The twelve-equation rows of Table 5 cannot be recomputed: the twelve differences behind them"
    " were not published, only the six of Table 4."
)
