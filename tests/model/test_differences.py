"""Reductions of readings to the paper's differences, and contrasts that no gauge zero enters."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Difference
from orthoglide_cal.model.orthoglide import double_posture, reduction
from orthoglide_cal.model.readings import GaugePlan, Posture, Series
from tests.machines import PROTOTYPE

OFFSETS = np.array([0.4, -0.9, 0.6])
NAMES = {
    DataKind.SIX: "dx_y dx_z dy_x dy_z dz_x dz_y",
    DataKind.TWELVE: "dx_y+ dx_y- dx_z+ dx_z- dy_x+ dy_x- dy_z+ dy_z- dz_x+ dz_x- dz_y+ dz_y-",
    DataKind.SINGLE: "dz_x0 dz_y0 dz_x+ dz_x- dz_y+ dz_y-",
}


@pytest.mark.parametrize("kind", NAMES)
def test_differences_are_named_as_the_paper_prints_them(kind: DataKind) -> None:
    """Direction first, leg second, in the order of Table 4."""
    assert [difference.name for difference in DIFFERENCES[kind]] == NAMES[kind].split()


def test_readings_of_different_set_ups_are_never_subtracted() -> None:
    """Max in one set-up, min in another: no difference; both in some: their mean."""
    plan = double_posture(PROTOTYPE, cycles=3, closing=False, postures=(Posture.MAX, Posture.MIN))
    apart = replace(plan, setup=np.arange(len(plan)))
    wanted = DIFFERENCES[DataKind.SIX]
    assert not reduction(DataKind.SIX, wanted, PROTOTYPE, apart).any()
    # The gauge along y on leg x is set up three times: for max alone, for both, for both.
    mine = np.flatnonzero(plan.of(Series(0, 1)))
    setup = plan.setup.copy()
    setup[mine] = [6, 7, 7, 7, 8, 8]
    values = np.random.default_rng(6).normal(0.0, 1.0, len(plan))
    values[mine] = [100.0, -5.0, 3.0, -7.0, 4.0, -2.0]
    again = GaugePlan(**{**vars(plan), "setup": np.unique(setup, return_inverse=True)[1]})
    row = reduction(DataKind.SIX, (Difference(Series(0, 1)),), PROTOTYPE, again)[0]
    assert row @ values == pytest.approx(((3.0 - (-6.0)) + (4.0 - (-2.0))) / 2.0)
