"""The document of `orthocal plan`: what a session will give, what limits it, other ways."""

import string
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import command, file_words, visible
from orthoglide_cal.estimation.budget import Budget
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.planning.plan import (
    MOST_COMPARED,
    TRACE_SIGMA,
    MeasurementPlan,
    SessionForecast,
)
from orthoglide_cal.planning.steps import GIVES_UP, MOST_CYCLES
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.documents.answer import budget_section, decision_notice, source_words
from orthoglide_cal.report.sentences import cause_words, sentence
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import counted, listed, percent, two_figures, unit_words

_SHOWN_PAIRS, _SHOWN_NEXT, _BRIEF_NEXT = 4, 6, 3
# Two causes less than so many σ apart may not be distinguished: the darker, the less.
_SHADES = ((1.0, "█"), (2.0, "▓"), (4.0, "▒"))
_MOST_SIGMA = 99  # beyond which the number says nothing more
# Where the places to probe are written, unless somebody chose another name.
_PLACES = "places.csv"


def plan_document(
    plan: MeasurementPlan, machine_file: Path | None = None, begun: Case | None = None
) -> doc.Document:
    """The document; `begun`: the data that there are already, and what they say."""
    going_on = begun if plan.next else None
    if going_on is not None:
        # The largest U of the lengths that there are; None if there are none to be entered.
        answer = going_on.answer
        lengths = (row.expanded for row in answer.parameters if row.unit == "mm")
        plan = plan.changed(now_mm=max(lengths, default=None), simulated=answer.simulated)
    absent = None if plan.next else {"next"}
    data = partial(plan.model_dump, mode="json", by_alias=True, exclude=absent, context=sentence)
    if going_on is not None and not plan.next[0].between and plan.now_mm is not None:
        # Nothing is advised that does not lower U.
        now = float(two_figures(plan.now_mm))
        lower = (e for e in plan.next if float(two_figures(max(e.expanded_mm.values()))) < now)
        plan = plan.changed(next=tuple(lower))

    def screen() -> doc.Page:
        if going_on is not None:
            notice = _next_notice(plan, going_on)
            best = going_on.answer.release.usable  # it is not what comes next
            title = "To reduce U" if best else "Or"
            sections = [doc.Section(title, _next_grid(plan, chosen=slice(not best, _BRIEF_NEXT)))]
        else:
            notice, (first, *others) = _notice(plan), _limits(plan)
            sections = [doc.Section(None, _sessions_grid(plan, brief=True), first)]
            sections.append(doc.Section(None, *others))
        to_do = _to_do(plan, machine_file, begun)
        sections.append(doc.next_steps(to_do, "More: the same with --details"))
        return doc.Page("Plan", simulated=plan.simulated, notice=notice, sections=sections)

    def page() -> doc.Page:
        machine = plan.model.machine
        session = [("Session", plan.chosen.what)]
        if plan.assumed_mm is not None:
            assumed = f"about {plan.assumed_mm:g} mm each are assumed"
            session.append((machine.vocabulary.many.capitalize(), assumed))
        facts, notice = doc.Facts(session), _notice(plan)
        sections: list[doc.Section] = []
        if going_on is not None:
            ranked = _next_grid(plan) if plan.next else None
            sections.append(doc.Section("What to measure next, best first", ranked))
            sections.append(doc.Section("A separate session would give", facts, notice))
            given = going_on.answer.input
            data = f"{file_words(visible(given.path))}, {given.readings}"
            facts, notice = doc.Facts([("Readings", data)]), _next_notice(plan, going_on)
        title = "Ways to measure, compared" if plan.gauges is None else "How many cycles"
        sections.append(doc.Section(title, _sessions_grid(plan)))
        sections.append(doc.Section(None, *_limits(plan)))
        if plan.compare and plan.design:
            typed = doc.typed(_command(plan.design, machine_file, begun))
            of = {"best": plan.design, "lacks": GIVES_UP}
            codes = ("design_postures", "design_gives", "design_gives_up")
            where, gives, lacks = (sentence(Reason.of(code, **of)) for code in codes)
            best = doc.Section("The fewest readings", where, (gives, typed), lacks)
            sections += [_ways(plan), best]
        sections += [budget_section(machine, plan.chosen.budget), _separation(plan)]
        sheet, named = [doc.next_steps(_to_do(plan, machine_file, begun))], plan.machine
        made = doc.Page("Plan", named, facts=facts, notice=notice, sheet=sheet, sections=sections)
        return replace(made, simulated=plan.simulated)

    return doc.Document(data, page, screen)


