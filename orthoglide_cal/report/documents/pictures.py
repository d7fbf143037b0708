"""Measured values and residuals, as figures for a page and in characters; each cause drawn."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, pairwise, zip_longest

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference.result import FoundCause, FoundPattern
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.model.model import PER_HOUR, Estimate
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import AXES, Series
from orthoglide_cal.report import document as doc
from orthoglide_cal.report import figures
from orthoglide_cal.report.case import Case, comparison_words, position_words
from orthoglide_cal.report.escape import Html, tag
from orthoglide_cal.report.figures import Scale, below, line, mark, points, thread, words
from orthoglide_cal.report.sentences import pattern_name, pattern_words
from orthoglide_cal.results.answer import Residual
from orthoglide_cal.words import plain, short, signed

# Below the signs of a bed.
_BED_LEGEND = (
    "  Seen from above, y upwards: + the probe triggered too high, − too low;",
    "  · noise, + − over 2σ, ▲ ▼ over 4σ.",
)
_MOST_SERIES = 6  # on a screen, each in half as many postures
_MOST_DRAWN = 3  # parameters of a cause
_RINGED = "Ringed: beyond four robust standard deviations."
_MOST_GAUGES = 2  # of the readings that it spoils
# What a pattern depends on if not on time: a column of the residuals.
_DEPENDS = {"repeats": "displacement_mm", "hysteresis": "moved_mm", "temperature": "temperature_c"}
# Such a column → its name on an axis.
_AXIS = {
    "": "",
    "minutes": "min",
    "displacement_mm": "carriage at, mm",
    "moved_mm": "plunger moved by, mm",
    "temperature_c": "°C",
}
_CELLS = 17  # of a bed in signs, along x and along y

# --- differences -------------------------------------------------------------------------------

_WIDE, _TOP, _ROW = 356.0, 24.0, 22.0  # of a picture with a line for each difference

# Name, found, expected, U of the last, measured (None if nothing was yet) [mm].
Deviation = tuple[str, float, float, float, float | None]


def differences_figure(
    rows: Sequence[Deviation],
    rms_mm: Sequence[float],
    single: bool,
    limit_mm: float | None,
    outcomes: Sequence[str] = (),
) -> doc.Figure:
    """A row for each difference: as found ○ → expected ■ → as left ●, with U of the last.

    Args:
        rows: the differences.
        rms_mm: of all as found, expected and left.
        single: they are of the tool end against the joint end.
        limit_mm: largest deviation allowed; None where nobody said.
        outcomes: by the limit, of each that was measured afterwards; below the names.
    """
    names, first, expected, expanded, after = zip(*rows, strict=True)
    measured = after[0] is not None
    sizes = {"found": first, "expected": expected, **({"as left": after} if measured else {})}
    *_, (head, last) = sizes.items()
    columns: dict[str, Sequence[str]] = {"": names}
    columns |= {when: [signed(mm, 3) for mm in values] for when, values in sizes.items()}
    columns["± U"] = [plain(mm, 3) for mm in expanded]
    columns |= {"limit": outcomes} if outcomes else {}
    limits = [] if limit_mm is None else [-limit_mm, limit_mm]
    # Columns of numbers, by their right edges.
    edges = [194.0, 252.0, _WIDE - 2.0] if measured else [_WIDE - 108.0, _WIDE - 2.0]
    left, high = (70.0, _ROW + 5.0) if outcomes else (42.0, _ROW)
    reach = [*np.subtract(last, expanded), *np.add(last, expanded), *limits, -0.02, 0.02]
    across = Scale.around([*first, *expected, *reach], left, edges[0] - 46.0)
    top, bottom = _TOP - 4.0, _TOP + high * len(rows)
    places, kinds, texts = zip(*across.ticks(), strict=True)
    parts = [
        *(
            figures.rectangle(across(a), top, across(b) - across(a), bottom - top, "allowed")
            for a, b in pairwise(limits)
        ),
        *(line((x, top), (x, bottom), kind) for x, kind in zip(places, kinds, strict=True)),
        *below(places, texts, bottom + 14),
        words((across.start + across.end) / 2, bottom + 28, "mm", "middle", "muted"),
    ]
    for x, when in zip(edges, sizes, strict=True):
        parts.append(words(x, 12, f"{when} ± U" if when == head else when, "end", "muted"))
    listed = []
    for k, (name, *cells) in enumerate(zip(*columns.values(), strict=True)):
        y = _TOP + high * (k + 0.5)
        start, stop, *marks = (across(values[k]) for values in sizes.values())
        ends = across(last[k] - expanded[k]), across(last[k] + expanded[k])
        numbers, (u, *outcome) = cells[: len(sizes)], cells[len(sizes) :]
        numbers[-1] += f" ± {u}"
        listed.append(f"{name} {', '.join([*numbers, *outcome])}")
        parts += [
            words(2, y + (-2 if outcomes else 4), name, class_="strong"),
            *(words(2, y + 10, text) for text in outcome),
            *(words(x, y + 4, text, "end") for x, text in zip(edges, numbers, strict=True)),
            tag(
                "g",
                line((start, y), (stop, y), "thread"),
                line((ends[0], y), (ends[1], y), "whisker"),
                *(line((x, y - 5), (x, y + 5), "whisker") for x in ends),
                mark(start, y, 0, "mark open", 5.0),
                mark(stop, y, 2, "mark", 4.2),
                *(mark(x, y, 0, "mark", 4.6) for x in marks),
                class_=f"c-{name.partition('_')[2][:1]}",
            ),
        ]
    seen = f"{', '.join(sizes).capitalize()}, mm: {'; '.join(listed)}."
    title = "Differences, before and after"
    picture = figures.svg(_WIDE, bottom + 30.0, title, seen, parts)
    kind, meaning = comparison_words(single)
    key = "○ as found → ■ expected" + (" → ● as left" if measured else " once entered")
    key += f", with U (95 %). {meaning}"
    if limit_mm is not None:
        key += f" Dashed: the limit, ±{limit_mm:g} mm."
    rms = " → ".join(plain(size, 3) for size in rms_mm)
    whole = f"Differences, {kind}: {rms} mm r.m.s."
    return doc.Figure([picture], 0, key, whole, [whole, doc.Grid.of(columns)])


# --- residuals ---------------------------------------------------------------------------------


def brief_residuals(case: Case) -> list[doc.Block]:
    """Residuals in characters; nothing where a screen has no room."""
    if case.answer.input.kind != DataKind.READINGS:
        return [readings_table(case)]
    if _on_bed(case):
        return []
    title, grid = _by_leg(case)
    many = len(grid.rows) > _MOST_SERIES or len(grid.head) > _MOST_SERIES + 2
    return [] if many else [title, grid]


def residual_blocks(case: Case) -> Iterator[doc.Block]:
    """Measured − modelled without and with the causes, in figures and characters."""
    left = _left(case)
    for number, pattern in enumerate(case.answer.beyond):
        yield _pattern_figure(case, pattern, number)
    if _on_bed(case):
        measured = np.array([row.measured_mm for row in case.answer.residuals])
        maps, signs = [], list[str]()
        for title, touches, place_mm in _surfaces(case):
            # Without their mean: the first layer's height is set apart.
            mean_mm = measured[touches].mean()
            models = {f"after, {model}": values for model, values in left.items()}
            for model, values in {"before": measured - mean_mm, **models}.items():
                heading = f"{model}{title}".replace(" and ", ", ", model.count(" and ") - 1)
                maps.append(figures.bed_map(heading, place_mm, values[touches], case.machine.bed))
                if model in models:
                    sigma_mm = case.machine.instrument.noise_mm
                    signs += [f"{heading}:", *_signs(place_mm, values[touches], sigma_mm)]
        plain = doc.Listing((*signs, *_BED_LEGEND))
        yield doc.Figure(maps, 2, f"Each map has its own scale. {_RINGED}", plain=[plain])
        yield readings_table(case, distances=True)
    elif case.answer.input.kind == DataKind.READINGS:
        key = "Cycle 1 ●, 2 ▲, 3 ■, 4 ◆. Band: gauge's noise (95 %)."
        key = f"Open: {', filled: '.join(left)}. {key}" if len(left) > 1 else key
        panels = reading_panels(
            case.answer.residuals, left, noise_mm=case.machine.instrument.noise_mm
        )
        yield doc.Figure(panels, key=key, plain=_by_leg(case))
    else:
        yield readings_table(case)


def reading_panels(
    rows: Sequence[Residual],
    left_mm: Mapping[str, Floats],
    *,
    noise_mm: float = 0.0,
    over: str = "",
    effect_mm: tuple[Floats, Floats] | None = None,
    shown: Collection[int] = (),
    ringed: Collection[int] = (),
) -> list[Html]:
    """One panel for each gauge, all on one scale: residuals by posture and cycle.

    Args:
        rows: n readings.
        left_mm: under one or two models: measured − modelled, shape (n,). The last is filled.
        noise_mm: standard deviation of one reading; the band is twice as high.
        over: a column of theirs instead of the postures; where it is None nothing is drawn.
        effect_mm: drawn as a line with its U as a band: both of shape (n,).
        shown: the readings whose gauges have a panel; () for all.
        ringed: readings that are wrong.
    """
    axis, at = _AXIS[over], _column(rows, over) if over else np.zeros(len(rows))
    gauges: dict[str, list[int]] = {}
    for k, row in enumerate(rows):
        gauge = "all touches" if row.x_mm is not None else "all differences"
        gauges.setdefault(series_of(row).words if row.leg else gauge, []).append(k)
    chosen = {gauge: ks for gauge, ks in sorted(gauges.items()) if not shown or {*shown} & {*ks}}
    panels = {gauge: [k for k in ks if np.isfinite(at[k])] for gauge, ks in chosen.items()}
    width, height = (216.0, 168.0) if rows[0].leg else (328.0, 132.0)
    places = [" ".join(filter(None, (row.posture, row.end))) for row in rows]
    band = 2000.0 * noise_mm
    microns = {model: 1000.0 * values for model, values in left_mm.items()}
    models = [*microns.values()]
    middle, reach = (1000.0 * values for values in effect_mm or np.zeros((2, len(rows))))
    low, high = middle - reach, middle + reach
    ends = np.stack((*models, low, high))[:, [*chain(*panels.values())]]
    up = Scale.around([*ends.ravel().tolist(), -band, band], height - 32.0, 26.0)
    pictures = []
    for gauge, numbers in panels.items():
        if not numbers:
            continue
        if not over:
            numbers.sort(key=lambda k: (rows[k].displacement_mm or 0.0, places[k]))
            names = list(dict.fromkeys(places[k] for k in numbers))
            across = Scale(-0.5, len(names) - 0.5, 40.0, width - 6.0)
            x = {k: across(names.index(places[k]) + 0.09 * (rows[k].cycle - 2.5)) for k in numbers}
            ticks = [(across(n), "", name) for n, name in enumerate(names)]
        else:
            numbers.sort(key=at.__getitem__)
            across = Scale.around(at[numbers].tolist(), 40.0, width - 6.0)
            x, ticks = {k: across(at[k]) for k in numbers}, across.ticks()
        parts = [figures.rectangle(40.0, up(band), width - 46.0, up(-band) - up(band), "band")]
        parts = [*parts * bool(band), *figures.upright(up, width, "µm", gauge)]
        parts += [words(width - 6.0, height - 4.0, axis, "end", "muted")] if axis else []
        columns, _, texts = zip(*ticks, strict=True)
        # The words of a posture stand one below the other.
        for n, row_words in enumerate(zip_longest(*map(str.split, texts), fillvalue="")):
            parts += below(columns, row_words, up.start + 12.0 * (n + 1) + 1.0)
        runs: dict[object, list[int]] = {}
        for k in numbers:
            run = (rows[k].part, rows[k].gauge_at) if over else rows[k].cycle
            runs.setdefault(run, []).append(k)
        for ks in runs.values():
            if effect_mm is not None:
                edge = [(x[k], up(low[k])) for k in ks] + [(x[k], up(high[k])) for k in ks[::-1]]
                parts.append(tag("polygon", points=points(edge), class_="band"))
                parts.append(thread([(x[k], up(middle[k])) for k in ks]))
            elif not over:
                parts.append(thread([(x[k], up(models[-1][k])) for k in ks]))
        for values in models:
            style = "mark" if values is models[-1] else "mark open"
            parts += (mark(x[k], up(values[k]), rows[k].cycle - 1, style) for k in numbers)
        circled = ((x[k], up(models[0][k])) for k in numbers if k in ringed)
        parts += (tag("circle", cx=cx, cy=cy, r=9.0, class_="fault") for cx, cy in circled)
        lists = (
            f"{model}: {', '.join(f'{places[k]} {signed(values[k], 1)}' for k in numbers)}"
            for model, values in microns.items()
        )
        most = max(numbers, key=lambda k: abs(models[-1][k]))
        largest = " at ".join(filter(None, (signed(models[-1][most], 1), places[most])))
        seen = f"Residuals, µm; largest: {largest}. {'; '.join(lists)}."
        colour = f"c-{rows[numbers[0]].leg or 'x'}"
        title = f"Residuals{f' over {axis}' if axis else ''}, {gauge}"
        pictures.append(figures.svg(width, height, title, seen, parts, colour))
    return pictures


def series_of(row: Residual) -> Series:
    """The leg and direction of a reading."""
    return Series(AXES.index(row.leg or "x"), AXES.index(row.direction or "x"))


def _pattern_figure(case: Case, pattern: FoundPattern, number: int) -> doc.Figure:
    """The effect of the pattern with this number, over what it depends on."""
    rows = case.answer.residuals
    effect = np.array([row.pattern_mm[number] for row in rows])
    reach = np.array([row.pattern_expanded_mm[number] for row in rows])
    wrong = [k for k, row in enumerate(rows) if row.wrong]
    key = f"Line: the {pattern_name(pattern)}, with U as a band (95 %). Points: readings without"
    key += " all other effects." + " Ringed: wrong, left out." * bool(wrong)
    panels = reading_panels(
        rows,
        {pattern_words(case.machine, pattern): [*_left(case).values()][-1] + effect},
        over=_DEPENDS.get(pattern.how if rows[0].leg else "", "minutes"),
        effect_mm=(effect, reach),
        shown=np.flatnonzero(reach).tolist(),
        ringed=wrong,
    )
    return doc.Figure(panels, 3 if rows[0].leg else 2, key=key)  # as wide as they are


def _column(rows: Sequence[Residual], name: str) -> Floats:
    """A quantity of the readings, shape (n,); NaN where it is not known."""
    return np.array([getattr(row, name) for row in rows], np.float64)


def _on_bed(case: Case) -> bool:
    return any(row.x_mm is not None for row in case.answer.residuals)


def _left(case: Case) -> dict[str, Floats]:
    """Model → measured − modelled, shape (n,) [mm]: the parameters alone, and all that is found."""
    answer, rows = case.answer, case.answer.residuals
    known = (f"the {pattern_name(pattern)}" for pattern in answer.beyond)
    causes = " and ".join((*(cause.id for cause in answer.causes), *known))
    measured, alone = _column(rows, "measured_mm"), _column(rows, "modelled_mm")
    left = {f"{case.words.many} only": measured - alone}
    if causes:
        both = _column(rows, "with_causes_mm")
        left[f"with {causes}"] = measured - np.where(np.isnan(both), alone, both)
    return left


def readings_table(case: Case, *, distances: bool = False) -> doc.Grid:
    """Every reading or difference as it was written down, and what the models leave of it.

    With `distances` only the measured distances between places of a bed.
    """
    chosen = [k for k, row in enumerate(case.answer.residuals) if row.distance or not distances]
    rows = [case.answer.residuals[k] for k in chosen]
    left = {model: values[chosen] for model, values in _left(case).items()}
    readings = case.answer.input.kind == DataKind.READINGS
    at, places = "difference", [row.posture or "" for row in rows]
    if _on_bed(case):
        touches = [position_words((e.x_mm or 0.0, e.y_mm or 0.0), 1) for e in rows]
        places = ["distance" if e.distance else xy for e, xy in zip(rows, touches, strict=True)]
        at = "at"
    elif readings:
        keys = "leg", "direction", "posture", "end", "cycle"
        names = [key for key in keys if any(getattr(row, key) for row in rows)]
        at, places = ", ".join(names), [", ".join(str(getattr(e, n)) for n in names) for e in rows]
    # All with the digits of the longest one: 0.20 is more than 0.2.
    digits = max((len(short(e.measured_mm, 4).partition(".")[2]) for e in rows), default=0)
    columns = {at: places, "measured, mm": [signed(row.measured_mm, digits) for row in rows]}
    sizes = {model: [signed(mm, 4) for mm in values.tolist()] for model, values in left.items()}
    if not readings:
        single = case.answer.input.kind == DataKind.SINGLE
        caption = f"Behind measured: what each model leaves. {comparison_words(single)[1]}"
        return doc.Grid.of({**columns, **sizes}, caption=caption)
    model = [*left][-1]  # a long list has room for one of them
    columns[f"left, {model}"] = sizes[model]
    return doc.Grid.of({"no.": [str(row.order) for row in rows], **columns}, (1,))


def _by_leg(case: Case) -> tuple[str, doc.Grid]:
    """Means of the repeats [µm], one row per series, one column per model and posture; a title."""
    rows, left = case.answer.residuals, _left(case)
    postures = list(dict.fromkeys(row.posture or "" for row in rows))
    several, parts = len({row.gauge_at for row in rows}) > 1, len({row.part for row in rows}) > 1
    cells: dict[str, dict[str, list[int]]] = {}
    for k, row in enumerate(rows):
        name = series_of(row).words
        name += f", {row.end} end" if row.end else f", at {row.gauge_at:g}" if several else ""
        name += f", part {row.part}" if parts else ""
        cells.setdefault(name, {}).setdefault(row.posture or "", []).append(k)
    table = []
    for name, at in sorted(cells.items()):
        means = [
            [signed(1000.0 * float(values[at[p]].mean()), 1) if p in at else "" for p in postures]
            for values in left.values()
        ]
        table.append([name, *means[0], *(cell for others in means[1:] for cell in ("", *others))])
    head = ["", *postures, *["  ", *postures] * (len(left) - 1)]
    return f"Mean residuals, µm: {', and '.join(left)}.", doc.Grid(head, table)


def _surfaces(case: Case) -> Iterator[tuple[str, list[int], Floats]]:
    """Each touched height of a bed, in words where there are several: its touches, (n, 2) [mm]."""
    rows = [(k, row) for k, row in enumerate(case.answer.residuals) if not row.distance]
    heights = sorted({row.surface_mm or 0.0 for _, row in rows})
    for height in heights:
        touches = [(k, row) for k, row in rows if (row.surface_mm or 0.0) == height]
        places = np.array([(row.x_mm or 0.0, row.y_mm or 0.0) for _, row in touches])
        yield f", at {height:g} mm" if len(heights) > 1 else "", [k for k, _ in touches], places


def _signs(place_mm: Floats, left_mm: Floats, sigma_mm: float) -> Iterator[str]:
    """Rows of signs, y upwards, of touches (n, 2); blank where nothing was touched.

    What is left of the touches of one cell, (n,), is averaged.
    """
    reach = np.abs(place_mm).max(initial=1.0)
    y_mm, x_mm = place_mm[:, 1], place_mm[:, 0]
    cells = partial(np.histogram2d, y_mm, x_mm, _CELLS, [(-reach, reach)] * 2)
    (count, *_), (total, *_) = cells(), cells(weights=left_mm)
    limits = sigma_mm * np.array([-4.0, -2.0, 2.0, 4.0])
    kinds = np.digitize(total / np.maximum(count, 1.0), limits)
    for row in np.where(count, np.array([*"▼−·+▲"])[kinds], " ")[::-1]:
        if text := " ".join(row).rstrip():
            yield f"  {text}"


# --- causes ------------------------------------------------------------------------------------


def cause_sketch(case: Case, id: str, sizes: Sequence[Estimate]) -> doc.Figure | None:
    """The machine with a cause of such sizes, drawn; None where no drawing shows it."""
    drawn = [size for size in seen_parameters(sizes) if {*size.name} <= {*AXES, "_"}]
    if moves_rails(id):
        shims = case.answer.shims
        key = "The rails where they really are, the gaps enlarged. "
        key += "Arrows: move the mount there." * bool(shims)
        panel = figures.rails_sketch({size.name: size.value for size in sizes}, shims)
    elif drawn and CAUSES[id].unit != PER_HOUR and not _on_bed(case):
        key = "Dashed: as it should be. Solid: as it is, enlarged."
        panel = figures.parameter_sketch(id, drawn[:_MOST_DRAWN])
    else:
        return None
    return doc.Figure([panel], 0, key)


def moves_rails(id: str) -> bool:
    """True if the parameters of a cause are gaps between rails."""
    screws = map(CAUSES[id].adjustment, CAUSES[id].names)
    return any(screw and screw.along for screw in screws)


def cause_figure(case: Case, cause: FoundCause) -> doc.Figure | None:
    """A cause as a drawing: how the machine differs by it, or the readings that it spoils."""
    rows, left = case.answer.residuals, _left(case)
    (alone, *_), (*_, both) = left, left
    before, change = left[alone], np.abs(left[both] - left[alone])
    wrong = np.flatnonzero(change > 0.5 * change.max()).tolist()
    one = wrong if len(wrong) == 1 else []
    if _on_bed(case):
        if cause != case.answer.causes[0]:
            return None  # one map shows what all of them do
        sure = one and any(CAUSES[found.id].hides_reading for found in case.answer.causes)
        maps = []
        for title, at, places in _surfaces(case):
            ringed = np.isin(at, one) if sure else None
            name, bed = f"Residuals, {alone}{title}", case.machine.bed
            maps.append(figures.bed_map(name, places, before[at], bed, ringed=ringed))
        return doc.Figure(maps, 0, "Ringed: wrong." if sure else _RINGED)
    if not cause.where and (sketch := cause_sketch(case, cause.id, cause.parameters)):
        return sketch
    timed = CAUSES[cause.id].timed and np.isfinite(_column(rows, "minutes")).all()
    panels = reading_panels(
        rows,
        left,
        noise_mm=case.machine.instrument.noise_mm,
        over="minutes" if timed else "",
        shown=wrong,
        ringed=one,
    )
    key = f"Residuals. Open: {alone}. Filled: {both}." + " Ringed: wrong." * bool(one)
    return doc.Figure(panels[:_MOST_GAUGES], 0, key)


def seen_parameters(sizes: Sequence[Estimate]) -> list[Estimate]:
    """Parameters of a cause beyond U, or the largest if none is; the largest first."""
    largest = sorted(sizes, key=lambda size: -abs(size.value))
    return [size for size in largest if abs(size.value) > size.expanded] or largest[:_MOST_DRAWN]
