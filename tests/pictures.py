"""The pictures at the head of the README: `python -m tests.pictures` makes them again.

A terminal that shows what `solve` says of a sample, and the first sheet of its report. Both are
SVG, so that a test compares them with what the program says.
"""

import re
from datetime import UTC, datetime
from html import escape

from orthoglide_cal.files.input import Input, read_input
from orthoglide_cal.files.text import document_from_bytes
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.documents.answer import solution_document
from orthoglide_cal.report.documents.reports import calibration_document
from orthoglide_cal.report.html import html
from orthoglide_cal.results.answer import identify
from orthoglide_cal.results.making import answer_to
from tests.machines import ROOT
from tests.report.test_terminal import shown

SAMPLE = "sample_data/double_posture_session.csv"
LINE, LETTER, EDGE = 18, 8.0, 14  # height of a line, width of a letter, edge of the terminal [px]
SHEET = (760, 1180)  # width and height of the first sheet [px]
DAY = datetime(2026, 3, 4, 9, 30, tzinfo=UTC)
FONT = "ui-monospace, SFMono-Regular, Consolas, 'DejaVu Sans Mono', monospace"


def picture(width: float, height: float, content: str) -> str:
    size = f'viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{content}</svg>\n'


def sample() -> Case:
    """The sample, with its path as one types it in the folder of the program."""
    data = (ROOT / SAMPLE).read_bytes()
    given: Input = read_input(document_from_bytes(data, SAMPLE))
    return Case(given, answer_to(given, details=True))


def terminal(case: Case) -> str:
    """Dark, as wide as its longest command."""
    screen = solution_document(case).screen
    lines = [f"$ orthocal solve {SAMPLE}", "", *shown(screen()).rstrip("\n").split("\n")]
    longest = max(map(len, lines))
    width, height = longest * LETTER + 2 * EDGE, len(lines) * LINE + 2 * EDGE
    texts = (
        f'<text x="{EDGE}" y="{EDGE + LINE * (k + 0.75):g}" textLength="{len(line) * LETTER:g}"'
        f' xml:space="preserve">{escape(line, quote=False)}</text>'
        for k, line in enumerate(lines)
        if line
    )
    back = f'<rect width="{width:g}" height="{height:g}" rx="8" fill="#14171b"/>'
    inside = f'<g font-family="{FONT}" font-size="13" fill="#e8eaed">{"".join(texts)}</g>'
    return picture(width, height, back + inside)


def sheet(case: Case) -> str:
    identity = identify([case.given], case.answer.method, issued=DAY)
    whole = html(calibration_document(case, identity).page())
    style = re.search("<style>(.*?)</style>", whole, re.DOTALL)[1]
    first = re.search(r"<body>(<header>.*?)<div class=\"sign\">", whole, re.DOTALL)[1]
    # Light, and no rules of paper.
    dark = r"@media screen and \(prefers-color-scheme: dark\) \{.*?\n\}\n"
    style = re.sub(dark, "", style, flags=re.DOTALL)
    style = re.sub(r"(?m)^(body|:root) \{", ".page {", style[: style.index("@page")])
    inside = f'<div xmlns="http://www.w3.org/1999/xhtml" class="page">{first}</main></div>'
    back = f'<rect width="{SHEET[0]}" height="{SHEET[1]}" fill="#ffffff"/>'
    page = f'<foreignObject width="{SHEET[0]}" height="{SHEET[1]}">{inside}</foreignObject>'
    return picture(*SHEET, f"<style>{escape(style, quote=False)}</style>{back}{page}")


def pictures() -> dict[str, str]:
    """File in the folder of samples → its content."""
    case = sample()
    return {"solve.svg": terminal(case), "report.svg": sheet(case)}


if __name__ == "__main__":
    for name, content in pictures().items():
        (ROOT / "sample_data" / name).write_text(content, encoding="utf-8")