def _to_do(
    plan: MeasurementPlan, machine_file: Path | None, begun: Case | None
) -> Iterator[doc.Line]:
    chosen, typed = plan.chosen, partial(_command, machine=machine_file, begun=begun)
    usable = begun is not None and begun.answer.release.usable
    if begun and (usable or plan.next):
        if usable:
            see = "what to enter" if begun.answer.release.needed else "the numbers"
            yield doc.step(f"See {see}", begun.typed("solve"))
        for best in plan.next[:1]:
            reduce = "Or, to reduce U: " * usable
            yield doc.step(f"{reduce}{sentence(best.what)}", begun.further(best.session))
    elif begun and begun.answer.release.remedies:
        yield from begun.remedies()
    elif plan.bar_warning is not None and plan.bar_warning.size > 0.0 and plan.design is not None:
        yield doc.step("Measure what the plungers can follow", typed(plan.design))
    elif plan.gauges is not None:
        yield doc.step("Measure it", typed(chosen))
    else:
        text = "Write the places to a file, probe them in this order, fill in reading_mm"
        yield doc.step(text, typed(chosen))
        yield doc.step("See the result", command("diagnose", _PLACES, machine=machine_file))
        design = plan.design
        if design is not None and design.name != chosen.name:
            rivals = " from ".join(plan.model.machine.rivals)
            size = f"{design.readings} readings, {design.minutes:.0f} min"
            chance = f"probability {percent(design.chance)}"
            yield doc.step(f"Or distinguish {rivals} ({chance}): {size}", typed(design))


def _command(forecast: SessionForecast, machine: Path | None, begun: Case | None) -> str:
    if forecast.session is not None:
        return command("measure", machine=machine, options=forecast.session.options)
    options = f"--layout {forecast.name} --program {_PLACES}"
    if begun:
        return begun.typed("plan", options)
    return command("plan", machine=machine, options=options)


def _reach(model: Model, expanded: Floats) -> str:
    """U of each parameter (p,), or the largest where they are all alike."""
    machine = model.machine
    if machine.common_unit:
        return f"each {machine.vocabulary.one} within ± {two_figures(float(expanded.max()))} mm"
    alike: dict[str, list[str]] = {}
    columns = zip(machine.parameter_names, expanded.tolist(), machine.parameter_units, strict=True)
    for name, u, unit in columns:
        alike.setdefault(f"± {two_figures(u)} {unit_words(unit)}", []).append(name)
    return "; ".join(f"{', '.join(names)} {u}" for u, names in alike.items())


def _notice(plan: MeasurementPlan) -> doc.Notice:
    """Gains of the session, and its gaps."""
    chosen, warning, machine = plan.chosen, plan.bar_warning, plan.model.machine
    near = warning[:2] if warning else ()
    if warning and warning.size > 0.0:
        return doc.Notice(doc.Tone.BAD, "This cannot be measured in this way", near)
    words, noise = machine.vocabulary, two_figures(plan.noise_mm)
    title = f"{chosen.readings} readings, about {chosen.minutes:.0f} min"
    reach = f"{_reach(plan.model, chosen.budget.expanded_mm)} (95 %)"
    lines = [f"{machine.name}, {chosen.what}, {words.noise} noise {noise} mm"]
    lines += [f"U: {reach}"] * (not machine.common_unit)
    lines += near
    title += f": {reach}" * bool(machine.common_unit)
    missing = [name for name, row in chosen.parameters.items() if not row["determined"]]
    if missing:
        lines.append(f"Not determined: {' and '.join(missing)}. {words.more}")
    tone = doc.Tone.WARN if warning or missing else doc.Tone.INFO
    if plan.target is not None:
        wanted = f"± {plan.target.expanded_mm:g} mm"
        if plan.target.reached:
            tone, title = doc.Tone.GOOD, f"{wanted} takes {counted(plan.cycles, 'cycle')}: {title}"
        else:
            why = sentence(Reason.of("too_many_cycles", most=MOST_CYCLES))
            if plan.floor is not None and plan.floor.expanded_mm.max() > plan.target.expanded_mm:
                remedy = source_words(plan.floor.largest.source, machine)[1]
                why = f"{_stays(plan, plan.floor)} {remedy}"
            lines = [why, f"{title}.", *lines]
            tone, title = doc.Tone.BAD, f"{wanted} cannot be reached in this way"
    return doc.Notice(tone, title, tuple(lines))


