"""The document of `orthocal plan`: what a session will give, what limits it, other ways."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from orthoglide_cal.errors import command, file_words, visible
from orthoglide_cal.estimation.budget import Budget
from orthoglide_cal.model import Cause, Machine, Model
from orthoglide_cal.model.orthoglide import OFFSET_MM
from orthoglide_cal.model.vocabulary import Vocabulary
from orthoglide_cal.planning import Next
from orthoglide_cal.planning.bar import MARGIN
from orthoglide_cal.planning.design import GIVES_UP
from orthoglide_cal.planning.expected import Expected, Foreseen, Session
from orthoglide_cal.planning.prospect import MOST_COMPARED, ROUNDING, Comparison, GivenUp, Prospect
from orthoglide_cal.planning.separation import TRACE_SIGMA, Separations
from orthoglide_cal.planning.steps import MOST_CYCLES, Order, sequence_options
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.documents.budget import budget_section, source_words
from orthoglide_cal.report.documents.next_reading import next_data, next_section, told_apart
from orthoglide_cal.report.documents.parameters import by_joint
from orthoglide_cal.report.json import SCHEMA_VERSION, by_axis
from orthoglide_cal.report.shades import KEY, separation_lines, separation_panel
from orthoglide_cal.results import Calibration
from orthoglide_cal.words import counted, decimals_for, percent, plain, short, two_figures

_SHOWN_LOSSES = 12
_SHOWN_PAIRS = 4


def plan_document(
    plan: Prospect,
    machine_file: Path | None = None,
    begun: Calibration | None = None,
    following: Sequence[Next] = (),
) -> doc.Document:
    """The document, for any of the renderers.

    Args:
        plan: what a session of its own will give.
        machine_file: as the user gave it.
        begun: what the data say that there are already; None without any.
        following: what to measure beside them, best first; empty without any.
    """
    page = partial(_page, plan, machine_file, begun, following)
    return doc.Document(partial(plan_data, plan, following), page)


def plan_data(plan: Prospect, following: Sequence[Next] = ()) -> dict[str, Any]:
    """The contract's fields, then a few more; lengths in mm."""
    best, design = plan.best, plan.design
    return {
        "schema_version": SCHEMA_VERSION,
        "machine": plan.model.machine.name,
        "protocol": plan.protocol,
        "gauges": plan.stands,
        "cycles": plan.cycles,
        "by_cycles": [_expected_data(plan, each) for each in plan.by_cycles],
        **budget_data(plan.chosen, plan.floor, plan.model),
        "target": None
        if plan.target_mm is None
        else {
            "expanded_mm": plan.target_mm,
            "reached": plan.reached,
            "cycles": plan.cycles if plan.reached else None,
        },
        "compare": [_comparison_data(plan, each) for each in plan.compared],
        **separation_data(plan.separations),
        "design": {
            **_expected_data(plan, best),
            "gauge_at": design.gauge_at,
            "postures_mm": list(design.displacements_mm),
            "share_of_readings": plan.share,
            "given_up": [_loss_data(each) for each in plan.given_up],
        },
        **({"next": next_data(following, plan.model)} if following else {}),
    }


def budget_data(found: Foreseen, floor: Budget | None, model: Model) -> dict[str, Any]:
    """What adds to the uncertainty of the joint offsets, and what more readings leave of it."""
    return {
        "budget": [
            {
                "source": each.source,
                "type": each.evaluation,
                "std_mm": by_joint(model, each.std_mm),
            }
            for each in found.budget.contributions
        ],
        "limits": {
            "expanded_mm": None if floor is None else by_joint(model, floor.expanded_mm),
            "source": None if floor is None else floor.largest.source,
        },
    }


def separation_data(found: Separations) -> dict[str, Any]:
    """Which causes can be told apart, and which leave no trace."""
    return {
        "separation": [{"causes": [a.id, b.id], "sigma": sigma} for a, b, sigma in found.pairs],
        "invisible": [cause.id for cause in found.invisible],
    }


