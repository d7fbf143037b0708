"""The document of `orthocal plan` for a machine that has layouts: places, heights, distances."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import command
from orthoglide_cal.model import Floats, Source
from orthoglide_cal.planning import Next
from orthoglide_cal.planning.layouts import TOLD_SIGMA, Laid, LayoutProspect
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.controller import about
from orthoglide_cal.report.documents.budget import budget_section, source_words
from orthoglide_cal.report.documents.next_reading import next_data, next_section, told_apart
from orthoglide_cal.report.documents.parameters import by_joint
from orthoglide_cal.report.documents.plan import (
    budget_data,
    separation_data,
    separation_section,
)
from orthoglide_cal.report.json import SCHEMA_VERSION
from orthoglide_cal.words import percent, two_figures, unit_words

# Where the places to probe are written, unless somebody chose another name.
_PLACES = "places.csv"


def layouts_document(
    plan: LayoutProspect,
    source: Source | None = None,
    machine_file: Path | None = None,
    following: Sequence[Next] = (),
) -> doc.Document:
    """The document, for any of the renderers.

    Args:
        plan: what the layouts will give.
        source: whose readings there are already, and whose machine it is.
        machine_file: as the user gave it.
        following: what to measure beside these readings, best first.
    """
    page = partial(_page, plan, source, machine_file, following)
    return doc.Document(partial(layouts_data, plan, following), page)


def layouts_data(plan: LayoutProspect, following: Sequence[Next] = ()) -> dict[str, Any]:
    """The contract's fields as far as they fit, then a few more; of joint offsets in mm."""
    chosen, model = plan.chosen, plan.model
    return {
        "schema_version": SCHEMA_VERSION,
        "machine": model.machine.name,
        "protocol": chosen.layout.name,
        "by_cycles": [_laid_data(each) for each in plan.shown],
        **budget_data(chosen, chosen.floor, model),
        **separation_data(chosen.separations),
        "design": None if plan.telling is None else _design_data(plan, plan.telling),
        **({"next": next_data(following, model)} if following else {}),
    }


def _laid_data(each: Laid) -> dict[str, Any]:
    machine, layout = each.model.machine, each.layout
    columns = (
        machine.parameter_units,
        each.noise_std_mm.tolist(),
        each.expanded_mm.tolist(),
        each.determined,
    )
    return {
        "layout": layout.name,
        "what": layout.what,
        "cycles": 1,
        "readings": len(layout.plan),
        "minutes": round(layout.minutes, 2),
        "noise_std_mm": by_joint(each.model, each.noise_std_mm),
        "expanded_mm": by_joint(each.model, each.expanded_mm),
        "parameters": {
            name: {"unit": unit, "noise_std": noise, "expanded": reach, "determined": known}
            for name, unit, noise, reach, known in zip(
                machine.parameter_names, *columns, strict=True
            )
        },
        "rivals_sigma": each.rivals_sigma,
    }


def _design_data(plan: LayoutProspect, telling: Laid) -> dict[str, Any]:
    places = telling.layout.plan.place.tolist()
    return {
        **_laid_data(telling),
        "causes": list(plan.rivals),
        "wanted_sigma": TOLD_SIGMA,
        "reached": plan.tells,
        "places_mm": [dict(zip(("x", "y", "z"), place, strict=True)) for place in places],
    }


def _page(
    plan: LayoutProspect,
    source: Source | None,
    machine_file: Path | None,
    following: Sequence[Next],
) -> doc.Page:
    model, chosen = plan.model, plan.chosen
    probe = two_figures(model.machine.gauge.noise_mm)
    layout = ("Layout", f"{chosen.layout.name}: {chosen.layout.what}")
    facts = (
        *(() if following else (layout,)),
        (model.machine.vocabulary.noise.capitalize(), f"one touch scatters by {probe} mm"),
    )
    return doc.Page(
        kind="Plan",
        title=model.machine.name,
        facts=doc.Facts(facts),
        notice=_next_notice(plan, following[0]) if following else _notice(plan),
        sheet=(_to_do(plan, source, machine_file, following),),
        sections=(
            *((next_section(following),) if following else ()),
            _compared(plan),
            *_telling(plan, source, machine_file),
            budget_section(chosen.budget, model.machine),
            separation_section(
                chosen.separations,
                f"these {len(chosen.layout.plan)} readings",
                model.machine.vocabulary,
            ),
        ),
    )


def _to_do(
    plan: LayoutProspect,
    source: Source | None,
    machine_file: Path | None,
    following: Sequence[Next],
) -> doc.Section:
    if following:
        steps = [doc.Instruction(following[0].option.what)]
    elif plan.chosen.layout.plan.distance.any():
        steps = [doc.Instruction(plan.model.machine.vocabulary.probing)]
    else:
        steps = [
            doc.Instruction(
                "Have the places to probe written.", _write(plan, source, machine_file, plan.chosen)
            ),
            doc.Instruction("Probe them in this order, and fill in the column reading_mm."),
            doc.Instruction(
                "See what they say.", command("diagnose", _PLACES, machine=machine_file)
            ),
        ]
    return doc.Section("What to do next", (doc.Instructions(tuple(steps)),))


