"""The examples in the docstrings are true."""

import doctest

import pytest

from orthoglide_cal import errors, words
from orthoglide_cal.report import facts, figures


@pytest.mark.parametrize("module", [errors, facts, figures, words])
def test_examples(module):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0
