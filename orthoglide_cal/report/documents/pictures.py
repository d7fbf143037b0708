"""Residuals, in characters for a terminal and as figures for a page."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference.result import FoundCause, FoundPattern
from orthoglide_cal.model.cause import PER_HOUR, Estimate
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import AXES, Series
from orthoglide_cal.report import document as doc
from orthoglide_cal.report import figures
from orthoglide_cal.report.case import Case, comparison_words, position_words, size_words
from orthoglide_cal.report.escape import Html
from orthoglide_cal.report.sentences import pattern_name, pattern_words
from orthoglide_cal.results.answer import Answer, Residual
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
# What a pattern depends on if not on time: column of the residuals, and name of the axis.
_OVER = {
    "repeats": ("displacement_mm", "carriage at, mm"),
    "hysteresis": ("moved_mm", "plunger moved by, mm"),
    "temperature": ("temperature_c", "°C"),
}
_CELLS = 17  # of a bed in signs, along x and along y


def brief_residuals(case: Case) -> list[doc.Block]:
    """What is left in characters; nothing where a screen has no room."""
    if case.answer.input.kind != DataKind.READINGS:
        return [_differences(case)]
    if _on_bed(case.answer):
        return []
    title, grid = _by_leg(case)
    many = len(grid.rows) > _MOST_SERIES or len(grid.head) > _MOST_SERIES + 2
    return [] if many else [title, grid]


def differences_figure(
    rows: Sequence[figures.Deviation],
    rms_mm: Sequence[float],
    single: bool,
    limit_mm: float | None,
    outcomes: Sequence[str] = (),
) -> doc.Figure:
    """Each difference on one axis: as found, as expected, as left.

    Args:
        rows: the differences.
        rms_mm: of all as found, expected and left.
        single: they are of the tool end against the joint end.
        limit_mm: largest deviation allowed; None where nobody said.
        outcomes: by the limit, of each that was measured afterwards.
    """
    names, found, expected, reach, last = zip(*rows, strict=True)
    measured = last[0] is not None
    sizes = {"found": found, "expected": expected, **({"as left": last} if measured else {})}
    columns: dict[str, Sequence[doc.Blank]] = {"": names}
    columns |= {head: [signed(mm, 3) for mm in values] for head, values in sizes.items()}
    columns["± U"] = [plain(mm, 3) for mm in reach]
    if outcomes:
        columns["limit"] = outcomes
    kind, meaning = comparison_words(single)
    key = "○ as found → ■ expected" + (" → ● as left" if measured else " once entered")
    key += f", with U (95 %). {meaning}"
    if limit_mm is not None:
        key += f" Dashed: the limit, ±{limit_mm:g} mm."
    title = f"Differences of readings, {kind}, mm"
    finding = f"r.m.s. {' → '.join(plain(size, 3) for size in rms_mm)}."
    picture = figures.deviation_rows(rows, limit_mm, outcomes)
    return doc.Figure(title, finding, [picture], 0, key, doc.Grid.of(columns))


def residual_blocks(case: Case, when: str = "") -> list[doc.Block]:
    """Measured − modelled without and with the causes, in figures and characters.

    `when` tells two measurements on one page apart.
    """
    answer, sigma = case.answer, case.machine.instrument.noise_mm
    if answer.input.kind != DataKind.READINGS:
        return [_differences(case)]
    rows, left = answer.residuals, _left(case)
    known = (pattern for pattern in answer.patterns if pattern.accepted)
    beyond = [_pattern_figure(case, pattern, number, when) for number, pattern in enumerate(known)]
    if not _on_bed(answer):
        key = "Cycle 1 ●, 2 ▲, 3 ■, 4 ◆. Band: gauge's noise (95 %)."
        key = f"Open: {', filled: '.join(left)}. {key}" if len(left) > 1 else key
        panels = figures.reading_panels(named("Residuals", when), rows, left, noise_mm=sigma)
        title, grid = _by_leg(case)
        return [*beyond, doc.Figure(None, "", panels, key=key, plain=replace(grid, caption=title))]
    bed, places = case.machine.bed, _places(answer)
    measured = np.array([row.measured_mm for row in rows])
    blocks: list[doc.Block] = []
    for title, touches in _surfaces(answer).items():
        # Without their mean: the first layer's height is set apart.
        shown = {"before": measured[touches] - measured[touches].mean()}
        shown |= {f"after, {model}": values[touches] for model, values in left.items()}
        maps = figures.bed_maps(title, places[touches], shown, bed)
        signs = [
            line
            for model, values in left.items()
            for line in (f"{model}:", *_signs(places[touches], values[touches], sigma))
        ]
        key = f"Each map has its own scale. {_RINGED}"
        plain = doc.Listing((*signs, *_BED_LEGEND))
        blocks.append(doc.Figure(title or None, "", maps, 2, key, plain))
    return [*beyond, *blocks, _distances(answer)]


def named(title: str | None, when: str) -> str:
    """A title with when it was measured, if anything was measured again."""
    return f"{title}, {when}".removesuffix(", ")


def _pattern_figure(case: Case, pattern: FoundPattern, number: int, when: str) -> doc.Figure:
    """What a pattern of that number describes, over what it depends on."""
    rows = case.answer.residuals
    column, axis = _OVER.get(pattern.how if rows[0].leg else "", ("minutes", "min"))
    effect = np.array([row.pattern_mm[number] for row in rows])
    reach = np.array([row.pattern_expanded_mm[number] for row in rows])
    key = (
        f"Line: the {pattern_name(pattern)}, with U as a band (95 %). Points: readings without all"
    )
    key += " other effects." + " Ringed: wrong, left out." * any(row.wrong for row in rows)
    panels = figures.reading_panels(
        named(f"Pattern, over {axis}", when),
        rows,
        {"": [*_left(case).values()][-1] + effect},
        over=_column(rows, column),
        axis=axis,
        effect_mm=(effect, reach),
        shown=np.flatnonzero(reach).tolist(),
        ringed=[k for k, row in enumerate(rows) if row.wrong],
        together="" if rows[0].leg else "all touches",
        finding=pattern_words(case.machine, pattern),
    )
    return doc.Figure(None, "", panels, key=key)


def _column(rows: Sequence[Residual], name: str) -> Floats:
    """A quantity of the readings, shape (n,); NaN where it is not known."""
    return np.array([getattr(row, name) for row in rows], np.float64)


def cause_sketch(case: Case, id: str, sizes: Sequence[Estimate]) -> doc.Figure | None:
    """How the machine differs by a cause of such sizes; None where no drawing shows it."""
    gaps = {size.name: size.value for size in sizes}
    drawn = [size for size in seen_parameters(sizes) if set(size.name) <= {*AXES, "_"}]
    shims = case.answer.shims
    if moves_rails(id):
        key = "The rails where they really are, the gaps enlarged. "
        key += "Arrows: move the mount there." * bool(shims)
        panel = figures.rails_sketch(gaps, shims)
    elif drawn and CAUSES[id].unit != PER_HOUR and not _on_bed(case.answer):
        key = "Dashed: as it should be. Solid: as it is, enlarged."
        rows = {
            e.name: (e.value, place_words(e.name), size_words(e.value, e.expanded, e.unit))
            for e in drawn[:_MOST_DRAWN]
        }
        panel = figures.parameter_sketch(id, rows)
    else:
        return None
    return doc.Figure(None, "", (panel,), columns=0, key=key)


def moves_rails(id: str) -> bool:
    """True if the parameters of a cause are gaps between rails."""
    screws = map(CAUSES[id].adjustment, CAUSES[id].names)
    return any(screw and screw.along for screw in screws)


def cause_figure(case: Case, cause: FoundCause) -> Iterator[doc.Figure]:
    """A cause as a drawing: how the machine differs by it, or the readings that it spoils."""
    rows = case.answer.residuals
    panels: Sequence[Html]
    if _on_bed(case.answer):
        if cause != case.answer.causes[0]:
            return  # one map shows what all of them do
        (alone, before), *_ = _left(case).items()
        places = _places(case.answer)
        panels = [
            panel
            for title, at in _surfaces(case.answer).items()
            for panel in figures.bed_maps(title, places[at], {alone: before[at]}, case.machine.bed)
        ]
        key = f"Residuals. {_RINGED}"
    elif not cause.where and (sketch := cause_sketch(case, cause.id, cause.parameters)):
        yield sketch
        return
    else:
        (alone, before), (both, after) = (left := _left(case)).items()
        change = np.abs(after - before)
        wrong = np.flatnonzero(change > 0.5 * change.max()).tolist()
        minutes, one = _column(rows, "minutes"), wrong if len(wrong) == 1 else []
        over = minutes if CAUSES[cause.id].timed and np.isfinite(minutes).all() else None
        readings = case.answer.input.kind == DataKind.READINGS
        panels = figures.reading_panels(
            "Residuals",
            rows,
            left,
            noise_mm=case.machine.instrument.noise_mm,
            over=over,
            axis="min",
            shown=wrong,
            ringed=one,
            together="" if readings else "all differences",
        )[:_MOST_GAUGES]
        key = f"Residuals. Open: {alone}. Filled: {both}." + " Ringed: wrong." * bool(one)
    yield doc.Figure(None, "", panels, columns=0, key=key)


def seen_parameters(sizes: Sequence[Estimate]) -> list[Estimate]:
    """Parameters of a cause beyond U, or the largest if none is; the largest first."""
    largest = sorted(sizes, key=lambda size: -abs(size.value))
    return [size for size in largest if abs(size.value) > size.expanded] or largest[:_MOST_DRAWN]


def place_words(name: str) -> str:
    """Where the parameter of a cause is: "y_x" is "leg x, direction y"."""
    direction, _, leg = name.partition("_")
    return Series(AXES.index(leg), AXES.index(direction)).words if leg in AXES else name


def readings_table(case: Case, when: str) -> doc.Section:
    """Every reading as it was written down, and what the model leaves of it, named by `when`."""
    rows, left = case.answer.residuals, [*_left(case).values()][-1]
    if _on_bed(case.answer):
        at = "at"
        touches = [position_words((e.x_mm or 0.0, e.y_mm or 0.0), 1) for e in rows]
        places = ["distance" if e.distance else xy for e, xy in zip(rows, touches, strict=True)]
    elif case.answer.input.kind == DataKind.READINGS:
        keys = "leg", "direction", "posture", "end", "cycle"
        names = [key for key in keys if any(getattr(row, key) for row in rows)]
        at, places = ", ".join(names), [", ".join(str(getattr(e, n)) for n in names) for e in rows]
    else:
        at, places = "difference", [row.posture or "" for row in rows]
    # All with the digits of the longest one: 0.20 is more than 0.2.
    digits = max(len(short(row.measured_mm, 4).partition(".")[2]) for row in rows)
    table = [
        (str(row.order), place, signed(row.measured_mm, digits), signed(mm, 4))
        for row, place, mm in zip(rows, places, left.tolist(), strict=True)
    ]
    grid = doc.Grid(("no.", at, "measured, mm", "left, mm"), table, words=(1,))
    return doc.Section(named("Appendix: readings", when), grid)


def _on_bed(answer: Answer) -> bool:
    return any(row.x_mm is not None for row in answer.residuals)


def _left(case: Case) -> dict[str, Floats]:
    """Model → measured − modelled, shape (n,) [mm]."""
    rows = case.answer.residuals
    beyond = (
        f"the {pattern_name(pattern)}" for pattern in case.answer.patterns if pattern.accepted
    )
    ids = " and ".join((*(cause.id for cause in case.answer.causes), *beyond))
    left = {
        f"{case.words.many} only": np.array([row.measured_mm - row.modelled_mm for row in rows])
    }
    if ids:
        known = ((row.with_causes_mm, row.modelled_mm) for row in rows)
        modelled = [alone if both is None else both for both, alone in known]
        left[f"with {ids}"] = np.array([row.measured_mm for row in rows]) - modelled
    return left


# --- touches of a bed -------------------------------------------------------------------------


def _places(answer: Answer) -> Floats:
    """Places of the touches on the bed, shape (n, 2) [mm]."""
    return np.array([(row.x_mm or 0.0, row.y_mm or 0.0) for row in answer.residuals])


def _surfaces(answer: Answer) -> dict[str, list[int]]:
    """The height of each touched surface, in words where there are several: its touches."""
    surfaces: dict[float, list[int]] = {}
    for k, row in enumerate(answer.residuals):
        if not row.distance:
            surfaces.setdefault(row.surface_mm or 0.0, []).append(k)
    return {f"at {mm:g} mm" if len(surfaces) > 1 else "": surfaces[mm] for mm in sorted(surfaces)}


def _distances(answer: Answer) -> doc.Grid:
    """Measured distances, with what the models make of them [mm]."""
    head = ("distance", "modelled", *(["with causes"] if answer.causes else []))
    rows = []
    for row in answer.residuals:
        if row.distance:
            sizes = row.measured_mm, row.modelled_mm, row.with_causes_mm or row.modelled_mm
            rows.append(tuple(signed(mm, 3) for mm in sizes[: len(head)]))
    return doc.Grid(head, rows, words=(), caption="Distances, mm.")


def _signs(place_mm: Floats, left_mm: Floats, sigma_mm: float) -> tuple[str, ...]:
    """Rows of signs, y upwards, of touches (n, 2); blank where nothing was touched.

    What is left of the touches of one cell, (n,), is averaged.
    """
    reach = float(np.abs(place_mm).max(initial=1.0)) * (1.0 + 1e-9)
    cell = np.floor((place_mm / reach + 1.0) / 2.0 * _CELLS).astype(int)
    number = cell[:, 1] * _CELLS + cell[:, 0]
    count = np.bincount(number, minlength=_CELLS**2)
    total = np.bincount(number, weights=left_mm, minlength=_CELLS**2)
    rows = []
    for row in reversed(range(_CELLS)):
        cells = range(row * _CELLS, (row + 1) * _CELLS)
        texts = [_sign(total[k] / count[k], sigma_mm) if count[k] else " " for k in cells]
        rows.append(" ".join(texts).rstrip())
    return tuple(f"  {text}" for text in rows if text)


def _sign(left_mm: float, sigma_mm: float) -> str:
    """The sign of a residual of so many standard deviations."""
    if abs(left_mm) <= 2.0 * sigma_mm:
        return "·"
    large = abs(left_mm) > 4.0 * sigma_mm
    return ("▲" if large else "+") if left_mm > 0.0 else ("▼" if large else "−")


# --- differences, and readings at legs --------------------------------------------------------


def _differences(case: Case) -> doc.Grid:
    """One row per difference: measured, modelled, left without and with the causes [mm]."""
    answer = case.answer
    left = _left(case)
    names = ["left", f"left with the cause{'s' * (len(answer.causes) > 1)}"]
    rows = []
    for k, row in enumerate(answer.residuals):
        sizes = row.measured_mm, row.modelled_mm, *(float(values[k]) for values in left.values())
        rows.append((row.posture or "", *(signed(mm, 3) for mm in sizes)))
    head = ("", "measured", "modelled by offsets", *names[: len(left)])
    return doc.Grid(head, rows, caption=comparison_words(answer.input.kind == DataKind.SINGLE)[1])


def _by_leg(case: Case) -> tuple[str, doc.Grid]:
    """Means of the repeats [µm], one row per series, one column per model and posture; a title."""
    rows, left = case.answer.residuals, _left(case)
    postures = list(dict.fromkeys(row.posture or "" for row in rows))
    several, parts = len({row.gauge_at for row in rows}) > 1, len({row.part for row in rows}) > 1
    cells: dict[str, dict[str, list[int]]] = {}
    keys = [
        (figures.series_of(row), row.end or "", row.gauge_at or 0.0, row.part or 1, row.order)
        for row in rows
    ]
    for k in sorted(range(len(rows)), key=keys.__getitem__):
        row, name = rows[k], keys[k][0].words
        name += f", {row.end} end" if row.end else f", at {row.gauge_at:g}" if several else ""
        name += f", part {row.part}" if parts else ""
        cells.setdefault(name, {}).setdefault(row.posture or "", []).append(k)
    table = []
    for name, at in cells.items():
        means = [
            [signed(1000.0 * float(values[at[p]].mean()), 1) if p in at else "" for p in postures]
            for values in left.values()
        ]
        table.append([name, *means[0], *(cell for others in means[1:] for cell in ("", *others))])
    head = ["", *postures, *["  ", *postures] * (len(left) - 1)]
    return f"Mean residuals, µm: {', and '.join(left)}.", doc.Grid(head, table)
