"""The document of `orthocal plan`: what a session will give, what limits it, other ways.

The diagnosis shows the best of the next measurements, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import command, file_words, visible
from orthoglide_cal.estimation.budget import Budget
from orthoglide_cal.model import Floats, Model, Source
from orthoglide_cal.planning.bar import MARGIN
from orthoglide_cal.planning.design import GIVES_UP
from orthoglide_cal.planning.forecast import SessionForecast
from orthoglide_cal.planning.plan import (
    CERTAIN_SIGMA,
    MOST_COMPARED,
    ROUNDING,
    BestDesign,
    MeasurementPlan,
)
from orthoglide_cal.planning.separation import TRACE_SIGMA
from orthoglide_cal.planning.steps import MOST_CYCLES, MeasuringProtocol, Order, sequence_options
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import about
from orthoglide_cal.report.documents.diagnosis import between_words
from orthoglide_cal.report.documents.parameters import budget_section, common_unit, source_words
from orthoglide_cal.report.figures import separation_lines
from orthoglide_cal.results import Answer, budget_lines
from orthoglide_cal.words import (
    counted,
    decimals_for,
    percent,
    plain,
    short,
    two_figures,
    unit_words,
)

_SHOWN_PAIRS = 4
_SHOWN_NEXT = 6
# Where the places to probe are written, unless somebody chose another name.
_PLACES = "places.csv"


def plan_document(
    plan: MeasurementPlan,
    machine_file: Path | None = None,
    begun: Answer | None = None,
    source: Source | None = None,
) -> doc.Document:
    """The document, for any of the renderers.

    Args:
        plan: what a session of its own will give, and what to measure next.
        machine_file: as the user gave it.
        begun: what the data say that there are already; None without any.
        source: of these data.
    """
    page = partial(_page, plan, machine_file, begun, source)
    absent = None if plan.next else {"next"}
    return doc.Document(partial(plan.model_dump, mode="json", by_alias=True, exclude=absent), page)


def _page(
    plan: MeasurementPlan, machine_file: Path | None, begun: Answer | None, source: Source | None
) -> doc.Page:
    model, vocabulary = plan.model, plan.model.machine.vocabulary
    noise = two_figures(model.machine.instrument.noise_mm)
    scatter = (vocabulary.noise.capitalize(), f"one reading scatters by {noise} mm")
    session = [("Session", plan.chosen.what)]
    size = float(np.sqrt(np.mean(model.machine.linearization_points**2)))
    if size > 0.0:
        session.append((vocabulary.many.capitalize(), f"about {size:g} mm each are assumed"))
    facts, notice = (*session, scatter), _notice(plan)
    first: tuple[doc.Section, ...] = ()
    if begun is not None and plan.next:
        data = f"{file_words(visible(begun.input.path))}, {begun.input.readings}"
        # The largest U of the lengths that there are; None if there are none to be entered.
        now = max((each.expanded for each in begun.parameters if each.unit == "mm"), default=None)
        alone = (doc.Facts(tuple(session)), notice)
        first = (_next_section(plan, now), doc.Section("A session of its own would give", alone))
        facts, notice = (("Readings", data), scatter), _next_notice(plan, begun, now)
    return doc.Page(
        kind="Plan",
        title=plan.machine,
        facts=doc.Facts(facts),
        notice=notice,
        sheet=(
            doc.Section(
                "What to do next", (doc.Instructions(tuple(_to_do(plan, machine_file, source))),)
            ),
        ),
        sections=(
            *first,
            _sessions(plan),
            *([_ways(plan)] if plan.compare else []),
            *([_design(plan, plan.design, machine_file, source)] if plan.design else []),
            budget_section(model.machine, *budget_lines(plan.chosen.budget)),
            _separation(plan),
        ),
    )


def _to_do(
    plan: MeasurementPlan, machine_file: Path | None, source: Source | None
) -> Iterator[doc.Instruction]:
    """Measure what is best next, or the session."""
    chosen, probing = plan.chosen, plan.model.machine.vocabulary.probing
    if plan.next:
        best = plan.next[0].option
        typed = None
        if best.session is not None:
            typed = command("measure", machine=machine_file, options=best.session)
        elif not probing and source is not None and source.path != "-":
            typed = command("measure --then", source.path, machine=machine_file)
        yield doc.Instruction(best.what, typed)
    elif plan.bar_warning is not None and plan.bar_warning.leaves and plan.design is not None:
        typed = _command(plan.design, plan, machine_file, source)
        yield doc.Instruction("Measure what the plungers can follow.", typed)
    elif not probing:
        yield doc.Instruction("Measure it.", _command(chosen, plan, machine_file, source))
    elif not chosen.can_be_sent:
        yield doc.Instruction(probing)
    else:
        typed = _command(chosen, plan, machine_file, source)
        yield doc.Instruction("Have the places to probe written.", typed)
        yield doc.Instruction("Probe them in this order, and fill in the column reading_mm.")
        typed = command("diagnose", _PLACES, machine=machine_file)
        yield doc.Instruction("See what they say.", typed)


def _command(
    found: SessionForecast, plan: MeasurementPlan, machine: Path | None, source: Source | None
) -> str:
    """What to type to measure a session, or to have its places written."""
    if plan.gauges is not None:
        protocol = MeasuringProtocol(found.name)
        options = sequence_options(protocol, found.cycles, Order.PAPER, plan.gauges)
        return command("measure", machine=machine, options=options)
    usual = (plan.design or plan.by_cycles[0]).name
    named = "" if found.name == usual else f"--layout {found.name} "
    options = f"{named}--program {_PLACES}"
    if source is None:
        return command("plan", machine=machine, options=options)
    return about("plan", source, machine=machine, options=options)


def _reach(model: Model, expanded: Floats) -> str:
    """U of each parameter (p,), or the largest where they are all alike."""
    machine = model.machine
    if common_unit(machine):
        return f"each {machine.vocabulary.one} within ± {two_figures(float(expanded.max()))} mm"
    columns = zip(machine.parameter_names, expanded.tolist(), machine.parameter_units, strict=True)
    return ", ".join(f"{name} ± {two_figures(u)} {unit_words(unit)}" for name, u, unit in columns)


def _notice(plan: MeasurementPlan) -> doc.Notice:
    """What the session gives, what limits it, and what it leaves open."""
    chosen, warning, model = plan.chosen, plan.bar_warning, plan.model
    if warning is not None and warning.leaves:
        return doc.Notice(doc.Tone.BAD, "This cannot be measured so", warning.lines)
    reach = _reach(model, chosen.budget.expanded_mm)
    if chosen.tool_mm is not None:
        reach += f", the tool everywhere within ± {two_figures(chosen.tool_mm)} mm"
    missing = [name for name, each in chosen.parameters.items() if not each.determined]
    lines = [
        *(warning.lines if warning else ()),
        f"Known: {reach} (95 % if nothing else is wrong).",
    ]
    if missing:
        more = model.machine.vocabulary.more
        lines.append(f"They do not determine {' and '.join(missing)}. {more}")
    title = f"{chosen.readings} readings, about {chosen.minutes:.0f} min"
    tone = doc.Tone.WARN if warning or missing else doc.Tone.INFO
    if plan.target is not None:
        wanted = f"± {plan.target.expanded_mm:g} mm"
        if not plan.target.reached:
            why = (
                f"More than {MOST_CYCLES} cycles would do, because of the scatter of the readings:"
                " take a finer gauge or a better stand."
            )
            if plan.floor is not None and plan.floor.expanded_mm.max() > plan.target.expanded_mm:
                why = _floor_words(plan, plan.floor)
            return doc.Notice(doc.Tone.BAD, f"{wanted} cannot be reached so", (why, *lines))
        title = f"{wanted} takes {counted(plan.cycles, 'cycle')}: {title}"
        tone = doc.Tone.GOOD
    return doc.Notice(tone, title, (*lines, _limit(plan), *_rivals(plan)))


def _floor_words(plan: MeasurementPlan, floor: Budget) -> str:
    what, remedy = source_words(floor.largest.source, plan.model.machine)
    if plan.gauges is None:
        return f"What stays of it is mostly this: {what}. {remedy}"
    left = two_figures(float(floor.expanded_mm.max()))
    return f"After {MOST_CYCLES} cycles ± {left} mm stay: {what}. {remedy}"


def _limit(plan: MeasurementPlan) -> str:
    """Noise, or what more readings do not lessen."""
    chosen, floor = plan.chosen.budget, plan.floor
    stays = 0.0 if floor is None else float(np.max(floor.std_mm / chosen.std_mm))
    more = "readings" if plan.gauges is None else "cycles"
    if floor is None or stays < 0.6:
        return f"The scatter of the readings limits it: more {more} help."
    help_ = "hardly help" if stays > 0.87 else "help little"
    return f"More {more} {help_}. {_floor_words(plan, floor)}"


def _rivals(plan: MeasurementPlan) -> Iterator[str]:
    """Whether the session distinguishes what hides behind each other."""
    sigma = plan.chosen.rivals_sigma
    if sigma is not None:
        first, second = (CAUSES[id].title for id in plan.model.machine.rivals)
        told = "are distinguished" if sigma >= CERTAIN_SIGMA else "are not distinguished for sure"
        yield f"That {first}, and that {second}, {told}: {two_figures(sigma)} standard deviations."


def _sessions(plan: MeasurementPlan) -> doc.Section:
    """The session with other numbers of cycles, or every layout: what it takes, what it gives."""
    machine, cycles = plan.model.machine, plan.gauges is not None
    tool, rivals = machine.has_cube, bool(machine.rivals)
    head = ["cycles" if cycles else "layout", "readings", "min", *["noise"] * cycles]
    head += [*machine.parameter_names, *["tool"] * tool, *["σ"] * rivals]
    rows = []
    for each in plan.by_cycles:
        name = str(each.cycles) if cycles else each.name
        chosen = (each.name, each.cycles) == (plan.protocol, plan.cycles)
        reach = each.averaged.expanded_mm.tolist() if each.averaged else []
        row: list[doc.Inline] = [doc.Strong(name) if chosen else name]
        row += [str(each.readings), f"{each.minutes:.0f}"]
        if cycles:
            row.append(two_figures(max(each.noise_std_mm.values())))
        row += [
            two_figures(value) if parameter.determined else "–"
            for value, parameter in zip(reach, each.parameters.values(), strict=True)
        ]
        if each.tool_mm is not None:
            row.append(two_figures(each.tool_mm))
        if rivals:
            row.append("" if each.rivals_sigma is None else f"{each.rivals_sigma:.1f}")
        rows.append(tuple(row))
    named = zip(machine.parameter_names, machine.parameter_units, strict=True)
    units = ", ".join(f"{name} {unit_words(unit)}" for name, unit in named)
    caption = "In mm." if common_unit(machine) else f"{units}; – is not determined."
    if cycles:
        caption += " Noise: what scatter leaves of the worst one, one standard deviation."
    caption += f" U: of each {machine.vocabulary.one}, 95 %."
    if tool:
        caption += " Tool: at the worst place of the workspace, offsets entered."
    if rivals:
        first, second = machine.rivals
        caption += (
            f" σ: how far {first} and {second} of usual size are apart, in standard deviations."
        )
    fixed = [
        each for each in plan.chosen.budget.contributions if each.source in machine.fixed_parameters
    ]
    if fixed:
        ids, added = " and ".join(each.source for each in fixed), Budget(tuple(fixed)).expanded_mm
        rows.append((ids, "", "", *map(two_figures, added.tolist()), ""))
        caption += (
            f" No layout determines {ids}, taken as stated: what it adds (by squares) is the last"
            " row. In solve, what the readings cannot rule out is added."
        )
    grid = doc.Grid(tuple(head), tuple(rows), words=() if cycles else (0,), caption=caption)
    return doc.Section("How many cycles" if cycles else "Ways to measure, compared", (grid,))


def _ways(plan: MeasurementPlan) -> doc.Section:
    """Every protocol and method for the same uncertainty."""
    rows = []
    wanted = max(plan.chosen.expanded_mm.values())
    reached = [max(way.same_cycles.expanded_mm.values()) for way in plan.compare]
    # As many decimals as show of every way that takes longer that it is less sure.
    next_ = min((each for each in reached if each > wanted * (1.0 + ROUNDING)), default=math.inf)
    decimals = next(d for d in count(decimals_for(wanted)) if round(next_, d) > round(wanted, d))
    for way, worst in zip(plan.compare, reached, strict=True):
        found = way.same_expanded
        numbers = ["", "never", "", ""]
        if found is not None:
            numbers = [*map(str, (found.cycles, found.readings, found.gauge_moves))]
            numbers.append(f"{found.minutes:.0f}")
        rows.append((way.protocol, way.method, plain(worst, decimals), *numbers))
    head = ("protocol", "method", "U", "cycles", "readings", "moves", "min")
    caption = (
        f"U: of the worst offset with {counted(plan.cycles, 'cycle')}, mm. Then what it takes for"
        f" ± {plain(wanted, decimals)} mm. Moves: a stand is put to another place; a gauge alone"
        " stays at one end of the leg as long as it can (--order fewest-moves)."
    )
    grid = doc.Grid(head, tuple(rows), words=(0, 1), caption=caption)
    return doc.Section("Other ways to the same uncertainty", (grid,))


def _design(
    plan: MeasurementPlan, best: BestDesign, machine_file: Path | None, source: Source | None
) -> doc.Section:
    """The fewest readings, or the quickest layout that distinguishes the rivals."""
    minutes = f"about {best.minutes:.0f} min"
    typed = _command(best, plan, machine_file, source)
    if best.causes:
        pair = " and ".join(best.causes)
        reached = (
            f"The quickest that gets {pair} {CERTAIN_SIGMA:g} standard deviations apart"
            if best.reached
            else f"None gets {pair} {CERTAIN_SIGMA:g} standard deviations apart; this one gets"
            f" farthest, {two_figures(best.rivals_sigma or 0.0)}"
        )
        blocks: list[doc.Block] = [doc.Paragraph(f"{reached}: {best.what}, {minutes}.")]
        if best.name != plan.chosen.name:
            blocks.append(doc.Instructions((doc.Instruction("Have its places written.", typed),)))
        return doc.Section(f"To distinguish {pair}", tuple(blocks))
    postures = ", ".join(f"{short(moved, 3)} mm" for moved in best.postures_mm)
    reach = two_figures(max(best.expanded_mm.values()))
    return doc.Section(
        "The fewest readings",
        (
            doc.Paragraph(
                f"Only the postures {postures}, the gauges at {percent(best.gauge_at or 0.0)} of"
                f" the leg from the carriage: {percent(best.share_of_readings or 0.0)} of the"
                " readings of the double-posture protocol leave the same noise."
            ),
            doc.Paragraph(
                (f"{best.readings} readings in {minutes} give ± {reach} mm: ", doc.Typed(typed))
            ),
            doc.Paragraph(
                f"The plunger keeps {percent(MARGIN)} of the leg from both joints at every posture."
                f" What is given up: {GIVES_UP}."
            ),
        ),
    )


def _separation(plan: MeasurementPlan) -> doc.Section:
    """Which causes the readings can distinguish."""
    seen, hidden = plan.apart.visible, plan.apart.invisible
    by = counted(min(plan.cycles, MOST_COMPARED), "cycle")
    if plan.gauges is None:
        by = f"these {plan.chosen.readings} readings"
    names = [cause.id for cause in seen.causes]
    near = [" and ".join(pair.causes) for pair in seen.pairs if pair.sigma < TRACE_SIGMA]
    named = f": {'; '.join(near[:_SHOWN_PAIRS])}" if near else ""
    finding = (
        f"Of {len(seen.pairs)} pairs of causes of their usual size {len(near)} cannot be"
        f" distinguished by {by}{named}."
    )
    sketch = separation_lines(names, seen.sigma, seen.trace)
    figure = doc.Figure(None, finding, (), sketch=sketch)
    blocks: list[doc.Block] = [figure if names else doc.Paragraph("No cause leaves a trace.")]
    if hidden:
        rows = tuple((cause.id, cause.words(plan.model.machine).instrument) for cause in hidden)
        caption = "At their usual size they leave hardly a trace in such readings."
        head = ("not seen", "what would show it")
        blocks.append(doc.Grid(head, rows, words=(0, 1), caption=caption))
    return doc.Section("Which causes can be distinguished", tuple(blocks))


def _next_notice(plan: MeasurementPlan, begun: Answer, now: float | None) -> doc.Notice:
    """What to measure besides the data that there are, and what it brings."""
    best = plan.next[0]
    title = f"about {max(best.minutes, 1.0):.0f} min: {best.what}"
    worth = f"With it: {_reach(plan.model, best.expanded)}."
    target = _target_line(plan, now)
    if best.between:
        first, second = between_words(best)
        settled = f"It leaves one name with a chance of {percent(best.chance)}: it tells {first}"
        return doc.Notice(
            doc.Tone.INFO, f"Next, {title}", (f"{settled} from {second}. {worth}", *target)
        )
    today = "" if now is None else f" Now it is ± {two_figures(now)} mm."
    if begun.release.usable:
        lines = (
            f"Nothing is open, and the {plan.model.machine.vocabulary.many} may be entered.",
            f"To know them better, {title}",
        )
        return doc.Notice(
            doc.Tone.GOOD, "Nothing needs to be measured", (*lines, worth + today, *target)
        )
    return doc.Notice(doc.Tone.INFO, f"Next, {title}", (worth + today, *target))


def _target_line(plan: MeasurementPlan, now_mm: float | None) -> Iterator[str]:
    """The quickest way to a U that was asked for, with the data that there are."""
    if plan.target is None:
        return
    target_mm = plan.target.expanded_mm
    able = [each for each in plan.next if max(each.expanded_mm.values()) <= target_mm]
    said = "is reached by none of these."
    if now_mm is not None and now_mm <= target_mm:
        said = "is reached already."
    elif able:
        quickest = min(able, key=lambda each: each.minutes)
        said = f"takes about {max(quickest.minutes, 1.0):.0f} min: {quickest.what}"
    yield f"± {target_mm:g} mm {said}"


def _next_section(plan: MeasurementPlan, now_mm: float | None) -> doc.Section:
    """The best of the ranking as a table; `now_mm` is the largest U without it, if it is known."""
    found = plan.next
    telling = any(each.between for each in found)
    rows = [
        (
            str(number),
            f"{each.minutes:.0f}",
            *((percent(each.chance), f"{each.separation_sigma:.1f}") if telling else ()),
            two_figures(max(each.expanded_mm.values())),
            each.what,
        )
        for number, each in enumerate(found[:_SHOWN_NEXT], start=1)
    ]
    if now_mm is not None:
        blank = ("", "") if telling else ()
        rows.insert(0, ("", "", *blank, two_figures(now_mm), "nothing: U as it is"))
    heads = ("", "min", *(("settles", "σ") if telling else ()), "U, mm", "what to do")
    if found[0].between:
        first, second = between_words(found[0])
        meaning = (
            "Settles: the chance that one answer is left. Ranked by that chance per minute, eight"
            f" hours added for coming back if it stays open. σ: how far {first} and {second} are"
            " apart in the new readings, in standard deviations."
        )
    else:
        meaning = (
            "Nothing that further readings could tell is open: ranked by how much U they save per"
            " minute, half an hour added for the sitting."
        )
    grid = doc.Grid(heads, tuple(rows), words=(len(heads) - 1,), caption=meaning)
    return doc.Section("What to measure next, best first", (grid,))
