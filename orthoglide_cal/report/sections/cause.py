"""The diagnosis: the named cause, its evidence and gain, what it explains, what to measure next."""

from __future__ import annotations

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis.result import AMBIGUOUS, CONSISTENT, NAMED, Diagnosis, NamedCause
from orthoglide_cal.outcome import Calibration, Findings
from orthoglide_cal.report import figures
from orthoglide_cal.report.blocks import (
    Block,
    Figure,
    Line,
    Paragraph,
    Section,
    Strong,
    Table,
)
from orthoglide_cal.report.numbers import chance, percent, plain, two_figures, with_uncertainty
from orthoglide_cal.report.sections.answer import with_file
from orthoglide_cal.report.sketch import bar_lines

_RIVALS = 5


def diagnosis(calibration: Calibration) -> Section | None:
    """What is wrong beside the offsets; None without a diagnosis."""
    findings = calibration.findings
    if findings is None or findings.diagnosis is None:
        return None
    found = findings.diagnosis
    blocks: list[Block] = [Paragraph(_verdict(found)), Paragraph(_fit(found), small=True)]
    for cause in found.causes:
        blocks += _cause(cause, calibration)
    if found.verdict != CONSISTENT:
        blocks += _explained(findings, found)
        blocks += _ranking(found)
    if found.next_measurement is not None:
        blocks.append(Paragraph((Strong("Next reading: "), found.next_measurement.what)))
    blocks += [Paragraph(note, small=True) for note in found.notes]
    return Section("Diagnosis", tuple(blocks))


def _title(cause_id: str) -> str:
    return CAUSES[cause_id].title if cause_id in CAUSES else cause_id


def _explanation(name: str) -> str:
    if "+" in name:
        return name.replace("+", " and ")
    return _title(name) if name else "no cause"


def _verdict(found: Diagnosis) -> Line:
    names = " and ".join(f"{_title(cause.id)} ({cause.id})" for cause in found.causes)
    if found.verdict == CONSISTENT:
        return "Nothing is wrong beside the offsets: the rest is this gauge's noise."
    if found.verdict == NAMED:
        return Strong("Named: "), f"{names}."
    if found.verdict == AMBIGUOUS:
        rivals = ", ".join(found.ambiguous_with) or "another cause"
        return (
            Strong("Ambiguous: "),
            f"{names or 'something'} explains the data, but they cannot tell it from {rivals}.",
        )
    return Strong("Unexplained: "), "no listed cause gives a pattern like this one."


def _fit(found: Diagnosis) -> str:
    fit = found.lack_of_fit
    return (
        f"Without a cause the residuals are {1000 * fit.residual_mm:.1f} µm where noise gives"
        f" {1000 * fit.noise_mm:.1f} µm ({chance(fit.p_value)}, {fit.dof} degrees of freedom)."
    )


def _cause(cause: NamedCause, calibration: Calibration) -> list[Block]:
    rows: list[tuple[Line | None, ...]] = [
        ("probability among all causes tried", percent(cause.probability)),
    ]
    if cause.where:
        rows.append(("where", cause.where))
    rows += [
        (f"{name}, {estimate.unit}" if estimate.unit else name, _size(estimate.value, estimate.std))
        for name, estimate in cause.parameters.items()
    ]
    rows.append(
        ("residual r.m.s., without → with, mm", _gain(cause.rms_before_mm, cause.rms_after_mm))
    )
    if cause.heldout_before_mm is not None and cause.heldout_after_mm is not None:
        rows.append(
            (
                "prediction of readings not fitted, without → with, mm",
                _gain(cause.heldout_before_mm, cause.heldout_after_mm),
            )
        )
    if cause.aliases:
        rows.append(("looks the same in these data", ", ".join(cause.aliases)))
    part = "the machine" if cause.in_machine else "the measurement"
    blocks: list[Block] = [
        Table(
            (cause.id, ""),
            tuple(rows),
            words=(0,),
            caption=f"{_title(cause.id).capitalize()}; it lies in {part}.",
        ),
        Paragraph(cause.advice),
    ]
    if cause.in_machine:
        blocks.append(
            Paragraph(
                with_file(
                    "Making it part of the model is recommended:"
                    f" orthocal diagnose FILE --accept {cause.id}",
                    calibration,
                )
                if cause.recommended
                else "Making it part of the model is not recommended: it does not predict readings"
                " better that it has not seen."
            )
        )
    return blocks


def _size(value: float, std: float) -> str:
    return with_uncertainty(value, std) if std > 0.0 else plain(value, 3).rstrip("0").rstrip(".")


def _gain(before: float, after: float) -> str:
    return f"{plain(before, 4)} → {plain(after, 4)}"


def _explained(findings: Findings, found: Diagnosis) -> list[Block]:
    parts = findings.explained
    if parts is None:
        return []
    cause = " and ".join(cause.id for cause in found.causes)
    models, residuals = ["offsets alone"], [parts.before_mm]
    if cause:
        models.append(f"with {cause}")
        residuals.append(parts.after_mm)
        finding = (
            f"{cause} explains {percent(parts.by_cause)} of the residuals' sum of squares;"
            f" {percent(parts.unexplained)} stays unexplained. r.m.s."
            f" {two_figures(parts.rms_before_mm)} → {two_figures(parts.rms_after_mm)} mm."
        )
    else:
        finding = (
            f"{percent(parts.unexplained)} of the residuals' sum of squares stays unexplained:"
            f" r.m.s. {two_figures(parts.rms_before_mm)} mm."
        )
    shares = {
        cause or "listed causes": parts.by_cause,
        "noise": parts.noise,
        "unexplained": parts.unexplained,
    }
    return [
        Figure(
            "Explained and unexplained",
            finding,
            figures.residual_strips(models, residuals, parts.leg, found.lack_of_fit.noise_mm),
            sketch=bar_lines(
                list(shares), list(shares.values()), [percent(s) for s in shares.values()], width=30
            ),
            columns=2,
            key="Leg x ●, y ▲, z ■. Band: what the gauge's noise explains (95 %).",
            legend=figures.share_bar(
                cause or "listed causes", parts.by_cause, parts.noise, parts.unexplained
            ),
        )
    ]


def _ranking(found: Diagnosis) -> list[Block]:
    best = list(found.ranking.items())[:_RIVALS]
    if not best:
        return []
    blocks: list[Block] = [
        Table(
            ("explanation", "probability"),
            tuple((_explanation(name), percent(p)) for name, p in best),
            caption="The best explanations of all that were tried.",
        )
    ]
    if found.sensitivity:
        changed = [
            f"{how}: {verdict}{' (' + name + ')' if name else ''}"
            for how, (verdict, name) in found.sensitivity.items()
        ]
        blocks.append(Paragraph(f"With the tolerances {'; '.join(changed)}.", small=True))
    return blocks
