"""What is shown of a file of differences stands in the order of that file."""

import numpy as np

from orthoglide_cal.data import default_machine
from orthoglide_cal.diagnosis import diagnose
from orthoglide_cal.measured import Differences, Source
from orthoglide_cal.protocols import SIX
from orthoglide_cal.published import EXPERIMENTS


def test_pictures_follow_the_file() -> None:
    names = SIX
    values = dict(zip(names, EXPERIMENTS[2].measured, strict=True))
    turned = names[::-1]
    machine = default_machine()
    straight, reverse = (
        diagnose(
            Differences("six", order, np.array([values[n] for n in order]), Source("-", "")),
            machine,
        )
        for order in (names, turned)
    )
    assert straight.measured_mm.tolist() == [values[n] for n in names]
    assert reverse.measured_mm.tolist() == [values[n] for n in turned]
    np.testing.assert_allclose(reverse.nominal_mm[::-1], straight.nominal_mm, atol=1e-9)
    np.testing.assert_allclose(reverse.explained_mm[::-1], straight.explained_mm, atol=1e-6)
    assert np.ptp(straight.nominal_mm) > 0.5
