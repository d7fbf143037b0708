"""A p value is judged by the same losses as a probability."""

import numpy as np
import pytest

from orthoglide_cal.estimation.losses import is_likely, surprising


@pytest.mark.parametrize("odds", [0.01, 0.05, 0.2])
def test_to_state_nothing_costs_as_much_as_to_give_it_up(odds: float) -> None:
    """At the bound, with the most that a p value can say against its null hypothesis."""
    missed, needless = 75.0, 120.0
    p = surprising(odds, missed, needless)
    for share, given_up in ((0.99, True), (1.01, False)):
        against = float(odds / (-np.e * share * p * np.log(share * p)))
        assert is_likely(1.0 / (1.0 + against), missed, needless) is given_up
