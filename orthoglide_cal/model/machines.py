"""The kinds of machines, and which of them a machine file describes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.orthoglide import Orthoglide

MACHINES: Mapping[str, type[Machine]] = MappingProxyType(
    {"orthoglide": Orthoglide, "linear_delta": LinearDelta}
)


def kind_of(keys: Mapping[str, object]) -> str:
    """The kind of a file without a `kind`: of most keys that no other has, or an Orthoglide."""
    own = {
        kind: keys.keys() & made.model_fields.keys() - Machine.model_fields.keys()
        for kind, made in MACHINES.items()
    }
    return max(own, key=lambda kind: len(own[kind]))
