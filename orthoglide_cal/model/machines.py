"""The kinds of machines, by their ids in the machine file."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.orthoglide import Orthoglide

MACHINES: Mapping[str, type[Machine]] = MappingProxyType(
    {kind.kind: kind for kind in (Orthoglide, LinearDelta)}
)
