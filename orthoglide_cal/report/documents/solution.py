"""The document of `orthocal solve`: may the offsets be entered, how sure they are, what is left.

Other pages show its parts, too: the parameters, what is not determined, and where U comes from.
"""

from collections.abc import Iterator, Sequence
from functools import partial

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation import Method
from orthoglide_cal.estimation.budget import BudgetTotal, Contribution
from orthoglide_cal.inference.result import Explanation
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import DataKind, weighing
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import Case, comparison_words, decision_notice, to_do
from orthoglide_cal.report.sentences import SOURCES
from orthoglide_cal.report.terminal import fitting
from orthoglide_cal.results import Answer, Parameter
from orthoglide_cal.words import (
    counted,
    coverage_words,
    decimals_for,
    difference_decimals,
    plain,
    short,
    signed,
    two_figures,
    typed,
    unit_words,
)

_METHODS = {
    Method.READINGS: "all readings at once",
    Method.SIX: "eq. 25, six equations",
    Method.TWELVE: "eq. 25, twelve equations",
    Method.SIX_LINEAR: "eq. 17",
    Method.TWELVE_LINEAR: "eq. 16",
    Method.SINGLE: "eq. 10",
    Method.SINGLE_SEQUENTIAL: "eq. 11",
}
# A screen has room for so many differences, or else for the largest.
_MOST_DIFFERENCES = 6
_LARGEST_DIFFERENCES = 3
# `measure` says before them where it has written, and after them what a simulation hid.
_MOST_LINES = 23
# What reduces a cause that may be there, and one whose size no reading shows.
_OPEN = (
    "These readings hardly show it: measure with other {words.positions}, or state under"
    " tolerances in the machine file how large it can be."
)
_STATE = "State how well that is known under tolerances in the machine file."


def solution_document(case: Case) -> doc.Document:
    """The whole answer; without parameters why there are none, and what to do."""
    if case.answer.parameters:
        return doc.Document(case.data, partial(_page, case), partial(_screen, case))
    notice, steps, simulated = decision_notice(case), to_do(case), case.answer.simulated
    page = doc.Page(
        "Solution", notice=notice, simulated=simulated, sections=[doc.next_steps(steps)]
    )
    return doc.Document(case.data, lambda: page)


def _screen(case: Case) -> doc.Page:
    """The numbers that decide; where a screen has too few lines, what they mean gives way."""
    answer, release = case.answer, case.answer.release
    parameters: list[doc.Block] = [parameters_grid(case, brief=True), *open_blocks(case)]
    notes = [f"Note: {case.says(warning)}" for warning in answer.warnings]
    if "gauge_doubt" in release.codes:
        notes = []  # it says the same
    numbers = [] if release.settled else [*_improvement(case)]
    largest = [_largest_words(case)] if answer.budget and release.usable and release.needed else []
    meaning = [_meaning(case)]
    last = doc.next_steps(to_do(case, brief=True), case.more("solve"))

    def page() -> doc.Page:
        blocks = [[*parameters, *largest, *notes], [*numbers, *meaning]]
        if not answer.deviations:  # one line needs no section
            blocks = [[*parameters, *largest, *notes, *numbers]]
        sections = (*(doc.Section(None, *part) for part in blocks), last)
        notice, simulated = decision_notice(case), answer.simulated
        return doc.Page("Solution", simulated=simulated, notice=notice, sections=sections)

    return fitting(page, meaning, largest, lines=_MOST_LINES - answer.simulated)


def _meaning(case: Case) -> str:
    """The names and letters of a screen, each in words."""
    answer, check, release = case.answer, case.answer.check, case.answer.release
    enter = release.usable and release.needed
    words = []
    if answer.deviations and not release.settled:
        words.append(comparison_words(check is not None and check.ends)[1])
    if answer.budget and not enter:
        words.append("U: expanded uncertainty, 95 %.")
    if answer.judgement and answer.judgement.code == "residuals_agree" and enter:
        words.append("p: probability that noise alone leaves more.")
    return " ".join(words)