def _write(plan: LayoutProspect, source: Source | None, machine: Path | None, laid: Laid) -> str:
    """The command that writes the places of a layout."""
    first = plan.telling or plan.compared[0]
    named = "" if laid is first else f"--layout {laid.layout.name} "
    options = f"{named}--program {_PLACES}"
    if source is None:
        return command("plan", machine=machine, options=options)
    return about("plan", source, machine=machine, options=options)


def _next_notice(plan: LayoutProspect, best: Next) -> doc.Notice:
    """What to touch beside the readings that there are, and what all of them together give."""
    lines = [f"With the readings that there are: {_reach(plan, best.expanded_mm)}."]
    if best.separates is not None:
        first, second = told_apart(best)
        lines.append(
            f"It leaves one name with a chance of {percent(best.chance)}: it tells {first} from"
            f" {second}."
        )
    title = f"Next, about {max(best.option.minutes, 1.0):.0f} min: {best.option.what}"
    return doc.Notice(doc.Tone.INFO, title, tuple(lines))


def _reach(plan: LayoutProspect, expanded: Floats) -> str:
    """U of each parameter."""
    columns = (
        plan.model.machine.parameter_names,
        expanded.tolist(),
        plan.model.machine.parameter_units,
    )
    return ", ".join(
        f"{name} ± {two_figures(value)} {unit_words(unit)}"
        for name, value, unit in zip(*columns, strict=True)
    )


def _notice(plan: LayoutProspect) -> doc.Notice:
    """What the layout gives, what limits it, and what it leaves open."""
    chosen, machine = plan.chosen, plan.model.machine
    lines = [f"{_reach(plan, chosen.expanded_mm)} (95 % if nothing else is wrong)."]
    missing = [
        n for n, known in zip(machine.parameter_names, chosen.determined, strict=True) if not known
    ]
    if missing:
        lines.append(f"They do not determine {' and '.join(missing)}. {machine.vocabulary.more}")
    if chosen.floor is not None:
        what, _ = source_words(chosen.floor.largest, plan.model.machine)
        lines.append(f"However often you touch, what stays of it is mostly this: {what}.")
    lines += _rivals(plan)
    title = f"{len(chosen.layout.plan)} readings, about {chosen.layout.minutes:.0f} min"
    return doc.Notice(doc.Tone.WARN if missing else doc.Tone.INFO, title, tuple(lines))


def _rivals(plan: LayoutProspect) -> list[str]:
    """Whether the layout tells apart what hides behind each other."""
    sigma = plan.chosen.rivals_sigma
    if sigma is None:
        return []
    first, second = (CAUSES[id].title for id in plan.rivals)
    told = "are told apart" if sigma >= TOLD_SIGMA else "are not told apart for sure"
    return [f"That {first}, and that {second}, {told}: {two_figures(sigma)} standard deviations."]


def _compared(plan: LayoutProspect) -> doc.Section:
    """Every layout with what it takes and what it gives."""
    machine, held = plan.model.machine, plan.chosen.held
    rows = []
    for each in plan.shown:
        name, sigma = each.layout.name, each.rivals_sigma
        reach = zip(each.seen.expanded_mm.tolist(), each.determined, strict=True)
        rows.append(
            (
                doc.Strong(name) if each.layout is plan.chosen.layout else name,
                str(len(each.layout.plan)),
                f"{each.layout.minutes:.0f}",
                *(two_figures(value) if known else "–" for value, known in reach),
                "" if sigma is None else f"{sigma:.1f}",
            )
        )
    first, second = plan.rivals
    units = ", ".join(
        f"{name} {unit_words(unit)}"
        for name, unit in zip(machine.parameter_names, machine.parameter_units, strict=True)
    )
    caption = (
        f"U of each parameter, 95 % ({units}); – is not determined. σ: how far {first} and"
        f" {second} of usual size are apart, in standard deviations."
    )
    if held is not None:
        ids = " and ".join(each.source for each in held.contributions)
        rows.append((ids, "", "", *map(two_figures, held.expanded_mm.tolist()), ""))
        caption += f" No layout determines {ids}, taken as stated: what it adds (by squares) is"
        caption += " the last row."
    head = ("layout", "readings", "min", *machine.parameter_names, "σ")
    left_out = doc.Paragraph("What the readings cannot rule out comes on top of it in solve.")
    grid = doc.Grid(head, tuple(rows), words=(0,), caption=caption)
    return doc.Section("Ways to measure, compared", (grid, left_out))


def _telling(
    plan: LayoutProspect, source: Source | None, machine_file: Path | None
) -> tuple[doc.Section, ...]:
    """The quickest layout that tells the rivals apart."""
    telling = plan.telling
    if telling is None:
        return ()
    first, second = plan.rivals
    reached = (
        f"The quickest that gets {first} and {second} {TOLD_SIGMA:g} standard deviations apart"
        if plan.tells
        else f"None gets {first} and {second} {TOLD_SIGMA:g} standard deviations apart; this one"
        f" gets farthest, {two_figures(telling.rivals_sigma or 0.0)}"
    )
    what = f"{reached}: {telling.layout.what}, about {telling.layout.minutes:.0f} min."
    blocks: list[doc.Block] = [doc.Paragraph(what)]
    if telling.layout is not plan.chosen.layout:
        write = doc.Instruction(
            "Have its places written.", _write(plan, source, machine_file, telling)
        )
        blocks.append(doc.Instructions((write,)))
    return (doc.Section(f"To tell {first} from {second}", tuple(blocks)),)
