"""The examples in the docstrings are true."""

import doctest

import pytest

from orthoglide_cal.outcome import rounding
from orthoglide_cal.report import numbers, sketch


@pytest.mark.parametrize("module", [rounding, numbers, sketch])
def test_examples(module):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0