def _improvement(case: Case, *, full: bool = False) -> Iterator[doc.Block]:
    """Differences as measured and as expected after entering; residuals before and after."""
    answer, rows = case.answer, case.answer.deviations
    raw = answer.input.kind == DataKind.READINGS
    if len(rows) > _MOST_DIFFERENCES and not full:
        rows = tuple(sorted(rows, key=lambda row: -abs(row.measured_mm))[:_LARGEST_DIFFERENCES])
    refused = not answer.release.usable
    if rows and answer.as_found is not None and answer.expected is not None:
        digits = difference_decimals(raw, case.machine.instrument.resolution_mm)
        after = "if entered" if refused else "expected after"
        found, expected = (plain(e.rms_mm, digits) for e in (answer.as_found, answer.expected))
        table = [
            ("measured", *(signed(row.measured_mm, digits) for row in rows), found),
            (after, *(signed(row.expected_mm, digits) for row in rows), expected),
        ]
        if full or not refused:
            table.append(("± U", *(plain(row.expanded_mm, digits) for row in rows), ""))
        yield doc.Grid(("Deviation, mm", *(row.name for row in rows), "r.m.s."), table)
    if answer.rms is None:
        return
    paper = offsets_only(answer) if answer.input.kind == DataKind.SIX and refused else None
    if full or paper is None:
        of_what = f"{'readings' if raw else 'differences'}{weighing(case.given.measured)}"
        sizes = [(answer.rms.after_mm, "after")]
        if answer.alone is not None:  # the causes stay when the parameters are entered
            sizes = [(answer.alone.rms_after_mm, f"with {case.words.many} only")]
            sizes.append((answer.rms.after_mm, f"with {' and '.join(answer.named)}"))
        before, left = plain(answer.rms.before_mm, 4), (f"{plain(mm, 4)} {of}" for mm, of in sizes)
        yield f"Residuals of the {of_what}: {before} mm r.m.s. before, {', '.join(left)}."
    if paper is not None:
        values = " ".join(signed(row.found or 0.0, 2) for row in paper.parameters)
        rms = " → ".join(plain(mm, 3) for mm in (answer.rms.before_mm, paper.rms_mm or 0.0))
        yield f"As in the paper (six equations): {values}, {rms} mm r.m.s."


def _page(case: Case) -> doc.Page:
    answer = case.answer
    name, _ = comparison_words(answer.check is not None and answer.check.ends)
    title = f"Differences, {name}" if answer.deviations else None
    blocks = parameters_grid(case), *open_blocks(case), *alone_block(case)
    notes = [f"Note: {case.says(warning)}" for warning in answer.warnings]
    if answer.judgement and not (answer.release.usable or answer.named):
        # Otherwise it stands at the top, or is of the parameters alone.
        notes.append(case.says(answer.judgement))
    return doc.Page(
        kind="Solution",
        simulated=case.answer.simulated,
        notice=decision_notice(case),
        sheet=(doc.next_steps(to_do(case)),),
        sections=(
            doc.Section(
                parameters_title(case), doc.Facts([*fit_facts(case)]), *blocks, _correlations(case)
            ),
            doc.Section(title, *_improvement(case, full=True)),
            *budget_sections(case.machine, case.answer.budget, case.answer.total),
            doc.Section(None, *notes),
        ),
    )


def _correlations(case: Case) -> str:
    """How the parameters depend on each other."""
    names, matrix = [row.name for row in case.answer.parameters], case.answer.correlation
    pairs = [(i, k) for i in range(len(names)) for k in range(i)]
    text = ", ".join(f"{names[k]}–{names[i]} {signed(matrix[i][k], 2)}" for i, k in pairs)
    sigma = case.answer.sigma_rho_mm
    together = "" if sigma is None else f" Together: σ_ρ = {two_figures(sigma)} mm."
    return f"Correlations: {text}.{together}"


# --- parts that other pages show, too ----------------------------------------------------------


