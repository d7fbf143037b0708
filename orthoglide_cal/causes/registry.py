"""Finds the causes in this folder and turns those of a machine file into effects."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

import orthoglide_cal.causes as folder
from orthoglide_cal.causes.base import Acting, Cause
from orthoglide_cal.errors import InputError
from orthoglide_cal.machine import Machine


def _found() -> Mapping[str, Cause]:
    modules = (
        importlib.import_module(f"{folder.__name__}.{module.name}")
        for module in pkgutil.iter_modules(folder.__path__)
        if module.name not in ("base", "registry")
    )
    causes = (module.CAUSE for module in modules)
    return MappingProxyType({cause.id: cause for cause in causes})


CAUSES: Mapping[str, Cause] = _found()


def machine_effects(machine: Machine) -> tuple[Acting, ...]:
    """Effects of the causes accepted in the machine file (`identified:`).

    Raises:
        InputError: a cause is unknown, or its parameters are not those of the cause.
    """
    effects = []
    for found in machine.identified:
        cause = CAUSES.get(found.id)
        if cause is None or not cause.lasting:
            raise InputError(
                "This cause cannot be part of a machine.",
                f"Use one of {', '.join(c.id for c in CAUSES.values() if c.lasting)}.",
                column="identified",
                value=found.id,
            )
        if set(found.parameters) != set(cause.names):
            raise InputError(
                f"{found.id} has the parameters {', '.join(cause.names)}.",
                "Give each of them once.",
                column="identified.parameters",
                value=", ".join(found.parameters),
            )
        values = [found.parameters[name].value for name in cause.names]
        theta = np.array([*values, *(0.0 for _ in cause.nuisance)]) * cause.scale
        size2, directions = np.linalg.eigh(found.covariance(cause.names))
        spread = np.zeros((len(values), len(theta)))
        spread[:, : len(values)] = (directions * np.sqrt(np.maximum(size2, 0.0))).T * cause.scale
        effects.append(Acting(cause, theta, spread=spread))
    return tuple(effects)
