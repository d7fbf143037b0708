"""Beginning a session, and going on with one only if nothing essential has changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from orthoglide_cal.data import MachineModel, machine_text
from orthoglide_cal.data.document import document_from_bytes
from orthoglide_cal.data.machine_file import machine_from_tree
from orthoglide_cal.data.yaml_tree import load_tree
from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.machine import Machine
from orthoglide_cal.session.events import VERSION, Opened
from orthoglide_cal.session.steps import ORDERS, PROTOCOLS

TYPED, SIMULATED = "typed", "simulated"


@dataclass(frozen=True)
class Wanted:
    """What the command line asks for; None where it says nothing."""

    machine: Machine | None = None
    protocol: str | None = None
    cycles: int | None = None
    order: str | None = None
    stands: int | None = None
    source: tuple[str, ...] = ()
    seed: int | None = None


def protocol_name(text: str | None) -> str | None:
    """The protocol meant by "double", "double-posture", "single" or "single-posture"."""
    if text is None or text in PROTOCOLS:
        return text
    named = [name for name in PROTOCOLS if name == f"{text}-posture"]
    if not named:
        raise UsageError(
            f"There is no protocol {text!r}.", f"Choose one of {', '.join(PROTOCOLS)}."
        )
    return named[0]


def open_record(
    wanted: Wanted,
    at: str,
    machine: Machine,
    seed: int,
    operator: str,
    temperature_c: float | None,
    gauges: list[dict[str, str]],
) -> Opened:
    """The first record of a new session.

    Args:
        wanted: what the command line asks for; the rest is standard.
        at: time of day.
        machine: in force.
        seed: for the simulated gauge, if none was asked for.
        operator, temperature_c, gauges: as given.
    """
    protocol = wanted.protocol or PROTOCOLS[0]
    source = wanted.source or (TYPED,)
    simulated = source == (SIMULATED,)
    if wanted.seed is not None and not simulated:
        raise UsageError("A seed belongs to the simulated gauge.", "Add --gauge simulated.")
    chosen = seed if wanted.seed is None else wanted.seed
    return Opened(
        at=at,
        version=VERSION,
        machine=machine_text(machine),
        protocol=protocol,
        cycles=wanted.cycles or 3,
        order=wanted.order or ORDERS[0],
        stands=1 if protocol == PROTOCOLS[1] else wanted.stands or 2,
        source=list(source),
        seed=chosen if simulated else None,
        operator=operator,
        temperature_c=temperature_c,
        gauges=gauges,
    )


def machine_of(opened: Opened, path: str) -> Machine:
    """The machine that a session is measured with. Raises InputError."""
    if opened.version != VERSION:
        raise InputError(
            "This version of the journal is not known.",
            "Use the orthocal that wrote it.",
            file=path,
            value=str(opened.version),
        )
    return machine_from_tree(load_tree(document_from_bytes(opened.machine.encode(), path)))


def refuse_changes(opened: Opened, machine: Machine, wanted: Wanted) -> None:
    """Raises UsageError, naming every difference, if the session asked for is another one."""
    differences = []
    for name in ("protocol", "cycles", "order", "stands", "seed"):
        before, now = getattr(opened, name), getattr(wanted, name)
        if now is not None and now != before:
            label = {"stands": "gauges side by side"}.get(name, name)
            differences.append(f"{label}: {before} in the session, {now} asked for")
    if wanted.source and (SIMULATED in wanted.source) != (SIMULATED in opened.source):
        before, now = ", ".join(opened.source), ", ".join(wanted.source)
        differences.append(f"gauge: {before} in the session, {now} asked for")
    if wanted.machine is not None:
        differences += [
            f"machine, {text}" for text in _machine_differences(machine, wanted.machine)
        ]
    if differences:
        raise UsageError(
            "This is not the session that was begun. " + "; ".join(differences) + ".",
            "Leave those options out, or begin a new session in another file.",
        )


def _machine_differences(before: Machine, now: Machine) -> list[str]:
    one, other = (_flat(MachineModel.from_machine(m).model_dump()) for m in (before, now))
    names = [name for name in {**one, **other} if one.get(name) != other.get(name)]
    return [
        f"{name}: {one.get(name, 'none')} in the session, {other.get(name, 'none')} in the file"
        for name in names
    ]


def _flat(value: Any, prefix: str = "") -> dict[str, Any]:
    """Nested groups as dotted names."""
    if isinstance(value, Mapping):
        return {
            name: leaf
            for key, inner in value.items()
            for name, leaf in _flat(inner, f"{prefix}{key}.").items()
        }
    if isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
        return _flat({str(index): inner for index, inner in enumerate(value)}, prefix)
    return {prefix[:-1]: value}
