"""The document of `orthocal solve`: may the offsets be entered, how sure they are, what is left."""

from __future__ import annotations

from functools import partial

from orthoglide_cal.errors import file_words
from orthoglide_cal.estimation import Method
from orthoglide_cal.model import DataKind
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.documents.decision import decision_notice, to_do
from orthoglide_cal.report.documents.parameters import (
    alone_block,
    budget_sections,
    open_blocks,
    parameters_grid,
    parameters_title,
)
from orthoglide_cal.report.facts import METHOD_WORDS, comparison_words, data_words
from orthoglide_cal.words import counted, difference_decimals, plain, signed, two_figures


def solution_document(case: Case, details: bool = False) -> doc.Document:
    """The whole answer; `details`: with what the screen leaves out."""
    case.answer.require_result()
    return doc.Document(
        partial(case.answer.model_dump, mode="json"), partial(_solution_page, case, details)
    )


def _solution_page(case: Case, details: bool) -> doc.Page:
    answer = case.answer
    blocks = (parameters_grid(case), *open_blocks(case))
    more = (*alone_block(case), *_correlations(case)) if details else ()
    return doc.Page(
        kind="Solution",
        title=file_words(case.source.path),
        facts=doc.Facts(
            (
                ("Data", data_words(case.source, answer.input.kind, answer.input.readings)),
                ("Method", method_words(case)),
                ("Machine", doc.Given(answer.machine.name)),
            )
        ),
        notice=decision_notice(case),
        sheet=(to_do(case),),
        sections=(
            doc.Section(parameters_title(case), (*blocks, *more)),
            left_after(case),
            *budget_sections(case),
            _noise(case),
        ),
    )


def method_words(case: Case) -> str:
    """The method by its name, and what it is."""
    method = Method(case.answer.method or "")
    return f"{method} ({METHOD_WORDS[method]})"


def _correlations(case: Case) -> tuple[doc.Block, ...]:
    """How the parameters depend on each other."""
    names, matrix = [each.name for each in case.answer.parameters], case.answer.correlation
    pairs = ", ".join(
        f"{one}{other} {signed(matrix[i][k], 2)}"
        for i, one in enumerate(names)
        for k, other in enumerate(names[:i])
    )
    sigma = case.answer.sigma_rho_mm
    together = "" if sigma is None else f" Together: σ_ρ = {two_figures(sigma)} mm."
    return (doc.Paragraph(f"Correlations: {pairs}.{together}"),)


def left_after(case: Case) -> doc.Section:
    """Table 4 of the paper: measured, and what is (or would be) left after the correction."""
    answer = case.answer
    raw = answer.input.kind == DataKind.READINGS
    what = f"{'readings' if raw else 'differences'}{case.given.measured.weighing}"
    quality: tuple[doc.Block, ...] = ()
    if answer.rms is not None:
        fitted = " and ".join((case.words.many, *answer.named))
        quality = (
            doc.Paragraph(
                f"Residual r.m.s. of the {what}: {plain(answer.rms.before_mm, 4)} before,"
                f" {plain(answer.rms.after_mm, 4)} with the {fitted}."
            ),
        )
    table = answer.deviations
    if not table or answer.as_found is None or answer.expected is None:
        return doc.Section(None, quality)
    digits = difference_decimals(raw, case.machine.instrument.resolution_mm)
    usable = answer.release.usable

    left = "left after" if usable else "would be left"
    measured = (signed(each.measured_mm, digits) for each in table)
    expected = (signed(each.expected_mm, digits) for each in table)
    rows = (
        ("measured", *measured, plain(answer.as_found.rms_mm, digits)),
        (left, *expected, plain(answer.expected.rms_mm, digits)),
        ("", *(f"± {plain(each.expanded_mm, digits)}" for each in table), ""),
    )
    what, meaning = comparison_words(answer.check is not None and answer.check.ends)
    grid = doc.Grid(("", *(each.name for each in table), "r.m.s."), rows, caption=meaning)
    title = "Left after correction" if usable else "Would be left if entered"
    return doc.Section(f"{title}, mm (differences, {what})", (grid, *quality))


def noise_grid(case: Case) -> doc.Grid:
    """The standard deviation of one reading from each source, side by side [mm]."""
    names = ("repeats", "residuals", "stated", "floor", "used")
    sigmas = [getattr(case.answer.noise, f"{name}_mm", None) for name in names]
    cells = ("unknown" if sigma is None else plain(sigma, 4) for sigma in sigmas)
    head = (name.replace("floor", "floor q/√12") for name in names)
    return doc.Grid(("", *head), (("σ", *cells),))


def _noise(case: Case) -> doc.Section:
    answer = case.answer
    dof = answer.noise.dof if answer.noise else 0
    spare = f"; {counted(dof, 'degree')} of freedom" if dof else ""
    notes = [doc.Paragraph(f"Note: {warning}") for warning in answer.warnings]
    if not (answer.release.usable or answer.named):
        # Otherwise it stands at the top, or is of the parameters alone.
        notes.append(doc.Paragraph(answer.judgement))
    return doc.Section(f"Standard deviation of one reading, mm{spare}", (noise_grid(case), *notes))
