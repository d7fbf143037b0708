"""The causes of all files in this folder, by id."""

import importlib
import pkgutil
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from orthoglide_cal.model.machine import Corrections, Machine
from orthoglide_cal.model.model import Cause, Effect

_FOUND: dict[str, Cause] = {
    cause.id: cause
    for module in pkgutil.iter_modules([str(Path(__file__).parent)])
    if module.name not in ("base", "registry")
    for cause in importlib.import_module(f"{__package__}.{module.name}").CAUSES
}
CAUSES: Mapping[str, Cause] = MappingProxyType(dict(sorted(_FOUND.items())))
# How plausible it is beforehand that something acts that none of them makes.
UNLISTED = 0.04


def correcting(machine: Machine, corrected: Corrections) -> tuple[Effect, ...]:
    """Effects by which the controller of a machine corrects this of its causes."""
    return tuple(CAUSES[id].correcting(machine, values) for id, values in corrected.items())
