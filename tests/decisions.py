"""The same data under the same model are decided once in a process, whichever tests ask.

A decision is a pure function of them, which `tests.inference.test_verdicts` asserts of `decide`.
A test that replaces a part of the inference calls `decide` itself.
"""

import functools
import importlib
from collections.abc import Callable, Hashable
from dataclasses import fields
from typing import Any

import numpy as np

from orthoglide_cal.inference.belief import Belief
from orthoglide_cal.inference.decision import decide, decide_by
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import ReadOnly

KEPT = 50


def content(value: object) -> Hashable:
    """A key of a value: equal for equal numbers, plans and machines, and for the same causes."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, ReadOnly | Model):
        return type(value), *(content(getattr(value, item.name)) for item in fields(value))
    return tuple(map(content, value)) if isinstance(value, tuple) else value


def once(work: Callable[..., Any]) -> Callable[..., Any]:
    """The work, with the results of an earlier test that asked for the same."""
    done: dict[Hashable, Any] = {}

    def repeated(*given: Any, **options: Any) -> Any:
        key = content((*given, *options.items()))
        if key not in done:
            if len(done) == KEPT:
                del done[next(iter(done))]
            done[key] = work(*given, **options)
        return done[key]

    return repeated


DIAGNOSE, HISTORY, PLAN = (
    vars(importlib.import_module(f"orthoglide_cal.{name}"))
    for name in ("inference.diagnose", "results.history", "planning.plan")
)
DIAGNOSE["decide"] = HISTORY["decide"] = once(decide)
# And what follows from the very same decision with all tolerances halved and doubled.
DIAGNOSE["decide_by"] = functools.lru_cache(KEPT)(decide_by)
Belief.scaled = functools.lru_cache(KEPT)(Belief.scaled)  # type: ignore[method-assign]
# A plan that goes on from no data is a pure function of the machine and of what is wanted.
new_plan, plan = PLAN["measurement_plan"], once(PLAN["measurement_plan"])
PLAN["measurement_plan"] = lambda model, wanted, following=(), *details: (
    new_plan if following else plan
)(model, wanted, following, *details)
