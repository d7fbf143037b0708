"""The kinds of machine of all files in this folder, by the name that a machine file gives them."""

import importlib
import pkgutil
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.orthoglide import Orthoglide

for _module in pkgutil.iter_modules([str(Path(__file__).parent)]):
    if _module.name != "kinds":
        importlib.import_module(f"{__package__}.{_module.name}")
# The Orthoglide first: a machine file that does not say its kind is of one.
_KINDS = sorted(Machine.__subclasses__(), key=lambda kind: kind is not Orthoglide)
MACHINES: Mapping[str, type[Machine]] = MappingProxyType(
    {kind.model_fields["kind"].default: kind for kind in _KINDS}
)
