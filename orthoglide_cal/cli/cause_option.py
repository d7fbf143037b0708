"""Errors named on the command line, `--cause ID[@PLACE]=VALUES`, as effects of the simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orthoglide_cal.errors import InputError, UsageError

if TYPE_CHECKING:
    import numpy as np

    from orthoglide_cal.causes import Acting, Cause, Where
    from orthoglide_cal.machine import Machine
    from orthoglide_cal.plan import Plan


def effect_named(text: str, plan: Plan, machine: Machine, rng: np.random.Generator) -> Acting:
    """The effect that `text` describes.

    `axis_gap=0.1,0.2,-0.1`     parameters in the order of the cause, in its unit
    `gauge_drift@x,y=0.05`      in one place: leg x, direction y
    `misread@12=0.1`            the twelfth reading in time; for gauge_slip `12+` is "and all after"
    `sign_flip@z,x`             causes without a size take no value

    Args:
        text: as typed.
        plan: the readings; gives the places.
        machine: gives the plausible size of parameters that nobody can type (where a carriage
            with lost motion stands before its first motion); they are drawn at random.
        rng: for those.

    Raises:
        UsageError: no such cause or place, or not as many values as the cause has parameters.
    """
    from orthoglide_cal.causes import CAUSES

    head, _, tail = text.partition("=")
    name, _, place = (part.strip() for part in head.partition("@"))
    if name not in CAUSES:
        raise UsageError(f"There is no cause {name!r}.", f"Choose one of {', '.join(CAUSES)}.")
    cause = CAUSES[name]
    return cause.at(_parameters(cause, tail, machine, rng), _place(cause, place, plan, machine))


def _parameters(cause: Cause, text: str, machine: Machine, rng: np.random.Generator) -> np.ndarray:
    import numpy as np

    from orthoglide_cal.data.numbers import parse_number

    names = cause.names
    try:
        values = [parse_number(part) for part in text.split(",")] if text.strip() else []
    except InputError as error:
        raise UsageError(
            f"--cause {cause.id}: {error.what} ({error.value!r})", error.remedy
        ) from error
    if len(values) != len(names):
        unit = f" in {cause.unit}" if cause.unit else ""
        wanted = f"={','.join(names)}" if names else ""
        raise UsageError(
            f"--cause {cause.id} takes {len(names)} values{unit}, not {len(values)}.",
            f"Write {cause.id}{wanted}, a number for each name.",
        )
    if cause.positive and min(values) < 0.0:
        raise UsageError(f"{cause.id} cannot be negative.", "Give sizes from 0.")
    hidden = [size * machine.tolerances.get(cause.id, 0.0) for _, size in cause.nuisance]
    return np.array([*values, *rng.normal(0.0, hidden)]) * cause.scale


def _place(cause: Cause, text: str, plan: Plan, machine: Machine) -> Where:
    from orthoglide_cal.causes import Where

    places = cause.places(plan, machine)
    index: tuple[int, ...] = ()
    if text:
        onward = text.endswith("+")
        parts = [part.strip() for part in text.removesuffix("+").split(",")]
        if all(part in ("x", "y", "z") for part in parts):
            index = tuple("xyz".index(part) for part in parts)
        elif len(parts) == 1 and parts[0].isdecimal() and 1 <= int(parts[0]) <= len(plan):
            reading = int(plan.in_time[int(parts[0]) - 1])
            index = (reading, int(onward)) if len(places[0].index) == 2 else (reading,)
    where = Where(index)
    if where not in places or bool(text) != bool(index):
        here = f" at {text!r}" if text else ""
        example = {0: "no place", 1: "12 (a reading) or x (a leg)", 2: "x,y (leg, direction) or 12"}
        raise UsageError(
            f"{cause.id} cannot act{here} in this session.",
            f"Give as its place: {example[len(places[0].index)] if places else 'none fits'}.",
        )
    return where
