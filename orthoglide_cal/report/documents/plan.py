"""The document of `orthocal plan`: what a session will give, what limits it, other ways."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from orthoglide_cal.errors import command
from orthoglide_cal.estimation.budget import Budget
from orthoglide_cal.model import Cause
from orthoglide_cal.model.kinds import OFFSET_MM
from orthoglide_cal.planning import Next
from orthoglide_cal.planning.bar import MARGIN, bar_warning, worst_touch
from orthoglide_cal.planning.expected import MOST_CYCLES, Expected
from orthoglide_cal.planning.prospect import MOST_COMPARED, Comparison, GivenUp, Prospect
from orthoglide_cal.planning.separation import TRACE_SIGMA, Separations
from orthoglide_cal.planning.steps import MeasuringProtocol
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.documents.budget import budget_section, source_words
from orthoglide_cal.report.documents.next_reading import next_data, next_section, told_apart
from orthoglide_cal.report.json import SCHEMA_VERSION, by_axis
from orthoglide_cal.report.shades import KEY, separation_lines, separation_panel
from orthoglide_cal.report.words import counted, percent, short, two_figures

# Options with which `measure` takes each protocol.
_OPTIONS = {
    MeasuringProtocol.DOUBLE: "",
    MeasuringProtocol.SINGLE: "--protocol single ",
    MeasuringProtocol.BEST: "--design best ",
}
_SHOWN_LOSSES = 12
_SHOWN_PAIRS = 4


def plan_document(
    plan: Prospect,
    machine_file: Path | None = None,
    following: Sequence[Next] = (),
    go_on: str | None = None,
) -> doc.Document:
    """The document, for any of the renderers.

    Args:
        plan: what a session of its own will give.
        machine_file: as the user gave it.
        following: what to measure beside readings that there are, best first; empty without them.
        go_on: the command that measures it; None if it must be typed by hand.
    """
    page = partial(_page, plan, machine_file, following, go_on)
    return doc.Document(partial(plan_data, plan, following), page)


def plan_data(plan: Prospect, following: Sequence[Next] = ()) -> dict[str, Any]:
    """The contract's fields, then a few more; lengths in mm."""
    floor, best, design = plan.floor, plan.best, plan.design
    return {
        "schema_version": SCHEMA_VERSION,
        "machine": plan.model.machine.name,
        "protocol": plan.protocol,
        "gauges": plan.stands,
        "cycles": plan.cycles,
        "by_cycles": [_expected_data(plan, each) for each in plan.by_cycles],
        "budget": [
            {"source": each.source, "type": each.evaluation, "std_mm": by_axis(each.std_mm)}
            for each in plan.chosen.budget.contributions
        ],
        "limits": {
            "expanded_mm": None if floor is None else by_axis(floor.expanded_mm),
            "source": None if floor is None else floor.largest.source,
        },
        "target": None
        if plan.target_mm is None
        else {
            "expanded_mm": plan.target_mm,
            "reached": plan.reached,
            "cycles": plan.cycles if plan.reached else None,
        },
        "compare": [_comparison_data(plan, each) for each in plan.compared],
        "separation": [
            {"causes": [a.id, b.id], "sigma": sigma} for a, b, sigma in plan.separations.pairs
        ],
        "invisible": [cause.id for cause in plan.separations.invisible],
        "design": {
            **_expected_data(plan, best),
            "gauge_at": design.gauge_at,
            "postures_mm": list(design.displacements_mm),
            "share_of_readings": plan.share,
            "given_up": [_loss_data(each) for each in plan.given_up],
        },
        **({"next": next_data(following, plan.model)} if following else {}),
    }


def _expected_data(plan: Prospect, found: Expected) -> dict[str, Any]:
    session = found.session
    return {
        "cycles": session.cycles,
        "readings": session.readings,
        "gauge_moves": session.moves,
        "minutes": session.minutes,
        "noise_std_mm": by_axis(found.noise_std_mm),
        "expanded_mm": by_axis(found.expanded_mm),
        "tool_mm": plan.tool_mm(found),
    }


def _comparison_data(plan: Prospect, way: Comparison) -> dict[str, Any]:
    return {
        "protocol": way.protocol,
        "method": way.method,
        "same_cycles": _expected_data(plan, way.same_cycles),
        "same_expanded": None if way.as_sure is None else _expected_data(plan, way.as_sure),
    }


def _loss_data(lost: GivenUp) -> dict[str, Any]:
    causes = [lost.cause.id] if lost.rival is None else [lost.cause.id, lost.rival.id]
    return {"causes": causes, "usual_sigma": lost.usual_sigma, "best_sigma": lost.best_sigma}


