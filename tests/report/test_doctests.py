"""The examples in the docstrings are true."""

import doctest

import pytest

from orthoglide_cal import errors
from orthoglide_cal.estimation import accuracy
from orthoglide_cal.report import canvas, words


@pytest.mark.parametrize("module", [accuracy, canvas, errors, words])
def test_examples(module):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0