def fit_facts(case: Case) -> Iterator[tuple[str, str]]:
    """The method; standard deviations of one reading by what they come from, and the one used."""
    method, noise = Method(case.answer.method or ""), case.answer.noise
    yield "Solved by", f"{method} ({_METHODS[method]})"
    if noise is not None:
        sizes = {
            "repeats": noise.repeats_mm,
            "residuals": noise.residuals_mm,
            "stated": noise.stated_mm,
            "resolution q/√12": noise.floor_mm,
            "used for U": noise.used_mm,
        }
        known = {name: "unknown" if mm is None else plain(mm, 4) for name, mm in sizes.items()}
        spare = f"; {counted(noise.dof, 'degree')} of freedom" if noise.dof else ""
        yield "Noise, mm", ", ".join(f"{name} {size}" for name, size in known.items()) + spare


def parameters_title(case: Case) -> str:
    """Heading of the table: what it is of, in which unit, and how it is meant."""
    words, named = case.words, case.answer.named
    kind = words.title if case.answer.release.usable else f"{words.title} as found"
    causes = f" with {' and '.join(named)}" if named else ""
    relation = words.relation.replace("true position", "true")
    return f"{kind}{causes}{common_unit(case.machine)} ({relation})"


def common_unit(machine: Machine) -> str:
    """Unit of all parameters, as it follows a title; "" where they have several."""
    units = set(machine.parameter_units)
    return f", {units.pop()}" if len(units) == 1 else ""


def parameters_grid(case: Case, *, brief: bool = False) -> doc.Grid:
    """Parameters as found, and what to enter only if they may be.

    What must not be entered has the digits of its U. `brief`: as a screen has room for it.
    """
    answer, words = case.answer, case.words
    every, enter = answer.parameters, answer.release.usable and answer.release.needed
    digits = [answer.decimals if enter else decimals_for(row.expanded) for row in every]
    same, unit = common_unit(case.machine), [unit_words(row.unit) for row in every]
    alone = answer.alone if brief and not enter else None

    def changes(chosen: Sequence[Parameter]) -> list[str]:
        return [found_words(row, decimals) for row, decimals in zip(chosen, digits, strict=True)]

    columns: dict[str, Sequence[doc.Blank]] = {"": [row.name for row in every]}
    if not (same or brief):
        columns["unit"] = unit
    if alone is None:
        columns["active"] = [plain(row.active, answer.decimals) for row in every]
        head = "found" if enter or answer.release.settled else "if entered"
        columns[head if brief else words.found] = changes(every)
    else:
        columns[f"{words.many} alone"] = changes(alone.parameters)
        columns[f"allowing for {' and '.join(answer.named)}"] = changes(every)
    columns["± U"] = [two_figures(row.expanded) for row in every]
    if enter:
        write = typed if brief and same else plain
        new = [write(row.new(answer.decimals), answer.decimals) for row in every]
        columns["enter"] = [doc.typed(text) for text in new]
    if brief:
        columns[" "] = [unit[0], *[""] * (len(unit) - 1)] if same else unit
        return doc.Grid.of(columns, (0, len(columns) - 1))
    caption = f"U: expanded uncertainty, {coverage_words(answer.k or 0.0)}, 95 %"
    if answer.dof is not None:
        caption += f" (Student's t with {counted(answer.dof, 'effective degree')} of freedom)"
    # From afar one reads what to enter, and nothing else.
    return doc.Grid.of(columns, caption=f"{caption}.", tiles=enter)


def found_words(parameter: Parameter, decimals: int) -> str:
    """The change that was found."""
    return "not determined" if parameter.found is None else signed(parameter.found, decimals)


def _largest_words(case: Case) -> str:
    """The largest contribution to U in one line."""
    largest = max(case.answer.budget, key=_adds)
    name, size = largest.source, _size(largest).replace(" (assumed)", ", assumed")
    if name in SOURCES:
        name = source_words(name, case.machine)[0]
    source = f"{name}{', if present' * largest.possible}"
    contribution = ", ± ".join(filter(None, (source, size)))
    return f"U: expanded uncertainty, 95 %. Largest contribution: {contribution}."


