"""What the documents hold: decisions, numbers, commands, and the same as values for programs."""

import ast
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.files.machine_file import machine_text, read_machine_file
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.documents.answer import solution_document
from orthoglide_cal.report.documents.reports import calibration_document, verification_document
from orthoglide_cal.report.sentences import _SENTENCES
from orthoglide_cal.results.verification import verify
from orthoglide_cal.words import two_figures
from tests.machines import ROOT
from tests.report.cases import DOCUMENTS, report_of
from tests.results import cases
from tests.results.cases import GAPED, case_of
from tests.results.sessions import TRUE, given, session

# What a renderer may know: the document, and how its texts are made harmless.
KNOWN = {f"orthoglide_cal.{name}" for name in ("errors", "report", "report.document")}


def commands(document: doc.Document) -> list[str]:
    blocks = (block for section in document.page().sheet for block in section.blocks)
    lists = (block.items for block in blocks if isinstance(block, doc.Instructions))
    parts = (part for items in lists for item in items for part in doc.parts_of(item))
    return [part.text for part in parts if part.style == "command"]


@pytest.mark.parametrize("renderer", ["terminal", "html", "markdown"])
def test_renderers_know_nothing_of_calibration(renderer: str) -> None:
    path = ROOT / "orthoglide_cal" / "report" / f"{renderer}.py"
    found = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    modules = {node.module for node in found if isinstance(node, ast.ImportFrom)}
    assert {name for name in modules if name.startswith("orthoglide_cal")} <= KNOWN


def test_the_green_tick_is_for_what_the_offsets_put_right() -> None:
    """Offsets do not remove an accepted gap: said on every page, with the table that does."""
    found = case_of(given(session(TRUE, 11, GAPED), GAPED))
    size = two_figures(found.answer.deviations_rms.after_mm)
    left = f"Offsets do not remove axis_gap: {size} mm r.m.s."
    for document in (solution_document(found), report_of(found)):
        page = document.page()
        assert page.notice.tone is doc.Tone.WARN
        assert left in str(page.notice.lines)
        assert any(command.endswith("--format table") for command in commands(document))
    assert any(left in line for line in map(found.says, found.answer.release.cautions))
    assert "axis_gap, which offsets do not remove" in repr(report_of(found).page())
    sound = report_of(cases.healthy())
    assert sound.page().notice.tone is doc.Tone.GOOD
    assert not any("--format table" in command for command in commands(sound))


def test_what_is_found_is_drawn_on_the_first_sheet() -> None:
    gaps, wrong = (report_of(make()).page() for make in (cases.named_in_machine,
                                                         cases.named_in_measurement))  # fmt: skip
    shims = repr(gaps.sheet)
    assert "The rails do not meet in one point (axis_gap)" in shims
    assert shims.count('class="head"') == 3  # how to move each mount
    marked = repr(wrong.sheet)
    assert "leg x, direction z, min, cycle 2 (reading 12)" in marked
    assert marked.count('class="fault"') == 1  # around the reading
    assert 'class="fault"' not in repr(report_of(cases.healthy()).page())


def test_what_was_applied_is_shown_to_its_last_digit() -> None:
    before, after = given(session(TRUE, 14)), given(session(np.zeros(3), 15))
    found = verify(before, after, (-0.5304, 0.59, -1.76))
    page = verification_document(found).page()
    for block in (page.sections[0].blocks[0], page.sections[2].blocks[1]):
        assert [set(row) & {"−0.5304", "+0.5900", "−1.7600"} for row in block.rows] == [
            {"−0.5304"}, {"+0.5900"}, {"−1.7600"},
        ]  # fmt: skip


TONES = {
    doc.Tone.GOOD: ("healthy", "as_left"),
    doc.Tone.WARN: ("few",),
    doc.Tone.OPEN: ("undecided", "ambiguous"),
    doc.Tone.BAD: ("named_in_machine", "named_in_measurement", "diagnosed", "unexplained",
                   "failed", "verified"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "tone"), [(kind, tone) for tone, kinds in TONES.items() for kind in kinds]
)
def test_the_first_box_has_the_tone_of_the_decision(kind: str, tone: doc.Tone) -> None:
    assert DOCUMENTS[kind]().page().notice.tone is tone


def test_the_commands_to_type_hold_the_files_and_the_numbers(tmp_path: Path) -> None:
    case = cases.healthy()
    entering, _, comparing = commands(report_of(case))
    assert entering == "orthocal export made.csv --format linuxcnc"
    given = comparing.removeprefix("orthocal verify made.csv AFTER --applied ").split()
    changes = [each.change(case.answer.decimals) for each in case.answer.parameters]
    assert [float(v) for v in given] == changes
    path = tmp_path / "machine.yaml"
    path.write_text(machine_text(case.given.model), encoding="utf-8")
    kept = replace(case.given, keeper=read_machine_file(path))
    known = commands(report_of(replace(case, given=kept)))
    again = ["orthocal measure", "orthocal verify made.csv AFTER"]
    assert known == ["orthocal apply made.csv", entering, *again]
    accept = commands(DOCUMENTS["named_in_machine"]())
    cause = ("diagnose made.csv --accept axis_gap", "adjust made.csv --cause axis_gap")
    assert accept == [f"orthocal {each}" for each in cause]
    assert commands(DOCUMENTS["ambiguous"]()) == ["orthocal measure --cycles 1"]
    for kind in ("named_in_measurement", "unexplained", "failed"):
        assert commands(DOCUMENTS[kind]()) == []


def test_the_likeliest_rival_is_drawn_on_the_first_sheet() -> None:
    sheet = DOCUMENTS["ambiguous"]().page().sheet
    (rival,) = (part for part in sheet if (part.title or "").startswith("Or: "))
    assert "(axis_gap)" in rival.title
    assert isinstance(rival.blocks[-1], doc.Figure)


def beyond_the_limit() -> doc.Document:
    """Adjusted as promised, and the gap that offsets do not put right is more than the limit."""
    before = given(session(TRUE, 16, GAPED), GAPED)
    after = given(session(np.zeros(3), 17, GAPED), GAPED)
    before = replace(before, machine_file=Path("mine.yaml"))
    found = verify(before, after, TRUE.tolist(), limit_mm=0.02)
    case = case_of(before)
    return calibration_document(case, cases.identity_of(case), found)


@pytest.mark.parametrize("make", [cases.healthy, cases.named_in_machine, beyond_the_limit])
def test_every_command_to_type_keeps_the_machine_file(make: Callable[[], object]) -> None:
    made = make()
    if isinstance(made, Case):
        given_file = replace(made.given, machine_file=Path("mine.yaml"))
        made = report_of(replace(made, given=given_file))
    page = made.page()
    typed = re.findall(r"'(orthocal [a-z][^']*)'", repr((page.sheet, page.sections)))
    assert typed
    assert all(" --machine mine.yaml" in each for each in typed)


def test_reasons_and_sentences_belong_together() -> None:
    source = "".join(path.read_text() for path in (ROOT / "orthoglide_cal").rglob("*.py"))
    known = {*_SENTENCES}
    assert set(re.findall(r'(?:Reason|Remedy)\.of\(\s*"(\w+)"', source)) <= known
    quoted = set(re.findall(r'"(\w+)"', source))
    # The names of some are made of a field, a cause or another reason.
    assert {re.sub("^(alone|gauge|doubted|below)_", "", code) for code in known - quoted} <= quoted