def _stays(plan: MeasurementPlan, floor: Budget) -> str:
    source = floor.largest.source
    source = source if source in CAUSES else source_words(source, plan.model.machine)[0]
    if plan.gauges is None:
        return f"{source} remains."
    return f"± {two_figures(float(floor.expanded_mm.max()))} mm remains ({source})."


def _limits(plan: MeasurementPlan) -> Iterator[str]:
    """The part of U that more readings leave, causes that do not show, and a shorter way."""
    best, chosen, floor, sigma = plan.design, plan.chosen, plan.floor, plan.chosen.rivals_sigma
    stays = 0.0 if floor is None else float(np.max(floor.std_mm / chosen.budget.std_mm))
    more = "readings" if plan.gauges is None else "cycles"
    if floor is None or stays < 0.6:
        yield f"The scatter of the readings limits U: more {more} help."
    else:
        help_ = "hardly help" if stays > 0.87 else "help little"
        yield f"More {more} {help_}: {_stays(plan, floor)}"
    if sigma is not None and sigma >= TRACE_SIGMA:
        rivals, odds = " and ".join(plan.model.machine.rivals), percent(chosen.chance)
        yield f"{rivals} are distinguished: probability {odds} ({two_figures(sigma)} σ)."
    if plan.invisible:
        yield f"Cannot be seen: {listed(plan.invisible)}."
    seen = (pair for pair in plan.separation if plan.trace.keys() >= {*pair.causes})
    near = [" from ".join(pair.causes) for pair in seen if pair.sigma < TRACE_SIGMA]
    if near:
        rest = ", and others" * (len(near) > _SHOWN_PAIRS)
        yield f"Cannot be distinguished: {', '.join(near[:_SHOWN_PAIRS])}{rest}."
    if best and best.session and best.name != chosen.name and best.minutes < chosen.minutes:
        size = f"{best.readings} readings, {best.minutes:.0f} min"
        yield f"Shorter: {size} (--design best); some faults show less."


def _sessions_grid(plan: MeasurementPlan, *, brief: bool = False) -> doc.Grid:
    """Numbers of cycles, or layouts: what they take, what they give; units in the caption.

    `brief`: of layouts without it.
    """
    machine, cycles = plan.model.machine, plan.gauges is not None
    shown = plan.by_cycles
    names: list[doc.Inline] = [str(session.cycles) if cycles else session.name for session in shown]
    for k, session in enumerate(shown):
        if (session.name, session.cycles) == (plan.protocol, plan.cycles):
            names[k] = doc.strong(f"→ {names[k]}")
    columns = {"cycles" if cycles else "layout": names}
    columns["readings"] = [str(session.readings) for session in shown]
    columns["min"] = [f"{session.minutes:.0f}" for session in shown]
    named = zip(machine.parameter_names, map(unit_words, machine.parameter_units), strict=True)
    unit = machine.common_unit or f": {', '.join(map(' in '.join, named))}"
    meaning = [f"U of each {machine.vocabulary.one}{unit} (95 %); –: not determined."]
    if cycles:
        columns["noise"] = [two_figures(max(session.noise_std_mm.values())) for session in shown]
        meaning.append("Noise: the part of u from scatter.")
    for name in machine.parameter_names:
        rows = (session.parameters[name] for session in shown)
        columns[name] = [two_figures(row["expanded"]) if row["determined"] else "–" for row in rows]
    if plan.chosen.tool_mm is not None:
        columns["tool"] = [two_figures(session.tool_mm or 0.0) for session in shown]
        meaning.append("Tool: U at the worst point of the workspace, offsets entered.")
    sigma = [session.rivals_sigma for session in shown]
    if any(size is not None for size in sigma):
        columns["σ"] = ["" if size is None else f"{size:.1f}" for size in sigma]
        pair = " and ".join(machine.rivals)
        meaning.append(f"σ: distance of {pair} of usual size, in standard deviations.")
    caption = " ".join(meaning) if cycles or not brief else ""
    return doc.Grid.of(columns, () if cycles else (0,), caption)


