"""The documents of `solve` and `diagnose`: one answer, seen from its parameters or its causes.

Their details are the same; the calibration report shows parts of them.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest
from operator import attrgetter

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation.budget import Budget, Contribution
from orthoglide_cal.files.input import adjustments_by
from orthoglide_cal.inference.result import Explanation, Parameter, Verdict
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import NOZZLE, DataKind, Readings, notes_on, weighing
from orthoglide_cal.model.model import Estimate, Stage
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import (
    INVALIDATING,
    Case,
    check_words,
    comparison_words,
    input_words,
    measure_again,
    size_words,
    sizes_words,
)
from orthoglide_cal.report.figures import brief_residuals, differences_figure, residual_blocks
from orthoglide_cal.report.sentences import (
    METHODS,
    SOURCES,
    cause_title,
    cause_words,
    label_words,
    pattern_name,
)
from orthoglide_cal.report.terminal import fitting
from orthoglide_cal.results.answer import RETAKE, Answer
from orthoglide_cal.results.application import recording
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    chance,
    counted,
    decimals_for,
    difference_decimals,
    listed,
    plain,
    short,
    signed,
    together,
    two_figures,
    typed,
    unit_words,
)

# Reasons that a headline says, too: below it stands what they mean.
_MEANT = ("offsets_wrong", "cause_found", "undecided", "beyond_list")
# What one screen has room for.
_MOST_DIFFERENCES, _LARGEST_DIFFERENCES = 6, 3  # of more the largest are shown
_MOST_SIZES, _MOST_SHOWN = 6, 3  # of one cause; of more the largest are shown
_MOST_OPEN = 4  # explanations
_MOST_LIKELY = 3  # of them in the title
# A source that adds less than this share of every standard deviation has no line of its own.
_MINOR = 0.1
# Lines of a diagnosis; of an undecided one with the line before it that names the machine's file.
_DECIDED, _BEYOND, _UNDECIDED = 30, 24, 19
# Lines of a solution (`measure` has one before it); of a refused one without its parameters'.
_SOLVED, _REFUSED = 23, 17


def solution_document(case: Case) -> doc.Document:
    """The whole answer, the parameters first; without any why, and what to do."""
    return _document(case, "Solution", to_do, _solution_screen)


def diagnosis_document(case: Case) -> doc.Document:
    """The whole answer, what is wrong first; without parameters that of the solution."""
    if not case.answer.parameters:
        return solution_document(case)
    return _document(case, "Diagnosis", _diagnosis_steps, _diagnosis_screen)


def _document(
    case: Case,
    kind: str,
    steps: Callable[[Case], Iterator[doc.Line]],
    screen: Callable[[Case, doc.Page], doc.Page],
) -> doc.Document:
    """A document of this kind; `screen` completes a page that begins with the decision."""

    def begin() -> doc.Page:
        notice = decision_notice(case, diagnosed=kind == "Diagnosis")
        return doc.Page(kind, simulated=case.answer.simulated, notice=notice)

    def page() -> doc.Page:
        sheet = [steps_section(case, steps(case))]
        return replace(begin(), sheet=sheet, sections=[*_details(case)])

    brief = (lambda: screen(case, begin())) if case.answer.parameters else None
    return doc.Document(case.data, page, brief)


def _solution_screen(case: Case, begun: doc.Page) -> doc.Page:
    """The numbers that decide.

    Where a screen has too few lines, all steps but the first of what must not be entered give way,
    then what the numbers mean, and notes.
    """
    answer, release = case.answer, case.answer.release
    enter = release.usable and release.needed
    parameters: list[doc.Block | None] = [_parameters_grid(case, brief=True), *_open_blocks(case)]
    largest = [_largest_words(case)] if answer.budget and enter else []
    known = (*release.reasons, *release.cautions)
    on_data = (note for note in notes_on(case.given.measured) if note not in known)
    notes = [f"Note: {case.says(note)}" for note in on_data]
    numbers = [] if release.settled else [_deviations(case), _residual_words(case)]
    words = []
    if answer.deviations and not release.settled:
        words.append(comparison_words(_by_ends(case))[1])
    if answer.budget and not enter:
        words.append("U: expanded uncertainty, 95 %.")
    if answer.judgement and answer.judgement.code == "residuals_agree" and enter:
        words.append("p: probability that noise alone leaves more.")
    meaning = [" ".join(words)]
    steps = [*to_do(case, brief=True)]
    kept = len(steps) if release.usable else 1
    others, more = steps[kept:], ("More: ", doc.typed(case.typed("solve", "--details")))

    def page() -> doc.Page:
        last = doc.next_steps([*steps[:kept], *others], more)
        first, second = [*parameters, *largest, *notes], [*numbers, *meaning]
        if not answer.deviations:  # one line needs no section
            first, second = [*first, *numbers], []
        both = doc.Section(None, *first), doc.Section(None, *second)
        return replace(begun, sections=[*both, last])

    spare = [] if release.usable else notes
    most = _SOLVED if release.usable else _REFUSED + len(answer.parameters)
    return fitting(page, others, meaning, largest, spare, lines=most)


def _diagnosis_screen(case: Case, begun: doc.Page) -> doc.Page:
    """The numbers that decide, one thought each, and what to do.

    Where a screen has too few lines for it, notes give way, then the reminder to solve again, the
    residuals, all steps but the first ones, and answers that are open but the likeliest two.
    """
    answer, named = case.answer, case.answer.verdict is Verdict.NAMED
    undecided = answer.verdict is Verdict.AMBIGUOUS
    most = _UNDECIDED if undecided else _BEYOND if answer.beyond else _DECIDED
    steps = [*_diagnosis_steps(case)]
    few = "few_readings" in answer.release.codes
    kept = 1 + (undecided and not few)  # what is wrong in any case, and what decides
    first, others = steps[:kept], steps[kept:]
    residuals = [brief_residuals(case)] if named else []
    blind = any(fault.matters for fault in answer.unshown)
    wanted = named and not (answer.release.usable or blind)
    again = ["Then solve again, and enter only what it releases."] * wanted
    notes = [*_notes(case, brief=True)]
    it = "them" if len(answer.causes) + len(answer.beyond) > 1 else "it"
    causes = f" with {it}" * bool(answer.named or answer.patterns)
    known = sizes_words(answer.parameters)
    parameters = [f"{case.words.many.capitalize()}{causes}: {known}."] * bool(known)
    decisive: list[doc.Block] = [*_sizes(case), *parameters, *_open_blocks(case)]
    left = [] if undecided and not answer.holdout else [_rms_grid(case)]
    less_likely = [*range(2, _MOST_OPEN)]
    more = "More: ", doc.typed(case.typed("diagnose", "--details"))

    def page() -> doc.Page:
        answers = [_open_grid(case, 2 + len(less_likely))] if undecided else decisive
        parts: list[Sequence[doc.Block]] = [answers, left, *residuals]
        last = doc.next_steps([*first, *others, *again], *notes, more)
        return replace(begun, sections=[*(doc.Section(None, *part) for part in parts), last])

    return fitting(page, notes, again, residuals, others, less_likely, lines=most)


def _details(case: Case) -> Iterator[doc.Section]:
    answer = case.answer
    if not answer.parameters:
        return
    names, matrix = [row.name for row in answer.parameters], answer.correlation
    pairs = [(i, k) for i in range(len(names)) for k in range(i)]
    related = ", ".join(f"{names[k]}–{names[i]} {signed(matrix[i][k], 2)}" for i, k in pairs)
    sigma = "" if answer.sigma_rho_mm is None else f" σ_ρ = {two_figures(answer.sigma_rho_mm)} mm."
    yield parameters_section(case, f"Correlations: {related}.{sigma}")
    yield doc.Section(None, promised_figure(case), _residual_words(case))
    yield from evidence(case)


def evidence(case: Case) -> Iterator[doc.Section]:
    """The evidence: diagnosis, residuals and uncertainty; nothing without a result."""
    answer = case.answer
    if not answer.parameters:
        return
    undecided = answer.verdict in (Verdict.AMBIGUOUS, Verdict.UNEXPLAINED)
    open_grid = _open_grid(case) if undecided else None
    left, notes = _rms_grid(case, late=True), (*_notes(case), *_assumptions(case))
    text, facts = f"{headline(case).rstrip('.')}.", doc.Facts([*_fit_facts(case)])
    blocks = text, facts, open_grid, *_sizes(case), left, *map(doc.small, notes)
    yield doc.Section("Diagnosis", *blocks)
    yield doc.Section("Residuals (measured − model)", *residual_blocks(case))
    if answer.budget:
        yield budget_section(case.machine, Budget(answer.budget))


# --- the decision -----------------------------------------------------------------------------


def decision_notice(case: Case, *, diagnosed: bool = False) -> doc.Notice:
    """The decision and what it rests on; `diagnosed`: below the verdict on the model."""
    answer, release, says = case.answer, case.answer.release, case.says
    judged, cautions, worst = answer.judgement, release.cautions, answer.validity.reservations
    tone, lines, reasons = doc.Tone.BAD, list[str](), [*release.reasons]
    title = says(Reason.of("not_to_enter" if answer.parameters else "no_result"))
    if release.usable:
        tone = doc.Tone.WARN if cautions else doc.Tone.GOOD
        title = says(Reason.of("to_enter_with_care" if cautions else "to_enter"))
        reasons = [*cautions] or [*filter(None, [judged])]
    elif reasons[0].code == "settings_unknown":
        title = says(reasons.pop(0)).rstrip(".")
    elif release.sound and answer.verdict is Verdict.AMBIGUOUS:
        tone = doc.Tone.OPEN
    if release.settled:
        title = says(Reason.of("nothing_to_enter")).rstrip(".")
        unusual = judged is not None and judged.code == "residuals_unusual"
        reasons = [*filter(None, [judged] * unusual), *cautions]
        known = [(size.found or 0.0, size.expanded, size.unit) for size in answer.parameters]
        size = size_words(*max(known, key=lambda row: abs(row[0]) / row[1]))
        lines = [says(Reason.of("largest_change", size=size))]
    if not release.usable:
        reasons += [e for e in worst if e.code in INVALIDATING and e not in reasons]
    if diagnosed and (release.usable or answer.verdict not in (None, Verdict.CONSISTENT)):
        lines.insert(0, f"{title}.")
        meant = next((e for e in reasons if e.code in _MEANT and release.sound), None)
        if meant and not release.settled:
            u = {p.unit: p.expanded for p in sorted(answer.parameters, key=attrgetter("expanded"))}
            lines[0] = says(Reason.of(f"below_{meant.code}", **meant.data, largest=u))
        # The headline says them.
        title, headed = headline(case), (meant, answer.refuted, judged)
        reasons = [reason for reason in reasons if reason not in headed]
    lines += map(says, reasons)
    # Why released parameters may be worthless.
    if worthless := next((e for e in cautions if e.code in INVALIDATING), None):
        first = says(worthless)
        lines = [f"{title.rstrip('.')}.", *(line for line in lines if line != first)]
        title = first.rstrip(".")
    method = f"method {case.method}" if case.method is not None else None
    about = filter(None, (answer.machine.name, input_words(case.given), method))
    return doc.Notice(tone, title, tuple(lines), ", ".join(about))


def headline(case: Case) -> str:
    """The verdict in one sentence."""
    answer, judged = case.answer, case.answer.judgement
    code = "consistent"
    if answer.verdict is Verdict.NAMED:
        return _named(case)
    if answer.verdict is Verdict.AMBIGUOUS:
        code = "undecided_between"
    elif answer.refuted is not None:
        code = "best_refuted"
    elif answer.verdict is not Verdict.CONSISTENT:
        far = "only_beyond_size" if answer.beyond_tolerance else "none_explains"
        code = "not_on_list" if answer.beyond else far
    elif judged is not None and judged.code == "residuals_too_large":
        code = "no_cause_found"
    return case.says(Reason.of(code, answer=answer, shares=_shares(answer)))


def _named(case: Case) -> str:
    """The causes that were found, or the shape that is left, and what looks the same."""
    (first, *others), measured = case.answer.causes, case.given.measured
    # Readings of one plane do not show what makes their shape.
    flat = isinstance(measured, Readings) and measured.plan.flat
    shape = next((c for c in case.answer.causes if flat and c.id == case.machine.shape), None)
    titles = [cause_title(case.machine, c) for c in (first, *others) if c is not shape]
    code = "shape_left" if shape else "causes_named" if others else "cause_named"
    return case.says(Reason.of(code, titles=titles, alike=first.alike, shape=shape))


def _shares(answer: Answer) -> str:
    """The most probable of the answers that are open and the share of all others, 100 % in all."""
    shares = {_name(state): state.probability for state in answer.explanations if state.parameters}
    patterns = {state.pattern: state.probability for state in answer.explanations if state.pattern}
    likeliest = label_words(next(iter(patterns), "").partition(",")[0])
    shares[f"something that is not on the list, such as {likeliest}"] = sum(patterns.values())
    most = 2 if "few_readings" in answer.release.codes else _MOST_LIKELY
    likely = dict(sorted(shares.items(), key=lambda pair: -pair[1])[:most])
    likely["others"] = 1.0 - sum(likely.values())
    # The percents that rounding down takes away go to the largest fractions that it cut off.
    whole = {name: int(100.0 * share) for name, share in likely.items()}
    cut = sorted(likely, key=lambda name: whole[name] - 100.0 * likely[name])
    for name in cut[: 100 - sum(whole.values())]:
        whole[name] += 1
    shown = [f"{'or ' * (n == 'others')}{n} ({share} %)" for n, share in whole.items() if share]
    return ", ".join(shown)


# --- the next steps ---------------------------------------------------------------------------


def steps_section(case: Case, steps: Iterable[doc.Line]) -> doc.Section:
    """The next steps, and what they do to the height of a nozzle."""
    moved = (note for note in case.answer.notes if note.code in NOZZLE)
    return doc.next_steps(steps, *map(case.says, moved))


def to_do(case: Case, *, brief: bool = False) -> Iterator[doc.Line]:
    """Next steps; `brief`: those that one screen has room for."""
    release, verdict = case.answer.release, case.answer.verdict
    causes = release.sound and verdict in (Verdict.NAMED, Verdict.AMBIGUOUS)
    if adjustments_by(case.source.path):
        from orthoglide_cal.session.adjusting import check_not_adjusted

        try:
            check_not_adjusted(case.given)
        except UnusableResultError as error:
            # Its command stands at its end, if it has one.
            words, colon, typed = str(error).partition(": orthocal ")
            yield doc.step(f"{words}{colon[:1]}", f"orthocal {typed}" if typed else None)
            return
    if release.usable and release.needed:
        yield from _entering(case, brief)
    elif not release.usable:
        yield from case.remedies(*[RETAKE] * (brief and causes))
    if brief and causes:
        decided = verdict is Verdict.NAMED
        see = "See the cause and its remedy" if decided else "See the causes, and how to decide"
        yield doc.step(see, case.typed("diagnose"))


def _diagnosis_steps(case: Case) -> Iterator[doc.Line]:
    """Next steps: what to do about the causes, then entering."""
    yield from case.remedies()
    if case.answer.release.usable and case.answer.release.needed:
        yield doc.step("See what to enter", case.typed("solve"))


def _entering(case: Case, brief: bool) -> Iterator[doc.Line]:
    words, check, excerpt = case.words, case.answer.check, case.source.excerpt
    format = excerpt.firmware if excerpt else case.machine.controller_formats[0]
    export = case.typed("export", f"--format {format}") if case.for_controllers else None
    recorded = recording(case.given)
    if recorded == "done":
        yield f"The machine file records that the {words.many} are entered. {words.restart}"
    elif case.record is not None:
        yield doc.step(f"{words.entering}, then", case.record)
    elif export:
        yield doc.step(f"{words.entering}.", export if recorded == "elsewhere" else None)
    if export and not brief and recorded not in ("done", "elsewhere"):
        yield doc.step("Or print the lines for the controller's file", export)
    if check is not None:
        yield check_words(check)
    if case.table is not None and not brief:
        yield doc.step("Correct the remaining errors with a table", case.table)
    yield doc.step(words.anew, measure_again(case.given))
    if case.record is None or not brief:
        yield doc.step("Compare", case.verify)


# --- parameters, differences and uncertainty -----------------------------------------------------


def parameters_section(case: Case, *more: doc.Block | None) -> doc.Section:
    """The table under what it is of, in which unit, and how it is meant; with more below it."""
    words, named = case.words, case.answer.named
    kind = words.title if case.answer.release.usable else f"Not to be entered: {words.many}"
    causes = f" with {' and '.join(named)}" if named else ""
    relation = words.relation.replace("true position", "true")
    title = f"{kind}{causes}{case.machine.common_unit} ({relation})"
    return doc.Section(title, _parameters_grid(case), *_open_blocks(case), *more)


def _parameters_grid(case: Case, *, brief: bool = False) -> doc.Grid:
    """Parameters as found, and what to enter only if they may be.

    What must not be entered has the digits of its U. `brief`: as a screen has room for it.
    """
    answer, words = case.answer, case.words
    every, enter = answer.parameters, answer.release.usable and answer.release.needed
    digits = [answer.decimals if enter else decimals_for(row.expanded) for row in every]
    same, unit = case.machine.common_unit, [unit_words(row.unit) for row in every]

    def changes(chosen: Sequence[Parameter]) -> list[str]:
        return [
            "not determined" if row.found is None else signed(row.found, decimals)
            for row, decimals in zip(chosen, digits, strict=True)
        ]

    columns: dict[str, Sequence[doc.Blank]] = {"": [row.name for row in every]}
    if not (same or brief):
        columns["unit"] = unit
    if answer.alone and not enter:
        columns[f"{words.many} alone"] = changes(answer.alone.parameters)
        columns[f"allowing for {' and '.join(answer.named)}"] = changes(every)
    else:
        columns["active"] = [plain(row.active, answer.decimals) for row in every]
        head = "found" if enter or answer.release.settled else "if entered"
        columns[head if brief else words.symbol] = changes(every)
    columns["± U"] = [two_figures(row.expanded) for row in every]
    if enter:
        write = typed if same else plain
        new = [write(row.new(answer.decimals), answer.decimals) for row in every]
        columns["enter"] = [doc.typed(text) for text in new]
    if brief:
        columns[" "] = [unit[0], *[""] * (len(unit) - 1)] if same else unit
        return doc.Grid.of(columns, (0, len(columns) - 1))
    caption = f"U: expanded uncertainty, k = {answer.k or 0.0:.2f}, 95 %"
    if answer.dof is not None:
        caption += f" (Student's t with {counted(answer.dof, 'effective degree')} of freedom)"
    if answer.verdict is Verdict.AMBIGUOUS:
        caption += ", with the undecided causes"
    elif answer.verdict is Verdict.UNEXPLAINED:
        caption += ", with what is not on the list"
    # From afar one reads what to enter, and nothing else.
    return doc.Grid.of(columns, caption=f"{caption}.", tiles=enter)


def _open_blocks(case: Case) -> Iterator[str]:
    """Sizes that are taken as stated; the table has the parameters."""
    names = {parameter.name for parameter in case.answer.parameters}
    for unknown in (one for one in case.answer.undetermined if one.name not in names):
        size = f"{unknown.within:.3g} {unit_words(unknown.unit)}"
        yield f"Not determined: {unknown.name}, taken as stated to within {size}."


def promised_figure(case: Case, limit_mm: float | None = None) -> doc.Figure | None:
    """Each difference as found and as expected after entering; None where none is promised."""
    answer = case.answer
    sizes = answer.deviations_rms
    if not (answer.deviations and sizes):
        return None
    rows = [(e.name, e.measured_mm, e.expected_mm, e.expanded_mm, None) for e in answer.deviations]
    return differences_figure(rows, (sizes.before_mm, sizes.after_mm), _by_ends(case), limit_mm)


def _by_ends(case: Case) -> bool:
    """True if the differences are of the tool end against the joint end."""
    return case.answer.check is not None and case.answer.check.ends


def _deviations(case: Case) -> doc.Grid | None:
    """Differences as measured and as expected after entering, the largest ones, for a screen."""
    answer, rows = case.answer, case.answer.deviations
    raw, refused = answer.input.kind == DataKind.READINGS, not answer.release.usable
    sizes = answer.deviations_rms
    if not (rows and sizes):
        return None
    if len(rows) > _MOST_DIFFERENCES:
        rows = tuple(sorted(rows, key=lambda row: -abs(row.measured_mm))[:_LARGEST_DIFFERENCES])
    digits = difference_decimals(raw, case.machine.instrument.resolution_mm)
    after = "if entered" if refused else "expected after"
    measured, expected = (plain(mm, digits) for mm in (sizes.before_mm, sizes.after_mm))
    table = [
        ("measured", *(signed(row.measured_mm, digits) for row in rows), measured),
        (after, *(signed(row.expected_mm, digits) for row in rows), expected),
    ]
    if not refused:
        table.append(("± U", *(plain(row.expanded_mm, digits) for row in rows), ""))
    return doc.Grid(("Deviation, mm", *(row.name for row in rows), "r.m.s."), table)


def _residual_words(case: Case) -> str | None:
    """Residuals before and after; of a refused result as the paper states them."""
    answer = case.answer
    if answer.rms is None:
        return None
    alone = next((state for state in answer.explanations if state.sound), None)
    if answer.input.kind == DataKind.SIX and not answer.release.usable and alone is not None:
        values = " ".join(signed(row.found or 0.0, 2) for row in alone.parameters)
        rms = " → ".join(plain(mm, 3) for mm in (answer.rms.before_mm, alone.rms_mm or 0.0))
        return f"As in the paper (six equations): {values}, {rms} mm r.m.s."
    readings = "readings" if answer.input.kind == DataKind.READINGS else "differences"
    left = f"{plain(answer.rms.after_mm, 4)} after"
    shown = (one for one in answer.beyond[:1] if one.rms_after_mm == answer.rms.after_mm)
    acting = answer.named or [f"the {pattern_name(one)}" for one in shown]
    if acting and answer.lack_of_fit:  # what stays when the parameters are entered
        only = f"{plain(answer.lack_of_fit.left_mm, 4)} with {case.words.many} only"
        left = f"{only}, {plain(answer.rms.after_mm, 4)} with {' and '.join(acting)}"
    before = f"{plain(answer.rms.before_mm, 4)} mm r.m.s. before"
    return f"Residuals of the {readings}{weighing(case.given.measured)}: {before}, {left}."


def _largest_words(case: Case) -> str:
    largest = Budget(case.answer.budget).largest
    name, size = largest.source, _size(largest).replace(" (assumed)", ", assumed")
    if name in SOURCES:
        name = source_words(name, case.machine)[0]
    contribution = f"{name}{', if present' * largest.possible}{f', ± {size}' * bool(size)}"
    return f"U: expanded uncertainty, 95 %. Largest contribution: {contribution}."


def budget_section(machine: Machine, budget: Budget) -> doc.Section:
    """Each source with its size, and what it adds to each parameter, unless it is negligible."""
    unit, u, sources = machine.common_unit, budget.std_mm, budget.contributions
    lines = [line for line in sources if any(line.std > _MINOR * u)]
    rows: list[tuple[str, ...]] = []
    for line in sorted(lines, key=lambda line: -max(line.std)):
        name = source_words(line.source, machine, line.possible)[0]
        rows.append((name, line.type, _size(line), *map(two_figures, line.std)))
    rows.append(("together, u", "", "", *map(two_figures, u)))
    expanded = map(two_figures, budget.expanded_mm)
    rows.append((f"U = k·u, k = {budget.k:.2f}", "", "", *expanded))
    largest = budget.largest
    name, remedy = source_words(largest.source, machine, largest.possible)
    named = zip(machine.parameter_names, machine.parameter_units, strict=True)
    heads = [name if unit else f"{name} ({its})" for name, its in named]
    grid = doc.Grid(("source", "type", "size", *heads), rows)
    text = f"Largest contribution: {name}. {remedy}"
    text += " Negligible sources are not listed." * (len(lines) < len(sources))
    return doc.Section(f"Uncertainty of the {machine.vocabulary.many}{unit}", grid, text)


def source_words(source: str, machine: Machine, possible: bool = False) -> tuple[str, str]:
    """A source in words, and what would reduce it; `possible` if it may be there or not."""
    ids = [id for id in source.split(" and ") if id in CAUSES]
    causes = [cause_words(id, machine, "this place") for id in ids]
    data = {"words": machine.vocabulary, "causes": causes}
    data["title"] = " and ".join(cause["title"] for cause in causes)
    kind = source if not causes else "possible_cause" if possible else "cause"
    name, remedy = (text.format(**data) for text in SOURCES[kind].values())
    return name, remedy


def _size(line: Contribution) -> str:
    if line.size is None:
        return ""
    value = f"{short(line.size, decimals_for(line.size))} {unit_words(line.unit)}".rstrip()
    return f"{value} (assumed)" if line.assumed else value


# --- what is wrong ----------------------------------------------------------------------------


def _sizes(case: Case) -> Iterator[str]:
    for cause in case.answer.causes:
        yield from cause_sizes(cause.id, cause.parameters, cause.where)


def cause_sizes(id: str, sizes: Sequence[Estimate], where: str = "") -> Iterator[str]:
    """Place of a cause, and its parameters: those of several places each at its own."""
    if sizes and not where:
        shown = sizes
        if len(sizes) > _MOST_SIZES:
            shown = sorted(sizes, key=lambda size: -abs(size.value) / (size.std or 1.0))
            shown = shown[:_MOST_SHOWN]
        others = len(sizes) - len(shown)
        rest = f" and {counted(others, 'other')}" if others else ""
        gauge = " y_x: y on leg x." * any(size.name == "y_x" for size in shown)
        yield f"{id}: {sizes_words(shown)}{rest}.{gauge}"
    places = [where] if len(sizes) < 2 else [size.name for size in sizes]
    for place, size in zip_longest(places, sizes) if where else ():
        words = size_words(size.value, size.expanded, size.unit) if size else ""
        if size and CAUSES[id].stage is Stage.RECORD:
            words = words.lstrip("+−").replace("1 turns", "1 turn")
            words += f" too {'high' if size.value > 0.0 else 'low'}"
        at = "" if place.startswith(("at ", "from ")) else "at "
        yield f"{': '.join(filter(None, (f'{id} {at}{place}', words)))}."


def _rms_grid(case: Case, *, late: bool = False) -> doc.Grid:
    """Residuals without and with the causes, of readings fitted and not; `late`: more of those."""
    answer, lack = case.answer, case.answer.lack_of_fit
    head = ["r.m.s., mm", f"{case.words.many} only"]
    left: dict[str, tuple[float | None, float | None]] = {}
    if lack is not None:
        left["fitted"] = lack.left_mm, None
    predicting = f"predicting {'later' if answer.holdout else 'omitted'} readings"
    if answer.causes:
        first = answer.causes[0]
        left["fitted"] = first.rms_before_mm, first.rms_after_mm
        left[predicting] = first.heldout_before_mm, first.heldout_after_mm
        head.append(f"with {' and '.join(cause.id for cause in answer.causes)}")
    if answer.beyond:
        best = answer.beyond[0]
        left["fitted"] = best.rms_before_mm, best.rms_after_mm
        left["cycles left out, there"] = best.heldout_before_mm, best.heldout_after_mm
        if late:
            left["last third, there"] = best.last_third_before_mm, best.last_third_after_mm
        head.append(f"with the {pattern_name(best)}")
    if baselines := answer.baselines:
        left.setdefault(predicting, (baselines.parameters_mm, None))
        left["  by a quartic surface"] = baselines.quartic_mm, None
        left["  by the earlier map"] = baselines.earlier_map_mm, None
    if lack is not None:
        left[f"{case.words.noise}'s noise{case.words.also} would leave"] = lack.expected_mm, None
    rows = [
        (name, *("" if mm is None else plain(mm, 4) for mm in pair))[: len(head)]
        for name, pair in left.items()
        if pair[0] is not None
    ]
    return doc.Grid(head, rows)


def _name(state: Explanation) -> str:
    return state.pattern or together(state.ids)


def _open_grid(case: Case, most: int = _MOST_OPEN) -> doc.Grid:
    """Residuals and parameters under each open state; of some it was not worth fitting."""
    answer, names, rows = case.answer, case.machine.parameter_names, []
    # Where nearly any cause fits, one of them shows what they may do.
    most = 1 if "few_readings" in answer.release.codes else most
    fitted = [state for state in answer.explanations if state.parameters]
    sound = [state for state in fitted if state.sound]
    others = [e for e in fitted if not e.sound and round(100.0 * e.probability)]
    for state in (*sound, *others[:most]):
        known = ((one.name, one.found, decimals_for(2.0 * one.std)) for one in state.parameters)
        values = {name: signed(found, digits) for name, found, digits in known if found is not None}
        left = "" if state.rms_mm is None else plain(state.rms_mm, 4)
        name = f"{case.words.many} only" if state.sound else _name(state)
        rows.append((name, left, *(values.get(name, "") for name in names)))
    head = f"{case.words.many}{case.machine.common_unit}"
    return doc.Grid((head, "r.m.s. left, mm", *names), rows)


def _notes(case: Case, *, brief: bool = False) -> Iterator[str]:
    """Notes on causes, on faults that would not show, and on the data; the least important last."""
    answer, machine = case.answer, case.machine
    for cause in () if brief else answer.causes:
        if not cause.in_machine and cause.id != machine.shape:
            yield f"{cause.id} is an error of the measurement: no controller corrects it."
        elif not cause.recommended:
            yield f"Accepting {cause.id} as part of the machine is not recommended."
        if cause.aliases and answer.verdict is not Verdict.AMBIGUOUS:
            yield f"{cause.id} cannot be distinguished from {', '.join(cause.aliases)}."
    faults = [fault for fault in answer.unshown if not fault.matters]
    places = [f" ({fault.where})" if fault.where else "" for fault in faults]
    if brief and len(faults) > 1:
        named = " or ".join(f"{fault.id}{at}" for fault, at in zip(faults, places, strict=True))
        yield f"These readings cannot show {named}. How to check: --details."
        faults = []
    for fault, at in zip(faults, places, strict=False):
        title = cause_words(fault.id, case.machine)["title"] + at
        yield f"These readings cannot show whether {title}. How to check: {case.says(fault.check)}."
    large = [(cause.id, "has", cause.times_stated) for cause in answer.causes if cause.times_stated]
    would = "would explain these readings with"
    large += [(far.id, would, far.times) for far in answer.beyond_tolerance]
    for id, verb, times in large:
        stated = "usual" if CAUSES[id].assumed(machine) else "stated"
        check = f"look for the reason first, or correct {CAUSES[id].key(machine)}"
        yield f"{id} {verb} {times:.0f} times its {stated} size: {check} in the machine file."
    if answer.ruled_out:
        yield f"Ruled out by hand: {listed(answer.ruled_out)}."
    # Those on the nozzle stand under the next steps.
    notes = [e for e in answer.notes if e.code not in NOZZLE and e not in answer.release.cautions]
    few = ("acts_too", "not_excluded")
    yield from dict.fromkeys(case.says(note) for note in notes if not brief or note.code in few)


def _assumptions(case: Case) -> Iterator[str]:
    """The sizes that were assumed, and how the answer depends on the tolerances."""
    answer = case.answer
    # A cause without a unit has no size: it happens or it does not.
    if assumed := [e for e in answer.assumed_sizes if e.unit]:
        text = ", ".join(f"{e.id} {e.size:.3g} {unit_words(e.unit)}" for e in assumed)
        yield f"Assumed sizes (not in the machine file): {text}."
    named, changed = sorted(cause.id for cause in answer.causes), []
    for how, other in (answer.sensitivity or {}).items():
        ids = sorted(other.ids)
        doubted = f"{' and '.join(named)} is no longer certain"
        conclusion = {
            Verdict.CONSISTENT: "no cause is found",
            Verdict.NAMED: f"the cause found is {' and '.join(ids)}",
            Verdict.AMBIGUOUS: doubted if named else f"{' and '.join(ids)} is possible",
            Verdict.UNEXPLAINED: "no listed cause explains these readings",
        }[other.verdict]
        if (other.verdict, ids) != (answer.verdict, named):
            changed.append(f"With tolerances {how}, {conclusion}.")
    if answer.sensitivity:
        yield from changed or ["Conclusion unchanged when tolerances are halved or doubled."]


def _fit_facts(case: Case) -> Iterator[tuple[str, str]]:
    """The method, whether the parameters alone explain the data, the noise, and several causes."""
    answer, words, noise, lack = case.answer, case.words, case.answer.noise, case.answer.lack_of_fit
    yield "Solved by", f"{answer.method} ({METHODS[answer.method or '']})"
    if noise is None or lack is None:
        return
    fit = f"{chance(lack.p_value)} with {words.many} only, {counted(lack.dof, 'degree')} of freedom"
    fit += weighing(case.given.measured)
    yield "Fit", fit if lack.dof else f"as many {words.many} as readings: they always fit exactly"
    p = "" if lack.repeats_p_value is None else f" ({chance(lack.repeats_p_value)})"
    sizes = {
        f"repeats{p}": noise.repeats_mm,
        "residuals": noise.residuals_mm,
        "stated": noise.stated_mm,
        "resolution q/√12": noise.floor_mm or None,
        "used for U": noise.used_mm,
    }
    known = (f"{name} {plain(mm, 4)}" for name, mm in sizes.items() if mm is not None)
    yield "Noise, mm", f"{', '.join(known)}."
    if len(answer.causes) > 1 or answer.verdict is not Verdict.NAMED:  # no headline tells them
        yield from ((e.id, cause_title(case.machine, e)) for e in answer.causes)
