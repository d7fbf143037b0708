"""The known serial formats: every module in `formats/` that defines FORMAT."""

from __future__ import annotations

import pkgutil
from functools import cache
from importlib import import_module

from orthoglide_cal.errors import UsageError
from orthoglide_cal.session.gauges import formats
from orthoglide_cal.session.gauges.token import Format


@cache
def serial_formats() -> dict[str, Format]:
    """Name → format, in alphabetical order."""
    modules = sorted(module.name for module in pkgutil.iter_modules(formats.__path__))
    found = [import_module(f"{formats.__name__}.{name}").FORMAT for name in modules]
    return {item.name: item for item in found}


def serial_format(name: str) -> Format:
    """The format of this name.

    Raises:
        UsageError: there is none.
    """
    known = serial_formats()
    if name not in known:
        raise UsageError(
            f"There is no gauge format {name!r}.",
            f"Choose typed, simulated, or FORMAT:PORT with one of {', '.join(known)}.",
        )
    return known[name]
