"""The three axes and their names, and the read-only arrays that frozen values hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

AXES = ("x", "y", "z")

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
# Real in use; complex only while a derivative is taken by a complex step.
Numbers = NDArray[Any]


def axis_index(name: str) -> int:
    """Index 0, 1, 2 of axis "x", "y", "z". Raises ValueError for any other name."""
    return AXES.index(name)


def read_only(values: Any, dtype: Any) -> NDArray[Any]:
    """A private copy of `values` that nobody can write to."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array
