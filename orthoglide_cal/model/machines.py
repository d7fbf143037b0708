"""The kinds of machines, and which of them a machine file describes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated

from pydantic import Discriminator, Tag

from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.orthoglide import Orthoglide

MACHINES: Mapping[str, type[Machine]] = MappingProxyType(
    {"orthoglide": Orthoglide, "linear_delta": LinearDelta}
)


def kind_of(given: object) -> str:
    """The kind of a machine, or of the keys of a machine file.

    Without a `kind` it is the one that has the most of these keys for itself, or an Orthoglide.
    """
    if isinstance(given, Machine):
        return given.kind
    keys = given if isinstance(given, dict) else {}
    own = {
        kind: keys.keys() & made.model_fields.keys() - Machine.model_fields.keys()
        for kind, made in MACHINES.items()
    }
    likeliest = max(own, key=lambda kind: len(own[kind]))
    return str(keys.get("kind") or likeliest)


AnyMachine = Annotated[
    Annotated[Orthoglide, Tag("orthoglide")] | Annotated[LinearDelta, Tag("linear_delta")],
    Discriminator(kind_of),
]
