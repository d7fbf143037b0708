"""The causes of all files in this folder, by id."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from orthoglide_cal.model.cause import Cause


def _found() -> Mapping[str, Cause]:
    modules = (
        importlib.import_module(f"{__package__}.{module.name}")
        for module in pkgutil.iter_modules([str(Path(__file__).parent)])
        if module.name not in ("base", "registry")
    )
    causes = [cause for module in modules for cause in module.CAUSES]
    return MappingProxyType({each.id: each for each in sorted(causes, key=lambda c: str(c.id))})


CAUSES: Mapping[str, Cause] = _found()
