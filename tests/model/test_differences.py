"""Reductions of readings to the paper's differences, and contrasts that no gauge zero enters."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Difference
from orthoglide_cal.model.orthoglide import double_posture, reduction, single_posture
from orthoglide_cal.model.readings import Contact, GaugePlan, Posture, Series
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


@pytest.mark.parametrize(
    ("kind", "posture", "ends"),
    [
        (DataKind.SIX, None, ((60.0, Contact.FIXED), (-100.0, Contact.FIXED))),
        (DataKind.TWELVE, Posture.MAX, ((60.0, Contact.FIXED), (0.0, Contact.FIXED))),
        (DataKind.TWELVE, Posture.MIN, ((-100.0, Contact.FIXED), (0.0, Contact.FIXED))),
        (DataKind.SINGLE, Posture.ISO, ((0.0, Contact.TOOL), (0.0, Contact.JOINT))),
        (DataKind.SINGLE, Posture.MIN, ((-100.0, Contact.TOOL), (-100.0, Contact.JOINT))),
    ],
)
def test_what_each_difference_subtracts(
    kind: DataKind, posture: Posture | None, ends: tuple[tuple[float, Contact], ...]
) -> None:
    """Max − min, that posture − iso, tool end − joint end: means of repeats."""
    series, plan = Series(2, 1), double_posture(PROTOTYPE)
    if kind is DataKind.SINGLE:
        series, plan = Series(0, 2), single_posture(PROTOTYPE, 3)
    values = np.random.default_rng(5).normal(0.0, 1.0, len(plan))
    first, second = (
        values[plan.of(series) & (plan.displacement == moved) & (plan.contact == contact)].mean()
        for moved, contact in ends
    )
    (row,) = reduction(kind, (Difference(series, posture),), PROTOTYPE, plan)
    assert row @ values == pytest.approx(first - second, abs=1e-15)


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
