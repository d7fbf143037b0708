"""The estimators by name: each is a reduction of the readings and a way to solve.

single            eq. 10, pseudoinverse              single-posture differences
single-sequential eq. 11, one offset after the other
six-linear        eq. 17, pseudoinverse              max − min
twelve-linear     eq. 16, pseudoinverse              max − iso, min − iso
six, twelve       eq. 25, nonlinear least squares on the same differences
readings          all raw readings at once, one unknown zero per gauge set-up
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.effects import Effect
from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation.problem import Problem
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Differences, Measured, Readings
from orthoglide_cal.plan import Contact
from orthoglide_cal.protocols import NAMES, cell_contrasts, ideal_plan, reduction, zero_free


@dataclass(frozen=True)
class Method:
    """An estimator: the kind of differences that it uses (None: all readings), and how."""

    name: str
    differences: str | None
    linear: bool


METHODS = {
    method.name: method
    for method in (
        Method("single", "single", True),
        Method("single-sequential", "single", True),
        Method("six-linear", "six", True),
        Method("twelve-linear", "twelve", True),
        Method("six", "six", False),
        Method("twelve", "twelve", False),
        Method("readings", None, False),
    )
}


def choose_method(measured: Measured, name: str | None) -> Method:
    """The method asked for, or the default for this kind of data.

    Raises:
        UsageError: unknown name, or a method that these data cannot feed.
    """
    if name is None:
        return METHODS[measured.kind]
    if name not in METHODS:
        raise UsageError(f"There is no method {name!r}.", f"Choose one of {', '.join(METHODS)}.")
    method = METHODS[name]
    usable = usable_methods(measured)
    if name not in usable:
        raise UsageError(
            f"Method {name} cannot use {describe(measured)}.",
            f"Choose one of {', '.join(usable)}.",
        )
    return method


def usable_methods(measured: Measured) -> tuple[str, ...]:
    """Names of the methods that these data can feed."""
    if isinstance(measured, Differences):
        kinds = {"six": ("six",), "twelve": ("twelve", "six"), "single": ("single",)}
        allowed: tuple[str | None, ...] = kinds[measured.kind]
    elif np.all(measured.plan.contact == Contact.FIXED):
        allowed = (None, "six", "twelve")
    else:
        allowed = (None, "single")
    return tuple(name for name, method in METHODS.items() if method.differences in allowed)


def describe(measured: Measured) -> str:
    """The kind of data in words."""
    if isinstance(measured, Readings):
        return "raw readings"
    return {
        "six": "six differences (max − min)",
        "twelve": "twelve differences (relative to iso)",
        "single": "single-posture differences",
    }[measured.kind]


@dataclass(frozen=True, eq=False)
class Posed:
    """A problem with its data: d, shape (k,) [mm], and the names of the differences."""

    problem: Problem
    data: Floats
    names: tuple[str, ...]


def pose(
    measured: Measured,
    machine: Machine,
    method: Method,
    effects: Sequence[Effect] = (),
    *,
    folded: bool = False,
) -> Posed:
    """Reduce the data to what the method compares with the model.

    Args:
        measured: readings or differences.
        machine: nominal machine.
        method: the estimator; one that can use these data.
        effects: known departures from the nominal machine.
        folded: of raw readings that repeat each other keep the mean only, where no effect can
            tell them apart; their scatter is not in the data then.
    """
    if method.differences is None:
        assert isinstance(measured, Readings)
        alike = folded and all(effect.repeats for effect in effects)
        contrasts = cell_contrasts if alike else zero_free
        matrix = contrasts(measured.plan)
        return Posed(Problem(machine, measured.plan, matrix, effects), matrix @ measured.value, ())
    return pose_differences(measured, machine, method.differences, effects)


def pose_differences(
    measured: Measured, machine: Machine, kind: str, effects: Sequence[Effect] = ()
) -> Posed:
    """Differences of this kind from the data; those that the data lack are left out."""
    names = NAMES[kind]
    if isinstance(measured, Readings):
        matrix = reduction(kind, names, machine, measured.plan)
        present = np.abs(matrix).sum(axis=1) > 0.0
        kept = tuple(name for name, ok in zip(names, present, strict=True) if ok)
        matrix = matrix[present]
        return Posed(
            Problem(machine, measured.plan, matrix, effects), matrix @ measured.value, kept
        )
    values = dict(zip(measured.names, measured.value.tolist(), strict=True))
    if measured.kind == "twelve" and kind == "six":
        values = {
            name: values[f"{name}+"] - values[f"{name}-"]
            for name in names
            if f"{name}+" in values and f"{name}-" in values
        }
    kept = tuple(name for name in names if name in values)
    # The readings behind the printed differences: one of each cell, so that a difference of
    # the twelve shares its isotropic reading with its partner (errata, eq. 30).
    plan = ideal_plan(measured.kind, machine)
    matrix = reduction(kind, kept, machine, plan)
    data = np.array([values[name] for name in kept])
    return Posed(Problem(machine, plan, matrix, effects), data, kept)