def _expected_data(plan: Prospect, found: Expected) -> dict[str, Any]:
    session = found.session
    return {
        "cycles": session.cycles,
        "readings": session.readings,
        "gauge_moves": session.moves,
        "minutes": round(session.minutes, 2),
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
    plan: Prospect,
    machine_file: Path | None,
    begun: Calibration | None,
    following: Sequence[Next],
) -> doc.Page:
    machine = plan.model.machine
    gauge = ("Gauge", f"one reading scatters by {two_figures(machine.gauge.noise_mm)} mm")
    taken = ("Protocol", f"{plan.protocol}, {counted(plan.cycles, 'cycle')}")
    assumed = ("Offsets", f"about {OFFSET_MM:g} mm each are assumed")
    facts: tuple[tuple[str, str], ...] = (taken, gauge, assumed)
    notice = _notice(plan)
    first: tuple[doc.Section, ...] = ()
    to_do = doc.Instruction("Measure it.", _command(plan.chosen.session, plan, machine_file))
    if plan.bar_warning is not None and plan.bar_warning.leaves:
        fitting = _command(plan.best.session, plan, machine_file)
        to_do = doc.Instruction("Measure what the plungers can follow.", fitting)
    if begun is not None and following:
        best = following[0]
        to_do = doc.Instruction(best.option.what, _go_on(best, begun, machine_file))
        alone = (doc.Facts((taken, assumed)), notice)
        first = (
            next_section(following, _known_mm(begun)),
            doc.Section("A session of its own would give", alone),
        )
        facts = (("Readings", _read(begun)), gauge)
        notice = _next_notice(plan, begun, following)
    return doc.Page(
        kind="Plan",
        title=machine.name,
        facts=doc.Facts(facts),
        notice=notice,
        sheet=(doc.Section("What to do next", (doc.Instructions((to_do,)),)),),
        sections=(
            *first,
            _by_cycles(plan),
            budget_section(plan.chosen.budget, plan.model.machine),
            _compared(plan),
            separation_section(
                plan.separations,
                counted(min(plan.cycles, MOST_COMPARED), "cycle"),
                plan.model.machine.vocabulary,
            ),
            _design(plan, machine_file),
        ),
    )


def _command(session: Session, plan: Prospect, machine_file: Path | None) -> str:
    """What to type to measure a session."""
    told = sequence_options(session.protocol, session.cycles, Order.PAPER, plan.stands)
    return command("measure", machine=machine_file, options=told)


def _go_on(best: Next, begun: Calibration, machine_file: Path | None) -> str | None:
    """What to type to measure it beside data that there are; None where these have no file."""
    if best.option.session is not None:
        return command("measure", machine=machine_file, options=best.option.session)
    path = begun.input.measured.source.path
    return None if path == "-" else command("measure --then", path, machine=machine_file)


def _read(begun: Calibration) -> str:
    """The data that there are."""
    measured = begun.input.measured
    return f"{file_words(visible(measured.source.path))}, {len(measured)}"


def _known_mm(begun: Calibration) -> float | None:
    """The largest U of the offsets that there are; None if there are none to be entered."""
    found = begun.adjustment
    return None if found is None else float(found.expanded_mm.max())


def _next_notice(plan: Prospect, begun: Calibration, following: Sequence[Next]) -> doc.Notice:
    """What to measure beside the data that there are, and what it brings."""
    now, best = _known_mm(begun), following[0]
    then = f"± {two_figures(float(best.expanded_mm.max()))} mm"
    target = () if plan.target_mm is None else (_target_line(plan.target_mm, now, following),)
    title = f"about {max(best.option.minutes, 1.0):.0f} min: {best.option.what}"
    worth = f"Each offset is then known within {then}."
    if best.separates:
        first, second = told_apart(best)
        settled = f"It leaves one name with a chance of {percent(best.chance)}: it tells {first}"
        return doc.Notice(
            doc.Tone.INFO, f"Next, {title}", (f"{settled} from {second}. {worth}", *target)
        )
    today = "" if now is None else f" Now it is ± {two_figures(now)} mm."
    if begun.release.usable:
        lines = (
            "Nothing is open, and the offsets may be entered.",
            f"To know them better, {title}",
        )
        return doc.Notice(
            doc.Tone.GOOD, "Nothing needs to be measured", (*lines, worth + today, *target)
        )
    return doc.Notice(doc.Tone.INFO, f"Next, {title}", (worth + today, *target))


def _target_line(target_mm: float, now_mm: float | None, following: Sequence[Next]) -> str:
    """The quickest way to a U that was asked for, beside the data that there are."""
    wanted = f"± {_millimetres(target_mm)} mm"
    if now_mm is not None and now_mm <= target_mm:
        return f"{wanted} is reached already."
    able = [each for each in following if float(each.expanded_mm.max()) <= target_mm]
    if not able:
        return f"{wanted} is reached by none of these."
    quickest = min(able, key=lambda each: each.option.minutes).option
    return f"{wanted} takes about {max(quickest.minutes, 1.0):.0f} min: {quickest.what}"


