"""The document of `orthocal solve`: may the offsets be entered, how sure they are, what is left."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from orthoglide_cal.estimation import Method
from orthoglide_cal.model import DataKind, weighing
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import Case, decision_notice, to_do
from orthoglide_cal.report.documents.parameters import (
    alone_block,
    budget_sections,
    largest_words,
    open_blocks,
    parameters_grid,
    parameters_title,
)
from orthoglide_cal.report.facts import comparison_words
from orthoglide_cal.results import Answer
from orthoglide_cal.words import counted, difference_decimals, plain, signed, two_figures

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


def solution_document(case: Case) -> doc.Document:
    """The whole answer."""
    case.answer.require_result()
    data = partial(case.answer.model_dump, mode="json")
    return doc.Document(data, partial(_page, case), partial(_screen, case))


def _screen(case: Case) -> doc.Page:
    answer = case.answer
    found: list[doc.Block] = [parameters_grid(case, brief=True), *open_blocks(case)]
    if answer.budget and answer.release.usable:
        found.append(doc.Paragraph(largest_words(case)))
    found += [doc.Paragraph(f"Note: {warning}") for warning in answer.warnings]
    after = tuple(_improvement(case)) if answer.release.usable else ()
    return doc.Page(
        kind="Solution",
        notice=decision_notice(case),
        sections=(
            doc.Section(None, tuple(found)),
            doc.Section(None, after),
            doc.next_steps(to_do(case, brief=True), case.more("solve")),
        ),
    )


def _improvement(case: Case, *, full: bool = False) -> Iterator[doc.Block]:
    """Differences as measured and as expected after entering; residuals before and after."""
    answer = case.answer
    rows = answer.deviations
    if len(rows) > _MOST_DIFFERENCES and not full:
        rows = tuple(sorted(rows, key=lambda each: -abs(each.measured_mm))[:_LARGEST_DIFFERENCES])
    if rows and answer.as_found is not None and answer.expected is not None:
        after = "expected after" if answer.release.usable else "would be left"
        raw = answer.input.kind == DataKind.READINGS
        digits = difference_decimals(raw, case.machine.instrument.resolution_mm)
        measured = (signed(each.measured_mm, digits) for each in rows)
        expected = (signed(each.expected_mm, digits) for each in rows)
        yield doc.Grid(
            ("Deviation, mm", *(each.name for each in rows), "r.m.s."),
            (
                ("measured", *measured, plain(answer.as_found.rms_mm, digits)),
                (after, *expected, plain(answer.expected.rms_mm, digits)),
                ("± U", *(plain(each.expanded_mm, digits) for each in rows), ""),
            ),
        )
    if answer.rms is not None:
        of_what = "readings" if answer.input.kind == DataKind.READINGS else "differences"
        of_what += weighing(case.given.measured)
        yield doc.Paragraph(
            f"Residuals of the {of_what}: {plain(answer.rms.before_mm, 4)} mm r.m.s. before,"
            f" {plain(answer.rms.after_mm, 4)} after."
        )


def _page(case: Case) -> doc.Page:
    facts = doc.Facts((("Method", method_words(case)), ("Noise, mm", noise_words(case.answer))))
    what, _ = comparison_words(case.answer.check is not None and case.answer.check.ends)
    title = f"Differences, {what}" if case.answer.deviations else None
    blocks = (facts, parameters_grid(case), *open_blocks(case), *alone_block(case))
    notes = [f"Note: {warning}" for warning in case.answer.warnings]
    if not (case.answer.release.usable or case.answer.named):
        # Otherwise it stands at the top, or is of the parameters alone.
        notes.append(case.answer.judgement)
    return doc.Page(
        kind="Solution",
        notice=decision_notice(case),
        sheet=(doc.next_steps(to_do(case)),),
        sections=(
            doc.Section(parameters_title(case), (*blocks, _correlations(case))),
            doc.Section(title, tuple(_improvement(case, full=True))),
            *budget_sections(case),
            doc.Section(None, tuple(map(doc.Paragraph, notes))),
        ),
    )


def method_words(case: Case) -> str:
    """The method by its name, and what it is."""
    method = Method(case.answer.method or "")
    return f"{method} ({_METHODS[method]})"


def _correlations(case: Case) -> doc.Paragraph:
    """How the parameters depend on each other."""
    names, matrix = [each.name for each in case.answer.parameters], case.answer.correlation
    pairs = ", ".join(
        f"{one}{other} {signed(matrix[i][k], 2)}"
        for i, one in enumerate(names)
        for k, other in enumerate(names[:i])
    )
    sigma = case.answer.sigma_rho_mm
    together = "" if sigma is None else f" Together: σ_ρ = {two_figures(sigma)} mm."
    return doc.Paragraph(f"Correlations: {pairs}.{together}")


def noise_words(answer: Answer) -> str:
    """Standard deviations of one reading [mm] by what they come from, and the one used for U."""
    noise = answer.noise
    if noise is None:
        return ""
    sizes = {
        "repeats": noise.repeats_mm,
        "residuals": noise.residuals_mm,
        "stated": noise.stated_mm,
        "resolution q/√12": noise.floor_mm,
        "used for U": noise.used_mm,
    }
    said = ", ".join(
        f"{name} {'unknown' if size is None else plain(size, 4)}" for name, size in sizes.items()
    )
    return said + (f"; {counted(noise.dof, 'degree')} of freedom" if noise.dof else "")