def _adds(line: Contribution) -> float:
    """Variance that a source adds to all parameters together."""
    return sum(std**2 for std in line.std)


def offsets_only(answer: Answer) -> Explanation | None:
    """The parameters if nothing else is wrong, with what they leave; None if no answer has them."""
    if answer.alone is not None:
        left, parameters = answer.alone.rms_after_mm, answer.alone.parameters
        return Explanation(probability=0.0, rms_mm=left, parameters=parameters)
    sound = (state for state in answer.explanations if state.sound and state.parameters)
    return next(sound, None)


def alone_block(case: Case) -> Iterator[doc.Block]:
    """The parameters without the causes that were found, in one line."""
    alone, digits = case.answer.alone, case.answer.decimals
    if alone is not None:
        values = ", ".join(f"{row.name} {found_words(row, digits)}" for row in alone.parameters)
        left = f"({plain(alone.rms_after_mm, 4)} mm r.m.s. left)"
        yield f"{case.words.many.capitalize()} alone: {values} {left}."


def open_blocks(case: Case) -> Iterator[doc.Block]:
    """Parameters that these readings do not determine, and sizes taken as stated."""
    names = {parameter.name for parameter in case.answer.parameters}
    for unknown in case.answer.undetermined:
        size = f"{unknown.within:.2g} {unit_words(unknown.unit)}"
        how = f"U = {size}" if unknown.name in names else f"taken as stated to within {size}"
        yield f"Not determined: {unknown.name}, {how}."


def budget_sections(
    machine: Machine, lines: Sequence[Contribution], total: BudgetTotal | None
) -> Iterator[doc.Section]:
    """Each source with its size, and what it adds to each parameter; nothing without a result."""
    if total is None:
        return
    unit = common_unit(machine)
    rows: list[tuple[str, ...]] = []
    for line in sorted(lines, key=lambda line: -max(line.std)):
        if not line.minor:
            name = source_words(line.source, machine, line.possible)[0]
            rows.append((name, line.type, _size(line), *map(two_figures, line.std)))
    if any(total.minor):
        others = sum(line.minor for line in lines)
        rows.append((counted(others, "other"), "", "", *map(two_figures, total.minor)))
    rows.append(("together, u", "", "", *map(two_figures, total.std)))
    u = f"U = k·u, {coverage_words(total.k)}"
    rows.append((u, "", "", *map(two_figures, total.expanded)))
    largest = max(lines, key=_adds)
    name, remedy = source_words(largest.source, machine, largest.possible)
    named = zip(machine.parameter_names, machine.parameter_units, strict=True)
    heads = [name if unit else f"{name} ({its})" for name, its in named]
    grid = doc.Grid(("source", "type", "size", *heads), rows)
    text = f"Largest contribution: {name}. {remedy}"
    yield doc.Section(f"Uncertainty of the {machine.vocabulary.many}{unit}", grid, text)


def source_words(source: str, machine: Machine, possible: bool = False) -> tuple[str, str]:
    """A source in words, and what would reduce it; `possible` if it may be there or not."""
    words = machine.vocabulary
    if source in SOURCES:
        name, remedy = (text.format(words=words) for text in SOURCES[source].values())
        return name, remedy
    causes = [CAUSES[id].words(machine) for id in source.split(" and ")]
    name = " and ".join(cause.title for cause in causes)
    if possible:
        return f"possible: {name}", _OPEN.format(words=words)
    return name, f"{causes[0].advice} {_STATE}"


def _size(line: Contribution) -> str:
    """Its size with unit, and whether it is assumed; what has no one size is blank."""
    if line.size is None:
        return ""
    value = f"{short(line.size, decimals_for(line.size))} {unit_words(line.unit)}".rstrip()
    return f"{value} (assumed)" if line.assumed else value
