"""The document of `orthocal history`: what changed, when, how much, and what to do about it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from functools import partial
from itertools import pairwise
from pathlib import Path, PurePath

import numpy as np

from orthoglide_cal.errors import command
from orthoglide_cal.inference.sessions import Trend
from orthoglide_cal.model.model import Estimate
from orthoglide_cal.report import document as doc
from orthoglide_cal.report import figures
from orthoglide_cal.report.case import LARGEST_OFFSET, sizes_words
from orthoglide_cal.report.figures import below, line, thread
from orthoglide_cal.report.sentences import sentence
from orthoglide_cal.report.terminal import fitting
from orthoglide_cal.results.history import History
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    capitalized,
    counted,
    decimals_for,
    percent,
    plain,
    signed,
    two_figures,
    unit_words,
    with_uncertainty,
)

_MOST_CHANGES = 3  # in words
_MONTH = 30.0  # days, for which a drift is stated
_STORIES = {
    Trend.UNCHANGED: "no change",
    Trend.CHANGED: "a step",
    Trend.DRIFTING: "drift",
    Trend.SCATTERING: "scatter",
}


def history_document(history: History, machine_file: Path | None = None) -> doc.Document:
    """The document, with commands for this machine file."""
    see = command("solve", history.sessions[-1].path, machine=machine_file)
    says = partial(sentence, machine=history.newest)
    steps = doc.step(says(history.next)), doc.step("See the last session", see)
    more = "More: the same with --details, or as a page: --html history.html"
    notes, last = [*map(says, history.notes)], len(history.sessions) - 1
    begun = doc.Page("History", simulated=history.simulated, notice=_notice(history))

    def screen() -> doc.Page:
        # As many sessions as it has lines for, three at least: the ends, those at changes.
        around = (k for change in reversed(history.changes) for k in (change.at, change.at + 1))
        wanted = [*dict.fromkeys((last, 0, *around, *range(last - 1, 0, -1)))]
        kept, others = wanted[:3], wanted[3:24]

        def made() -> doc.Page:
            table = doc.Section(None, _table(history, {*kept, *others}), *notes[:3])
            return replace(begun, sections=[table, doc.next_steps(steps, more)])

        return fitting(made, others)

    def page() -> doc.Page:
        table = _table(history, {*range(last + 1)})
        expected = f"The next session is expected to find: {_sizes(history.prediction)} (95 %)."
        further = doc.Grid(
            ("further sessions", *(size.name for size in history.pooled)),
            [(str(count), *map(two_figures, u)) for count, u in history.further.items()],
            caption="U of the best values after so many further sessions (95 %).",
        )
        sheet = doc.Section("From session to session", _courses(history)), doc.next_steps(steps)
        shapes = doc.Section("Residuals of the touches", *_shapes(history))
        sessions = doc.Section("Sessions", table, *notes, expected, further)
        return replace(begun, title=history.machine, sheet=sheet, sections=[shapes, sessions])

    return doc.Document(partial(history.model_dump, mode="json", context=says), page, screen)


def _notice(history: History) -> doc.Notice:
    lines = list[str]()
    for change in history.changes[: -_MOST_CHANGES - 1 : -1]:
        when = f"{_label(history, change.at)} and {_label(history, change.at + 1)}"
        lines.append(f"Changed between {when}: {_sizes(change.parameters, ' by')}")
    if (earlier := len(history.changes) - _MOST_CHANGES) > 0:
        lines.append(f"{counted(earlier, 'earlier change')}, marked in the table")
    if history.drift and history.dated:
        lines.append(f"Drift in {_MONTH:g} days: {_sizes(_in_a_month(history))}")
    elif history.drift:
        lines.append(f"Drifting: {', '.join(rate.name for rate in history.drift)}")
    if history.scatter:
        sizes = (f"{size.name} {plain(size.std, 3)} {size.unit}" for size in history.scatter)
        lines.append(f"Scattering from session to session, one std. dev.: {', '.join(sizes)}")
    ends = f"{_label(history, 0)} to {_label(history, -1)}"
    title, *others = lines or [f"Unchanged in {counted(len(history.sessions), 'session')}, {ends}"]
    lines = [f"{line}." for line in others]
    last = history.changes[-1].before if history.changes else None
    if last and all(note.data.get("before") != last for note in history.notes):
        lines.insert(0, "No adjustment is recorded in between.")
    if history.ambiguous_with:
        stories = " or ".join(_STORIES[trend] for trend in history.ambiguous_with)
        lines.append(f"{capitalized(stories)} is also possible.")
    if limit := history.limit:
        code = "limit_reached" if limit.parameter else "no_drift_to_limit"
        code = "scatter_exceeds" if limit.scatter_exceeds else code
        lines.append(sentence(Reason.of(code, limit=limit)))
    title += f" ({percent(min(history.probability, 0.9999), 1)})"
    reasons = (session.refuted for session in history.sessions if session.refuted)
    refuted = [sentence(reason, history.newest) for reason in reasons]
    texts = [*refuted, title, *lines]
    good = history.verdict is Trend.UNCHANGED and not refuted
    tone = doc.Tone.GOOD if good else doc.Tone.WARN
    tone = doc.Tone.OPEN if history.ambiguous_with else tone
    return doc.Notice(tone, texts[0], tuple(texts[1:]), aside=history.machine)


def _sizes(values: Sequence[Estimate], by: str = "") -> str:
    """ "z by −0.133 ± 0.025 mm"; without those that are negligible against the others."""
    kept = [size for size in values if not by or abs(size.value) > size.expanded] or values
    return sizes_words(size.changed(name=f"{size.name}{by}") for size in kept)


def _in_a_month(history: History) -> list[Estimate]:
    return [r.changed(value=_MONTH * r.value, std=_MONTH * r.std) for r in history.drift]


def _label(history: History, at: int) -> str:
    """Date, with the time where a day has several sessions; the file's name without dates.

    Files of one name, such as maps in a folder each, have the folder in front.
    """
    session = history.sessions[at]
    if not history.dated or session.started is None:
        names = [PurePath(session.path) for session in history.sessions]
        alike = len({name.stem for name in names}) < len(names)
        return "/".join(names[at].parts[-2:]) if alike else names[at].stem
    days = {(session.started or "")[:10] for session in history.sessions}
    return session.started[: 10 if len(days) == len(history.sessions) else 16].replace("T", " ")


def _table(history: History, chosen: set[int]) -> doc.Grid:
    """A row for each of the sessions chosen by their numbers; a line where the machine changed."""
    count, every = len(history.sessions), [*range(len(history.pooled))]
    names = [size.name for size in history.pooled]
    # One alone needs no more room than a line that it is missing.
    shown = [k for k in range(count) if k in chosen or {k - 1, k + 1} <= chosen]
    if sum(max(len(name), 6) + 2 for name in names) > 64:  # those that did something
        moved = {size.name for change in history.changes for size in change.parameters}
        moved |= {rate.name for rate in history.drift} | {size.name for size in history.scatter}
        every = [k for k in every if names[k] in moved] or every[:6]
    decimals = [decimals_for(size.expanded) for size in history.pooled]

    def row(name: str, sizes: Sequence[Estimate], uncertain: bool = False) -> tuple[str, ...]:
        """Values, or their U; what is no offset has no sign."""
        shown = [size.expanded if uncertain else size.value for size in sizes]
        bare = [uncertain or abs(size) > LARGEST_OFFSET for size in shown]
        return (name, *((plain if bare[k] else signed)(shown[k], decimals[k]) for k in every))

    units = [unit_words(history.pooled[k].unit) for k in every]
    same = len(set(units)) == 1
    rows = [] if same else [("", *units)]
    for at, after in zip(shown, (*shown[1:], count), strict=True):
        session = history.sessions[at]
        rows.append(row(_label(history, at), session.parameters))
        sizes = zip(session.parameters, history.sessions[-1].parameters, strict=True)
        if any(size.expanded > 2.0 * last.expanded for size, last in sizes):  # far less sure
            rows.append(row("± U", session.parameters, uncertain=True))
        if any(at <= change.at < after for change in history.changes):
            rows.append(tuple("-" * len(cell) for cell in rows[-1]))
        if after > at + 1:
            rows.append((f"… {after - at - 1} more", *("" for _ in every)))
    rows.append(row("± U", history.sessions[-1].parameters, uncertain=True))
    rows += [row("best now", history.pooled), row("± U", history.pooled, uncertain=True)]
    return doc.Grid((units[0] * same, *(names[k] for k in every)), rows)


def _courses(history: History) -> doc.Figure:
    """A plot for each parameter: marks with U bars, what is fitted to them, and its number."""
    starts = [datetime.fromisoformat(s.started or "") for s in history.sessions if history.dated]
    times = [start.timestamp() for start in starts] or [*range(len(history.sessions))]
    dated = ([f"{start:{form}}" for start in starts] for form in ("%Y-%m", "%m-%d", "%H:%M"))
    every = [str(k) for k, _ in enumerate(times, 1)]  # where no form distinguishes first and last
    labels = next((texts for texts in dated if texts[:1] != texts[-1:]), every)
    wide, top, bottom = 216.0, 26.0, 124.0
    across = figures.Scale.around(times, 58.0, wide - 18.0)
    places = [across(time) for time in times]
    # A label is written where it changes and has room.
    new = [k for k in range(len(labels)) if k == 0 or labels[k] != labels[k - 1]]
    dates = [*below([places[k] for k in new], [labels[k] for k in new], bottom + 18.0)]
    changes = [(change.at, size) for change in history.changes for size in change.parameters]
    drift = _in_a_month(history) if history.dated else []
    limit, panels = history.limit.limit_mm if history.limit else 0.0, []
    for k, now in enumerate(history.pooled):
        rows = [(s.parameters[k].value, s.own_expanded[k], s.fitted[k]) for s in history.sessions]
        gaps = [at for at, size in changes if size.name == now.name]
        moves = [size for size in (*(size for _, size in changes), *drift) if size.name == now.name]
        numbers = [with_uncertainty(size.value, size.expanded) for size in moves]
        edges = [now.value - limit, now.value + limit] if limit and now.unit == "mm" else []
        ends = [*edges, *(value + side for value, half, _ in rows for side in (-half, half))]
        up = figures.Scale.around(ends, bottom, top)
        title = f"{now.name}, {unit_words(now.unit)}"
        parts = [
            *figures.upright(up, wide, title, numbers[-1] if numbers else ""),
            *dates,
            *(line((40.0, up(edge)), (wide - 6.0, up(edge)), "due") for edge in edges),
        ]
        for at in gaps:
            middle = (places[at] + places[at + 1]) / 2.0
            parts.append(line((middle, top), (middle, bottom), "ink"))
        for start, end in pairwise([0, *(at + 1 for at in gaps), len(rows)]):
            parts.append(thread([(places[k], up(rows[k][2])) for k in range(start, end)]))
        for x, (value, half, _) in zip(places, rows, strict=True):
            parts.append(line((x, up(value - half)), (x, up(value + half)), "whisker"))
            parts.append(figures.mark(x, up(value), 0, "mark", 3.0))
        sizes = ", ".join(with_uncertainty(value, half) for value, half, _ in rows)
        finding = f"{title}, from session to session: {sizes}."
        finding += f" {'; '.join(numbers)}." if numbers else ""
        axis = "c-" + dict(zip("xyzabc", "xyzxyz", strict=True)).get(now.name, "x")
        panels.append(figures.svg(wide, bottom + 26.0, now.name, finding, parts, axis))
    key = "Bars: U without the part common to all sessions. Line: fit, broken at each change."
    if history.changes or history.drift:
        key += f" Number above: last change, or drift in {_MONTH:g} days, ± U (95 %)."
    key += " Dashed: the limit around the best value now." if history.limit else ""
    return doc.Figure(panels, key=key)


def _shapes(history: History) -> Iterator[doc.Figure]:
    """The bed as the parameters leave it: first, last; difference where the places are the same."""
    if not history.shapes:
        return
    (place, first), (other, last) = history.shapes
    bed = history.newest.bed
    largest = 1000.0 * max(float(np.abs(left).max()) for left in (first, last))
    maps = [
        figures.bed_map("first", place, first, bed, largest),
        figures.bed_map("last", other, last, bed, largest),
    ]
    if np.array_equal(place, other):
        maps.append(figures.bed_map("difference", place, last - first, bed, largest))
    yield doc.Figure(maps, 2, f"All on one scale, up to {largest:.0f} µm. Ringed: what stands out.")
