"""The same data under the same model are decided once in a process, whichever tests ask.

A decision is a pure function of them, which `tests.inference.test_verdicts` asserts of `decide`.
A test that replaces a part of the inference calls `decide` itself.
"""

import functools
import importlib
from collections.abc import Hashable
from dataclasses import fields

import numpy as np

from orthoglide_cal.inference.belief import Belief
from orthoglide_cal.inference.data import Whitened
from orthoglide_cal.inference.decision import Decision, decide, decide_by
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import ReadOnly

KEPT = 50
_decisions: dict[Hashable, Decision] = {}


def content(value: object) -> Hashable:
    """A key of a value: equal for equal numbers, plans and machines, and for the same causes."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, ReadOnly | Model):
        return type(value), *(content(getattr(value, item.name)) for item in fields(value))
    return tuple(map(content, value)) if isinstance(value, tuple) else value


def decide_once(white: Whitened) -> Decision:
    """The decision about the data, of an earlier test if that asked for the same."""
    key = content(white)
    if key not in _decisions:
        if len(_decisions) == KEPT:
            _decisions.clear()
        _decisions[key] = decide(white)
    return _decisions[key]


DIAGNOSE, HISTORY = (
    vars(importlib.import_module(f"orthoglide_cal.{name}"))
    for name in ("inference.diagnose", "results.history")
)
DIAGNOSE["decide"] = HISTORY["decide"] = decide_once
# And what follows from the very same decision with all tolerances halved and doubled.
DIAGNOSE["decide_by"] = functools.lru_cache(KEPT)(decide_by)
Belief.scaled = functools.lru_cache(KEPT)(Belief.scaled)  # type: ignore[method-assign]
