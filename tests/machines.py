"""Two machines for tests: the prototype and one that differs from it in every length."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model.model import Effect, Model
from orthoglide_cal.model.orthoglide import Orthoglide

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_data"


def _machine(name: str) -> Orthoglide:
    given = yaml.safe_load((ROOT / "configs" / f"{name}.yaml").read_text(encoding="utf-8"))
    left_out = ("schema_version", "identified", "offsets_mm")
    return Orthoglide(**{key: value for key, value in given.items() if key not in left_out})


PROTOTYPE = _machine("orthoglide_prototype")
LARGE = _machine("orthoglide_large")
NOMINAL = Model(PROTOTYPE)
NOMINAL_LARGE = Model(LARGE)

both_machines = pytest.mark.parametrize("machine", [PROTOTYPE, LARGE], ids=["prototype", "large"])
both_models = pytest.mark.parametrize("model", [NOMINAL, NOMINAL_LARGE], ids=["prototype", "large"])


def sure(model: Model) -> Model:
    """The same machine where nothing but noise is uncertain: stands, scale and legs are exact."""
    machine = model.machine.changed(tolerances={**model.machine.tolerances, "leg_length": 0.0})
    if isinstance(machine, Orthoglide):
        gauge = machine.gauge.changed(placement_mm=0.0, scale_u=0.0)
        machine = machine.changed(gauge=gauge)
    return replace(model, machine=machine)


def extended(**causes: tuple[float, ...]) -> Model:
    """The prototype with accepted causes: id → parameters in the contract's unit, each ± 0.01."""
    effects = []
    for id, values in causes.items():
        cause = CAUSES[id]
        named = np.arange(cause.unknowns) < len(values)
        theta = np.zeros(cause.unknowns)
        theta[named] = np.array(values) * cause.scale
        covariance = np.diag(named * (0.01 * cause.scale) ** 2)
        effects.append(
            Effect(cause, theta, covariance=covariance, date="2026-01-01", data_sha256="0" * 64)
        )
    return NOMINAL.extended(effects)
