"""What was found of the calibrated parameters: a table, what the readings leave open, and values.

A kind of machine says what its parameters are called, and whether they are told as an excess over
what the controller has or as the values themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Verdict
from orthoglide_cal.model import Floats, Machine, Model
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.json import fields_of
from orthoglide_cal.results import Adjustment, Calibration
from orthoglide_cal.words import (
    coverage_words,
    plain,
    signed,
    two_figures,
    unit_words,
    with_uncertainty,
)

# Every kind of machine has as many, and as many offsets of them.
JOINTS = 3
# Instead of a number that the readings do not give.
UNKNOWN = "not determined"


def offsets_title(found: Adjustment, usable: bool, short: bool = False) -> str:
    """Heading of the table: what it is of, in which unit, and how it is meant."""
    vocabulary = found.machine.vocabulary
    kind = vocabulary.title if usable else f"{vocabulary.title} as found"
    # Where there is little room, of "true position" the "position" goes without saying.
    relation = (
        vocabulary.relation.replace("true position", "true") if short else vocabulary.relation
    )
    return f"{kind}{common_unit(found.machine)} ({relation})"


def common_unit(machine: Machine) -> str:
    """What is written behind a title: the unit of all parameters, if they have one."""
    units = set(machine.parameter_units)
    return f", {units.pop()}" if len(units) == 1 else ""


def offsets_grid(found: Adjustment, enters: bool, beside: Adjustment | None = None) -> doc.Grid:
    """What was found, and only if it may be entered what to type in.

    Args:
        found: with uncertainty.
        enters: whether it may be entered, and changes something.
        beside: the same as a cause that was found would have it.
    """
    columns = (_values if found.machine.absolute else _changes)(found)
    if beside is not None:
        head = f"with {' and '.join(beside.causes)}"
        values = beside.values.tolist()
        show = plain if found.machine.absolute else signed
        columns[head] = [
            show(value, found.decimals) if known else UNKNOWN
            for value, known in zip(values, beside.determined, strict=True)
        ]
    if enters:
        show = plain if found.machine.absolute else signed
        columns["type in"] = [
            doc.Strong(show(each.new_mm, found.decimals)) for each in found.joints
        ]
    return doc.Grid(tuple(columns), tuple(zip(*columns.values(), strict=True)))


def _changes(found: Adjustment) -> dict[str, Iterable[doc.Blank]]:
    """Of joint offsets: how much they exceed those that are active."""
    digits = found.decimals
    return {
        "": found.machine.parameter_names,
        found.machine.vocabulary.found: [
            signed(value, digits) for value in found.offsets_mm.tolist()
        ],
        "std. dev.": map(two_figures, found.std_mm.tolist()),
        "95 % interval": [
            f"{signed(low, digits)} … {signed(high, digits)}"
            for low, high in found.interval_mm.tolist()
        ],
        "active now": [signed(joint.previous_mm, digits) for joint in found.joints],
    }


def _values(found: Adjustment) -> dict[str, Iterable[doc.Blank]]:
    """Of parameters that the firmware states: it, and how far each is off."""
    off = zip(found.offsets_mm.tolist(), found.joints, strict=True)
    return {
        "": found.machine.parameter_names,
        "unit": found.machine.parameter_units,
        "controller": [plain(joint.previous_mm, found.decimals) for joint in found.joints],
        f"{found.machine.vocabulary.found} ± U": [
            with_uncertainty(value, joint.expanded_mm) if joint.determined else UNKNOWN
            for value, joint in off
        ],
    }


def open_blocks(calibration: Calibration, found: Adjustment) -> tuple[doc.Block, ...]:
    """What these readings do not determine: parameters, what is taken as given, what may hide.

    Nothing for a kind of machine whose every parameter is told as an excess.
    """
    if not found.machine.absolute:
        return ()
    return tuple(doc.Paragraph(line) for line in _open(calibration, found))


def _open(calibration: Calibration, found: Adjustment) -> Iterator[str]:
    yield f"U: expanded uncertainty, {coverage_words(found.k)}."
    missing = [joint for joint in found.joints if not joint.determined]
    if missing:
        names = " and ".join(
            f"{joint.axis} (U = {two_figures(joint.expanded_mm)} {joint.unit})" for joint in missing
        )
        yield f"These {len(calibration.input.measured)} readings do not determine {names}."
    machine, model = calibration.input.model.machine, calibration.input.model
    known = {effect.cause.id for effect in model.accepted}
    for cause in (CAUSES[id] for id in found.machine.fixed_parameters if id not in known):
        size = f"{cause.size(machine):g} {unit_words(cause.unit)}"
        yield (
            f"No reading of this kind determines {cause.id}: it is taken as the controller has it,"
            f" to within {size}, and that is part of U. What is found goes with the controller's"
            " own values."
        )
    diagnosis = calibration.diagnosis
    if diagnosis is not None and diagnosis.verdict is Verdict.CONSISTENT:
        hidden = [id for id in diagnosis.ambiguous_with if id not in found.machine.fixed_parameters]
        if hidden:
            yield (
                f"They show nothing else, but would hardly show it, either: {', '.join(hidden)}."
            )


def by_joint(found: Adjustment | Model, values: Sequence[Any] | Floats) -> dict[str, Any]:
    """Each joint's name → value, of those that all kinds of machine have: joint offsets."""
    told = list(values) if isinstance(values, Sequence) else values.tolist()
    return dict(zip(found.machine.parameter_names[:JOINTS], told, strict=False))


def result_of(found: Adjustment, *names: str) -> dict[str, Any]:
    """The offsets, their standard deviations, intervals and expanded uncertainties.

    No value is told of what the readings do not determine.

    Args:
        found: the result.
        names: which of these; all of them if none is named.
    """
    told = [
        (value, limits) if known else (None, None)
        for value, limits, known in zip(
            found.values.tolist(), found.limits.tolist(), found.determined, strict=True
        )
    ]
    result = {
        "offsets_mm": by_joint(found, [value for value, _ in told]),
        "std_mm": by_joint(found, found.std_mm),
        "ci95_mm": by_joint(found, [limits for _, limits in told]),
        "expanded_mm": by_joint(found, found.expanded_mm),
    }
    return {name: result[name] for name in names or result}


def parameters_of(found: Adjustment) -> dict[str, Any]:
    """Every calibrated parameter with its unit, where not all of them are joint offsets."""
    if not found.machine.absolute:
        return {}
    columns = (found.joints, found.values.tolist(), found.std_mm.tolist(), found.limits.tolist())
    return {
        "parameters": {
            joint.axis: {
                "value": value if joint.determined else None,
                "std": std,
                "unit": joint.unit,
                "ci95": limits if joint.determined else None,
                "controller": joint.previous_mm,
                "expanded": joint.expanded_mm,
                "determined": joint.determined,
            }
            for joint, value, std, limits in zip(*columns, strict=True)
        }
    }


def release_of(calibration: Calibration) -> dict[str, Any]:
    """Whether the result may be used and why not, and if the controller may have it already."""
    told = fields_of(calibration.release, "usable", "reasons")
    if not calibration.input.model.machine.absolute:
        return told
    return {**told, **fields_of(calibration, "settled")}