def _page(
    plan: Prospect, machine_file: Path | None, following: Sequence[Next], go_on: str | None
) -> doc.Page:
    machine, session = plan.model.machine, plan.chosen.session
    gauge = machine.gauge
    facts = (
        ("Protocol", f"{plan.protocol}, {counted(plan.cycles, 'cycle')}"),
        ("Gauge", f"one reading scatters by {two_figures(gauge.noise_mm)} mm"),
        ("Offsets", f"about {OFFSET_MM:g} mm each are assumed"),
    )
    measure = f"{_OPTIONS[session.protocol]}--cycles {session.cycles}"
    if plan.stands == 1 and session.protocol is not MeasuringProtocol.SINGLE:
        measure += " --gauges 1"
    to_do = doc.Instruction(
        "Measure it.", command("measure", machine=machine_file, options=measure)
    )
    if _leaves_bar(plan):
        fitting = f"--design best --cycles {plan.best.session.cycles}"
        measure = command("measure", machine=machine_file, options=fitting)
        to_do = doc.Instruction("Measure what the plungers can follow.", measure)
    if following:
        to_do = doc.Instruction(following[0].option.what, go_on)
    return doc.Page(
        kind="Plan",
        title=machine.name,
        facts=doc.Facts(facts),
        notice=_next_notice(plan, following[0]) if following else _notice(plan),
        sheet=(doc.Section("What to do next", (doc.Instructions((to_do,)),)),),
        sections=(
            *((next_section(following),) if following else ()),
            _by_cycles(plan),
            budget_section(plan.chosen.budget, plan.model.kind),
            _compared(plan),
            separation_section(plan.separations, counted(min(plan.cycles, MOST_COMPARED), "cycle")),
            _design(plan, machine_file),
        ),
    )


def _next_notice(plan: Prospect, best: Next) -> doc.Notice:
    """What to measure beside the readings that there are, and what it brings."""
    worth = f"Each offset is then known within ± {two_figures(float(best.expanded_mm.max()))} mm."
    if best.separates:
        first, second = told_apart(best)
        settled = f"It leaves one name with a chance of {percent(best.chance)}: it tells {first}"
        worth = f"{settled} from {second}. {worth}"
    title = f"Next, about {max(best.option.minutes, 1.0):.0f} min: {best.option.what}"
    return doc.Notice(doc.Tone.INFO, title, (worth,))


def _notice(plan: Prospect) -> doc.Notice:
    """What the session gives, and what limits it."""
    session = plan.chosen.session
    largest = two_figures(float(plan.chosen.expanded_mm.max()))
    lines = [
        f"Each offset will be known within ± {largest} mm (95 % if nothing else is wrong), the"
        f" tool everywhere within ± {two_figures(plan.tool_mm(plan.chosen))} mm.",
        _limit(plan),
    ]
    title = f"{session.readings} readings, about {session.minutes:.0f} min"
    warning = bar_warning(session.plan, plan.model.machine) or ()
    if _leaves_bar(plan):
        return doc.Notice(doc.Tone.BAD, "This cannot be measured so", warning)
    lines = [*warning, *lines]
    if warning and plan.target_mm is None:
        return doc.Notice(doc.Tone.WARN, title, tuple(lines))
    if plan.target_mm is None:
        return doc.Notice(doc.Tone.INFO, title, tuple(lines))
    wanted = f"± {_millimetres(plan.target_mm)} mm"
    if plan.reached:
        title = f"{wanted} takes {counted(session.cycles, 'cycle')}: {title}"
        return doc.Notice(doc.Tone.GOOD, title, tuple(lines))
    # What limits it stands in the reason already.
    lines.remove(_limit(plan))
    return doc.Notice(doc.Tone.BAD, f"{wanted} cannot be reached so", (*_unreached(plan), *lines))


def _millimetres(value: float) -> str:
    """A length as it was asked for, however small."""
    return short(value, 6) if value >= 1e-6 else f"{value:g}"


def _leaves_bar(plan: Prospect) -> bool:
    """Whether a plunger leaves its bar."""
    worst = worst_touch(plan.chosen.session.plan, plan.model.machine)
    return worst is not None and worst.keeps < 0.0


def _unreached(plan: Prospect) -> tuple[str, ...]:
    """Why the target is out of reach: what cannot be seen, or noise."""
    assert plan.target_mm is not None
    floor = plan.floor
    if floor is not None and float(floor.expanded_mm.max()) > plan.target_mm:
        return (f"No number of cycles helps. {_floor_words(floor, plan.model.kind)}",)
    return (
        f"More than {MOST_CYCLES} cycles would do, because of the scatter of the readings: take a"
        " finer gauge or a better stand.",
    )


def _floor_words(floor: Budget, kind: Any) -> str:
    what, remedy = source_words(floor.largest, kind)
    left = two_figures(float(floor.expanded_mm.max()))
    return f"± {left} mm stay: {what}. {remedy}"


def _limit(plan: Prospect) -> str:
    """Noise, or what more cycles do not lessen."""
    chosen, floor = plan.chosen.budget, plan.floor
    noise = float(np.max(plan.chosen.noise_std_mm / chosen.std_mm))
    if floor is None or noise > 0.8:
        return "The scatter of the readings limits it: more cycles help."
    help_ = "hardly help" if noise < 0.5 else "help little"
    return f"More cycles {help_}. {_floor_words(floor, plan.model.kind)}"