def _ways(plan: MeasurementPlan) -> doc.Section:
    rows = []
    for way in plan.compare:
        sizes = way.cycles, way.readings, way.gauge_moves
        rows.append((way.name, way.method, *map(str, sizes), f"{way.minutes:.0f}"))
    head = ("protocol", "method", "cycles", "readings", "moves", "min")
    caption = sentence(Reason.of("ways", worst_mm=plan.chosen.worst_mm, most=MOST_CYCLES))
    grid = doc.Grid(head, rows, words=(0, 1), caption=caption)
    return doc.Section("Other ways to the same uncertainty", grid)


def _separation(plan: MeasurementPlan) -> doc.Section:
    """Causes that the readings can distinguish: the lower half of a table of their distances."""
    names, letters = [*plan.trace], string.ascii_uppercase
    sigma = {pair.causes: pair.sigma for pair in plan.separation}
    rows: list[list[doc.Blank]] = []
    for k, (id, sound) in enumerate(plan.trace.items()):
        sizes = [sound, *(sigma[other, id] for other in names[:k])]
        shades = (next((sign for most, sign in _SHADES if size < most), "") for size in sizes)
        shown = map(str.__add__, shades, (str(min(int(size), _MOST_SIGMA) or "") for size in sizes))
        rows.append([f"{letters[k]} {id}", *shown, *[""] * (len(names) - 1 - k)])
    heads, caption = ("", "–", *letters[: len(names) - 1]), Reason.of("distances", most=_MOST_SIGMA)
    distances = doc.Grid(heads, rows, caption=sentence(caption))
    unseen = [(id, cause_words(id, plan.model.machine)["check"]) for id in plan.invisible]
    hardly = "At their usual size they hardly change such readings."
    checks = doc.Grid(("not seen", "what would show it"), unseen, (0, 1), hardly)
    title = "Which causes can be distinguished"
    title += f" by {MOST_COMPARED} cycles" * (plan.cycles > MOST_COMPARED)
    return doc.Section(title, distances if rows else "No cause leaves a trace.", checks)


def _next_notice(plan: MeasurementPlan, begun: Case) -> doc.Notice:
    """The best measurement in addition to the data that there are, and its gain."""
    release, decided, clear = begun.answer.release, decision_notice(begun), "Nothing is undecided"
    if begun.answer.verdict is Verdict.AMBIGUOUS:
        clear = "No further reading is likely to decide what is open"
    if not plan.next:
        none = f"{clear}, and no further {plan.model.machine.vocabulary.noise} readings lower U."
        title = "Nothing needs to be measured"
        return doc.Notice(decided.tone, title, (none,)) if release.usable else decided
    best, now = plan.next[0], plan.now_mm
    minutes = f"about {max(best.minutes, 1.0):.0f} min"
    today = "" if now is None else f" The largest is now ± {two_figures(now)} mm."
    worth = [f"With it: {_reach(plan.model, best.expanded)}.{today}"]
    tone, title = doc.Tone.INFO, f"Next: {minutes}"
    if best.between:
        title += f" give one answer (probability {percent(best.chance)})"
        worth.insert(0, sentence(Reason.of("distinguishes", best=best)))
    elif release.usable:
        tone, title, may = decided.tone, clear, f"{decided.title}."
        worth[:1] = [may, f"To reduce U: {minutes}. {worth[0]}"]
    return doc.Notice(tone, title, tuple(worth))


def _next_grid(plan: MeasurementPlan, *, chosen: slice | None = None) -> doc.Grid:
    """The ranking, U as it is, and what the columns mean; or only the `chosen` ones."""
    telling = any(option.between for option in plan.next)
    heads = ["", "min", *(("settles", "σ") if telling else ()), "U, mm", "what to do"]
    rows, words = [], (len(heads) - 1,)
    for number, option in enumerate(plan.next[:_SHOWN_NEXT], 1):
        sure = (percent(option.chance), f"{option.separation_sigma:.1f}") if telling else ()
        u_mm = two_figures(max(option.expanded_mm.values()))
        rows.append((str(number), f"{option.minutes:.0f}", *sure, u_mm, sentence(option.what)))
    if chosen:
        return doc.Grid(heads, rows[chosen], words)
    if plan.now_mm is not None:
        rows.insert(0, (*[""] * (len(heads) - 2), two_figures(plan.now_mm), "nothing: U as it is"))
    code = "ranked_by_time" if plan.next[0].between else "ranked_by_u"
    return doc.Grid(heads, rows, words, sentence(Reason.of(code, best=plan.next[0])))
