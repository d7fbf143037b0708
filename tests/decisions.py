"""What follows from the same data under the same model is found once in a process, for all tests.

A decision and a diagnosis are pure functions of them, as `tests.inference.test_verdicts` asserts.
A test that replaces a part of the inference calls `diagnose_anew`.
"""

import functools
import importlib
import inspect
from collections.abc import Callable, Hashable
from dataclasses import fields
from types import ModuleType
from typing import Any

import numpy as np

from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import ReadOnly
from orthoglide_cal.planning.plan import SessionForecast
from orthoglide_cal.schema import Reason

KEPT = 80


def content(value: object) -> Hashable:
    """A key of a value: equal for equal numbers, plans and machines, and for the same causes."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, ReadOnly | Model):
        return type(value), *(content(getattr(value, item.name)) for item in fields(value))
    if isinstance(value, SessionForecast):
        return content((value.model, value.plan, value.method, value.name))
    if isinstance(value, Reason):
        return repr(value)
    return tuple(map(content, value)) if isinstance(value, tuple) else value


def once(work: Callable[..., Any], kept: int = KEPT) -> Callable[..., Any]:
    """The work, with the results of earlier tests that asked for the same."""
    done: dict[Hashable, Any] = {}
    signature = inspect.signature(work)

    @functools.wraps(work)
    def repeated(*given: Any, **options: Any) -> Any:
        asked = signature.bind(*given, **options)
        asked.apply_defaults()
        key = content(tuple(asked.arguments.values()))
        result = done.pop(key) if key in done else work(*given, **options)
        if len(done) == kept:  # that which was asked for longest ago goes
            del done[next(iter(done))]
        done[key] = result
        return result

    return repeated


def module_of(name: str) -> ModuleType:
    return importlib.import_module(f"orthoglide_cal.{name}")


def replace(name: str, repeated: Callable[..., Any], *modules: str) -> None:
    """Let these modules call a function that repeats results."""
    for module in modules:
        vars(module_of(module))[name] = repeated


DIAGNOSE = module_of("inference.diagnose")
diagnose_anew = DIAGNOSE.diagnose
# Before others take it from there.
replace("diagnose", once(DIAGNOSE.diagnose), "inference.diagnose")
replace("decided", once(DIAGNOSE.decided), "results.history")
# And what follows from the very same decision with all tolerances halved and doubled.
for name in ("scaled", "settled"):
    setattr(DIAGNOSE.Diagnosis, name, functools.lru_cache(KEPT)(getattr(DIAGNOSE.Diagnosis, name)))
PLAN, NEXT = map(module_of, ("planning.plan", "planning.next_measurement"))
ranked = functools.lru_cache(KEPT)(NEXT.rank_measurements)
replace("rank_measurements", ranked, "planning.next_measurement", "session.dialogue")
# Of the layouts of a printer there are some dozens.
apart = once(PLAN.separations, 200)
replace("separations", apart, "planning.plan")
# A plan that goes on from no data is a pure function of the session.
new_plan, plan = PLAN.measurement_plan, once(PLAN.measurement_plan)
replace(
    "measurement_plan",
    lambda chosen, target_mm=None, following=(), *details: (new_plan if following else plan)(
        chosen, target_mm, following, *details
    ),
    "planning.plan",
)
