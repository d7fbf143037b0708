"""The uncertainty budget as a table, the largest source by name, and what would lessen it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.budget import Budget, Contribution
from orthoglide_cal.model import Machine
from orthoglide_cal.model.influence import Origin
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.documents.parameters import common_unit
from orthoglide_cal.words import (
    counted,
    coverage_words,
    decimals_for,
    short,
    two_figures,
    unit_words,
)

# Source → in words, and what would lessen it.
_SOURCES: Mapping[str, tuple[str, str]] = {
    Origin.NOISE: (
        "scatter of the readings",
        "Take more cycles; if the residuals are larger than noise, first see what diagnose says.",
    ),
    Origin.RESOLUTION: (
        "resolution of the gauge",
        "Take more cycles, or a gauge with finer divisions.",
    ),
    Origin.GAUGE_SCALE: (
        "scale of the gauge",
        "State what its certificate says as scale_u of the gauge in the machine file.",
    ),
    Origin.GAUGE_PLACEMENT: (
        "places of the gauges along the legs",
        "Measure where they stand, and state how well as placement_mm of the gauge.",
    ),
    Origin.BED_TEXTURE: (
        "local shape of the bed",
        "Probe more places; state how rough the bed is as texture_mm of the probe.",
    ),
    Origin.TEMPERATURE: ("temperature, off 20 °C (steel)", "Measure nearer to 20 °C."),
    Origin.EXPLANATIONS: (
        "what else is wrong",
        "The data leave it open: see what diagnose says.",
    ),
}
# What lessens a cause that may be there, and one of a size that no reading shows.
_OPEN = (
    "These readings hardly show it: measure with other postures, or state under tolerances in the"
    " machine file how large it can be."
)
_STATE = "State how well that is known under tolerances in the machine file."
# Sources below this share of the combined uncertainty of every offset are summed up in one row.
_SMALL = 0.1


def budget_section(budget: Budget, machine: Machine) -> doc.Section:
    """Each source with its size, and what it adds to each parameter of this kind of machine."""
    shown = [each for each in budget.contributions if np.any(each.std_mm > _SMALL * budget.std_mm)]
    rest = [each for each in budget.contributions if each not in shown]
    rows = [
        (
            source_words(each, machine)[0],
            each.evaluation.value,
            _size(each),
            *map(two_figures, each.std_mm),
        )
        for each in sorted(shown, key=lambda each: -float(each.std_mm.max()))
    ]
    if any(np.any(each.std_mm > 0.0) for each in rest):
        small = np.sqrt(sum(each.std_mm**2 for each in rest))
        rows.append((counted(len(rest), "smaller one"), "", "", *map(two_figures, small)))
    rows.append(("together, u", "", "", *map(two_figures, budget.std_mm)))
    reach = map(two_figures, budget.expanded_mm)
    rows.append((f"U = k·u, {coverage_words(budget.k)}", "", "", *reach))
    what, remedy = source_words(budget.largest, machine)
    return doc.Section(
        f"Uncertainty of the {machine.vocabulary.many}{common_unit(machine)}",
        (
            doc.Grid(("source", "type", "size", *_heads(machine)), tuple(rows)),
            doc.Paragraph(f"Most of it: {what}. {remedy}"),
        ),
    )


def _heads(machine: Machine) -> list[str]:
    """The parameters; with their units where these differ."""
    if common_unit(machine):
        return list(machine.parameter_names)
    return [
        f"{name}, {unit}"
        for name, unit in zip(machine.parameter_names, machine.parameter_units, strict=True)
    ]


def source_words(each: Contribution, machine: Machine) -> tuple[str, str]:
    """A source in words, and what would lessen it."""
    if each.source in _SOURCES:
        what, remedy = _SOURCES[each.source]
        return machine.vocabulary.said(what), machine.vocabulary.said(remedy)
    causes = [CAUSES[id] for id in each.source.split(" and ")]
    what = machine.vocabulary.said(" and ".join(cause.title for cause in causes))
    if each.possible:
        return f"whether {what}", machine.vocabulary.said(_OPEN)
    return what, machine.vocabulary.said(f"{causes[0].advice} {_STATE}")


def _size(each: Contribution) -> str:
    """Its size with unit, and whether it is assumed; what has no one size is blank."""
    if each.size is None:
        return ""
    value = f"{short(each.size, decimals_for(each.size))} {unit_words(each.unit)}".rstrip()
    return f"{value} (assumed)" if each.assumed else value