def _notice(plan: Prospect) -> doc.Notice:
    """What the session gives, and what limits it."""
    session = plan.chosen.session
    title = f"{session.readings} readings, about {session.minutes:.0f} min"
    warning = plan.bar_warning
    if warning is not None and warning.leaves:
        return doc.Notice(doc.Tone.BAD, "This cannot be measured so", warning.lines)
    largest = two_figures(float(plan.chosen.expanded_mm.max()))
    careful = () if warning is None else warning.lines
    known = (
        f"Each offset will be known within ± {largest} mm (95 % if nothing else is wrong), the"
        f" tool everywhere within ± {two_figures(plan.tool_mm(plan.chosen))} mm."
    )
    if plan.target_mm is None:
        tone = doc.Tone.WARN if careful else doc.Tone.INFO
        return doc.Notice(tone, title, (*careful, known, _limit(plan)))
    wanted = f"± {_millimetres(plan.target_mm)} mm"
    if not plan.reached:
        why = _unreached(plan, plan.target_mm)
        return doc.Notice(doc.Tone.BAD, f"{wanted} cannot be reached so", (why, *careful, known))
    title = f"{wanted} takes {counted(session.cycles, 'cycle')}: {title}"
    return doc.Notice(doc.Tone.GOOD, title, (*careful, known, _limit(plan)))


def _millimetres(value: float) -> str:
    """A length as it was asked for, however small."""
    return short(value, 6) if value >= 1e-6 else f"{value:g}"


def _unreached(plan: Prospect, target_mm: float) -> str:
    """Why the target is out of reach: what cannot be seen, or noise."""
    floor = plan.floor
    if floor is not None and float(floor.expanded_mm.max()) > target_mm:
        return _floor_words(floor, plan.model.machine)
    return (
        f"More than {MOST_CYCLES} cycles would do, because of the scatter of the readings: take a"
        " finer gauge or a better stand."
    )


def _floor_words(floor: Budget, machine: Machine) -> str:
    what, remedy = source_words(floor.largest, machine)
    left = two_figures(float(floor.expanded_mm.max()))
    return f"After {MOST_CYCLES} cycles ± {left} mm stay: {what}. {remedy}"


def _limit(plan: Prospect) -> str:
    """Noise, or what more cycles do not lessen."""
    chosen, floor = plan.chosen.budget, plan.floor
    stays = 0.0 if floor is None else float(np.max(floor.std_mm / chosen.std_mm))
    if floor is None or stays < 0.6:
        return "The scatter of the readings limits it: more cycles help."
    help_ = "hardly help" if stays > 0.87 else "help little"
    return f"More cycles {help_}. {_floor_words(floor, plan.model.machine)}"


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
    wanted = float(plan.chosen.expanded_mm.max())
    reached = [float(way.same_cycles.expanded_mm.max()) for way in plan.compared]
    # As many decimals as show of every way that takes longer that it is less sure.
    next_ = min((each for each in reached if each > wanted * (1.0 + ROUNDING)), default=math.inf)
    decimals = next(d for d in count(decimals_for(wanted)) if round(next_, d) > round(wanted, d))
    for way, worst in zip(plan.compared, reached, strict=True):
        found = way.as_sure
        numbers = (
            (found.session.cycles, found.session.readings, found.session.moves)
            if found
            else ("", "never", "")
        )
        minutes = f"{found.session.minutes:.0f}" if found else ""
        reach = plain(worst, decimals)
        rows.append((way.protocol, way.method, reach, *map(str, numbers), minutes))
    head = ("protocol", "method", "U", "cycles", "readings", "moves", "min")
    caption = (
        f"U: of the worst offset with {counted(plan.cycles, 'cycle')}, mm. Then what it takes for"
        f" ± {plain(wanted, decimals)} mm. Moves: a stand is put to another place; a gauge alone"
        " stays at one end of the leg as long as it can (--order fewest-moves)."
    )
    grid = doc.Grid(head, tuple(rows), words=(0, 1), caption=caption)
    return doc.Section("Other ways to the same uncertainty", (grid,))


def separation_section(found: Separations, by: str, vocabulary: Vocabulary) -> doc.Section:
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
        rows = tuple((cause.id, vocabulary.said(cause.instrument)) for cause in hidden)
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
    given_up = (
        f"The plunger keeps {percent(MARGIN)} of the leg from both joints at every posture. What"
        f" is given up: {GIVES_UP}."
    )
    blocks: list[doc.Block] = [
        doc.Paragraph(sentence),
        doc.Paragraph(
            (
                f"{session.readings} readings in {session.minutes:.0f} min give ± {reach} mm: ",
                doc.Command(_command(session, plan, machine_file)),
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
