"""The document of `orthocal machine`: a machine with its numbers, drawn to be compared with."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from orthoglide_cal.files import machine_values
from orthoglide_cal.model import Machine, Model
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.facts import method_facts, owner_facts
from orthoglide_cal.words import short

_TRAVEL = 48  # characters of the rail's travel


def machine_document(model: Model) -> doc.Document:
    """The document, for any of the renderers."""
    return doc.Document(partial(machine_values, model), partial(_page, model))


def _page(model: Model) -> doc.Page:
    machine = model.machine
    facts: list[tuple[str, doc.Blank]] = [("Kind", machine.kind)]
    facts += _parameters(model) if model.machine.absolute else _offsets(machine)
    facts += [*owner_facts(machine), *method_facts(machine)]
    sections = []
    if model.machine.has_cube:
        figure = doc.Figure(None, "Leg X at its isotropic posture, not to scale but its travel.",
                            (), sketch=tuple(_drawing(machine)))  # fmt: skip
        sections.append(doc.Section("Geometry, mm", (figure,)))
    if machine.history:
        entered = tuple(
            (each.date[:10], _triple(each.before_mm), _triple(each.after_mm), each.data_sha256[:12])
            for each in machine.history
        )
        head = ("entered", "before, mm", "after, mm", "from SHA-256")
        sections.append(doc.Section("In the controller", (doc.Grid(head, entered),)))
    if model.accepted:
        rows = tuple(
            (
                effect.cause.id,
                ", ".join(
                    f"{name} {short(each.value, 4)} ± {short(each.std, 4)} {each.unit}"
                    for name, each in model.called(effect).items()
                ),
                (effect.date or "")[:10],
            )
            for effect in model.accepted
        )
        grid = doc.Grid(("cause", "size, one standard deviation", "found"), rows, words=(0, 1))
        sections.append(doc.Section("What is known to be wrong with it", (grid,)))
    return doc.Page(
        kind="Machine", title=machine.name, facts=doc.Facts(tuple(facts)), sections=tuple(sections)
    )


def _offsets(machine: Machine) -> Iterator[tuple[str, doc.Blank]]:
    """Workspace, gauge and joint offsets."""
    gauge, turn = machine.gauge, machine.gauge.revolution_mm
    dial = "no dial" if turn is None else f"one turn {short(turn, 4)}"
    yield "Workspace", f"{short(machine.workspace_mm, 3)} mm cube"
    yield (
        "Gauge",
        f"divisions of {short(gauge.resolution_mm, 6)}, range {short(gauge.range_mm, 3)},"
        f" {dial}, repeatability {short(gauge.repeatability_mm, 6)} mm",
    )
    yield "In the controller", f"{_triple(machine.offsets_mm)} mm (x, y, z)"


def _parameters(model: Model) -> Iterator[tuple[str, doc.Blank]]:
    """Geometry, probe, and what the firmware has of each calibrated parameter."""
    machine, gauge = model.machine, model.machine.gauge
    yield "Geometry", machine.geometry_words
    yield (
        machine.vocabulary.noise.capitalize(),
        f"repeatability {short(gauge.repeatability_mm, 6)} mm",
    )
    for name, unit, value in zip(
        machine.parameter_names, machine.parameter_units, machine.active, strict=True
    ):
        yield name, f"{short(value, 6)} {unit}"


def _drawing(machine: Machine) -> Iterator[str]:
    """One leg on its rail; the travel is to scale."""
    low, high = machine.joint_limits_mm
    length, width = short(machine.leg_length_mm, 3), short(machine.parallelogram_width_mm, 3)
    yield f"     tool  r = {short(machine.tool_offset_mm, 3)}"
    yield "       o---+============================+ carriage"
    yield f"           |     leg: L = {length:<14}| (X) - - - - - - rail X"
    yield f"           +============================+ d = {width}"
    yield ""
    iso = round(-low / (high - low) * (_TRAVEL - 1))
    bar = "├" + "─" * (iso - 1) + "┼" + "─" * (_TRAVEL - iso - 2) + "┤"
    names = (f"{short(low, 3)} min", "0 iso", f"max {short(high, 3)}")
    middle = max(len(names[0]) + 1, iso - 2)
    yield f"  travel  {bar}"
    yield "          " + (
        f"{names[0]:<{middle}}{names[1]}".ljust(_TRAVEL - len(names[2])) + f" {names[2]}"
    )


def _triple(values: tuple[float, ...]) -> str:
    return " ".join(short(value, 4) for value in values)