def _by_cycles(plan: Prospect) -> doc.Section:
    rows = tuple(
        (
            doc.Strong(str(each.session.cycles))
            if each.session.cycles == plan.cycles
            else str(each.session.cycles),
            str(each.session.readings),
            f"{each.session.minutes:.0f}",
            two_figures(float(each.noise_std_mm.max())),
            *map(two_figures, each.expanded_mm.tolist()),
            two_figures(plan.tool_mm(each)),
        )
        for each in plan.by_cycles
    )
    head = ("cycles", "readings", "min", "noise", "U of x", "of y", "of z", "tool")
    caption = (
        "In mm. Noise: what scatter leaves of the worst offset, one standard deviation. U: of each"
        " offset, 95 %. Tool: at the worst place of the workspace, offsets entered."
    )
    return doc.Section("How many cycles", (doc.Grid(head, rows, words=(), caption=caption),))


def _compared(plan: Prospect) -> doc.Section:
    rows = []
    for way in plan.compared:
        found, same = way.as_sure, way.same_cycles
        numbers = (
            (found.session.cycles, found.session.readings, found.session.moves)
            if found
            else ("", "never", "")
        )
        minutes = f"{found.session.minutes:.0f}" if found else ""
        worst = two_figures(float(same.expanded_mm.max()))
        rows.append((way.protocol, way.method, worst, *map(str, numbers), minutes))
    worst = two_figures(float(plan.chosen.expanded_mm.max()))
    head = ("protocol", "method", "U", "cycles", "readings", "moves", "min")
    caption = (
        f"U: of the worst offset with {counted(plan.cycles, 'cycle')}, mm. Then what it takes for"
        f" ± {worst} mm. Moves: a stand is put to another place."
    )
    grid = doc.Grid(head, tuple(rows), words=(0, 1), caption=caption)
    return doc.Section("Other ways to the same uncertainty", (grid,))


def separation_section(found: Separations, by: str) -> doc.Section:
    """Which causes some readings can tell apart; `by` says how many readings in words."""
    seen, hidden = found.visible, found.invisible
    names = [cause.id for cause in seen.causes]
    near = [pair for pair in seen.pairs if pair[2] < TRACE_SIGMA]
    named = "; ".join(f"{a.id} and {b.id}" for a, b, _ in near[:_SHOWN_PAIRS])
    finding = (
        f"Of {len(seen.pairs)} pairs of causes of their usual size {len(near)} cannot be told apart"
        f" by {by}{f': {named}' if named else ''}."
    )
    figure = doc.Figure(
        None,
        finding,
        (separation_panel(names, seen.sigma, seen.trace, finding),),
        sketch=separation_lines(names, seen.sigma, seen.trace),
        columns=1,
        key=KEY,
    )
    blocks: list[doc.Block] = [figure if names else doc.Paragraph("No cause leaves a trace.")]
    if hidden:
        rows = tuple((cause.id, cause.instrument) for cause in hidden)
        caption = "At their usual size they leave hardly a trace in such readings."
        head = ("not seen", "what would show it")
        blocks.append(doc.Grid(head, rows, words=(0, 1), caption=caption))
    return doc.Section("What can be told apart", tuple(blocks))


def _design(plan: Prospect, machine_file: Path | None) -> doc.Section:
    best, design = plan.best, plan.design
    postures = ", ".join(f"{short(moved, 3)} mm" for moved in design.displacements_mm)
    sentence = (
        f"Only the postures {postures}, the gauges at {percent(design.gauge_at)} of the leg from"
        f" the carriage: {percent(plan.share)} of the readings of the double-posture protocol leave"
        " the same noise."
    )
    session, reach = best.session, two_figures(float(best.expanded_mm.max()))
    options = f"--design best --cycles {session.cycles}"
    again = command("measure", machine=machine_file, options=options)
    given_up = (
        f"The plunger keeps {percent(MARGIN)} of the leg from both joints at every posture. What"
        " is given up: drift, knocks and faults of the rails show at the isotropic posture, which"
        " it leaves out."
    )
    blocks: list[doc.Block] = [
        doc.Paragraph(sentence),
        doc.Paragraph(
            (
                f"{session.readings} readings in {session.minutes:.0f} min give ± {reach} mm: ",
                doc.Command(again),
            )
        ),
        doc.Paragraph(given_up),
    ]
    rows = tuple(
        (_what(each.cause, each.rival), two_figures(each.usual_sigma), two_figures(each.best_sigma))
        for each in plan.given_up[:_SHOWN_LOSSES]
    )
    more = len(plan.given_up) - len(rows)
    caption = "In standard deviations, at usual sizes." + (f" {more} more pairs." if more else "")
    blocks.append(doc.Grid(("separation", "double", "best"), rows, caption=caption))
    return doc.Section("The fewest readings", tuple(blocks))


def _what(cause: Cause, rival: Cause | None) -> str:
    return f"{cause.id} from {'nothing' if rival is None else rival.id}"
