"""Every number of a page has a path in the JSON; it is only rounded."""

import json
import re
from collections.abc import Iterable, Iterator
from decimal import Decimal
from html import unescape
from itertools import chain
from pathlib import Path

import pytest

from orthoglide_cal.files.input import read_input
from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.model.model import Model
from orthoglide_cal.planning.next_measurement import rank_measurements
from orthoglide_cal.planning.plan import MeasurementPlan, chosen_session, measurement_plan
from orthoglide_cal.planning.steps import GuidedSession, MeasuringProtocol
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.document import Document
from orthoglide_cal.report.documents.answer import diagnosis_document, solution_document
from orthoglide_cal.report.documents.plan import plan_document
from orthoglide_cal.report.html import html
from tests.machines import NOMINAL
from tests.printer_files import OFF, printer_cfg
from tests.printers import printer
from tests.report.cases import DOCUMENTS, report_of
from tests.results.cases import CASES, as_left, case_of
from tests.truth.delta import TOLERANCES, V400

# "> 99 %" stands for any larger share.
NUMBER = re.compile(r"(?<![\w.])(?<![<>] )[-+−]?\d+(?:\.\d+)?(?![\w.]*\d)( %| µm)?")
# What is no result: the style, the numbers along axes, the names of shapes, text from outside.
NO_RESULTS = (
    r"<style.*?</style>", r"<title.*?</title>", r'<text[^>]*class="tick".*?</text>',
    r"<bdi>.*?</bdi>", r"<code.*?</code>", "SHA-256", "√12", r"eq\. \d+", "off 20 °C",
)  # fmt: skip
# Written in sentences that are the same on every page.
FIXED = {"95", "1", "2", "3", "4"}


def numbers_in(value: object) -> Iterator[float]:
    """All numbers of a JSON value, those within its texts, and how many a list has."""
    if isinstance(value, bool) or value is None:
        return
    if isinstance(value, int | float):
        yield abs(float(value))
    elif isinstance(value, str):
        yield from (abs(float(found.replace("−", "-")))
                    for found in re.findall(r"\d+(?:\.\d+)?", value))  # fmt: skip
    elif isinstance(value, dict):
        for key, inner in value.items():
            # Readings are drawn, not written: so many numbers would hold nearly any other.
            rows = [row for row in inner if row["distance"]] if key == "residuals" else inner
            yield from numbers_in(rows)
    elif isinstance(value, list):
        yield float(len(value))
        yield from (found for each in value for found in numbers_in(each))


def written(page: str) -> Iterator[tuple[str, str]]:
    """Each number of a page with the text around it."""
    for pattern in NO_RESULTS:
        page = re.sub(pattern, " ", page, flags=re.DOTALL)
    text = unescape(re.sub(r"<[^>]*>", " ", page))
    for found in NUMBER.finditer(text):
        yield found[0], " ".join(text[max(found.start() - 40, 0) : found.end() + 20].split())


def drawn(case: Case) -> Iterator[float]:
    """What a table of readings says: measured, − modelled [mm], where; that and means [µm]."""
    cells: dict[object, list[tuple[float, ...]]] = {}
    for row in case.answer.residuals:
        key = row.leg, row.direction, row.end, row.gauge_at, row.part, row.posture
        models = (row.modelled_mm, row.with_causes_mm or row.modelled_mm)
        left = tuple(row.measured_mm - modelled for modelled in models)
        cells.setdefault(key, []).append(left)
        yield from map(abs, (*left, row.measured_mm, row.modelled_mm))
        patterns = (left[-1] + mm for mm in row.pattern_mm)
        yield from (1000.0 * abs(size) for size in (*left, *patterns))
        yield from map(abs, (row.order, row.cycle, row.x_mm or 0.0, row.y_mm or 0.0))
    surfaces: dict[float | None, list[float]] = {}
    for row in case.answer.residuals:
        surfaces.setdefault(row.surface_mm, []).extend([] if row.distance else [row.measured_mm])
    for heights in filter(None, surfaces.values()):
        yield from (abs(mm - sum(heights) / len(heights)) for mm in heights)
    for rows in cells.values():
        yield from (1000.0 * abs(sum(own) / len(rows)) for own in zip(*rows, strict=True))


def mapped(plan: MeasurementPlan) -> Iterator[float]:
    """What the map of causes says: whole standard deviations, 99 for any more."""
    data = plan.model_dump(mode="json")
    apart = [*data["trace"].values(), *(pair["sigma"] for pair in data["separation"])]
    yield from (99.0, *(min(int(sigma), 99) for sigma in apart))


def missing(document: Document, more: Iterable[float] = ()) -> list[str]:
    known = {*more, *numbers_in(json.loads(json.dumps(document.data(), allow_nan=False)))}
    faults = []
    for number, around in written(html(document.page())):
        digits, _, unit = number.lstrip("+-−").partition(" ")
        scale = {"%": 100.0, "µm": 1000.0}.get(unit, 1.0)
        half = 0.5 * 10.0 ** -len(digits.partition(".")[2]) / scale * 1.0001
        wanted = float(Decimal(digits)) / scale
        if digits not in FIXED and not any(abs(value - wanted) <= half for value in known):
            faults.append(f"{number} in: {around}")
    return faults


@pytest.mark.parametrize("name", [*CASES, "as_left", "verified"])
def test_every_number_of_a_report_is_in_its_json(name: str) -> None:
    shown = [CASES[name]()] if name in CASES else [as_left()[0], as_left()[2]]
    assert missing(DOCUMENTS[name](), chain(*map(drawn, shown))) == []


@pytest.mark.parametrize("name", [name for name in CASES if name != "failed"])
def test_every_number_of_a_solution_and_of_a_diagnosis_is_in_its_json(name: str) -> None:
    case = CASES[name]()
    assert missing(solution_document(case), drawn(case)) == []
    assert missing(diagnosis_document(case), drawn(case)) == []


@pytest.mark.parametrize("data", ["calibration", "mesh"])
def test_every_number_of_a_printer_is_in_its_json(tmp_path: Path, data: str) -> None:
    path = tmp_path / "printer.cfg"
    path.write_text(printer_cfg(V400, OFF), encoding="utf-8")
    case = case_of(read_input(str(path), stored=data))
    document = report_of(case)
    assert missing(document, drawn(case)) == []
    assert "Repeats alone" not in repr(document.page())  # no place was touched twice


@pytest.mark.parametrize(
    ("model", "session", "target_mm"),
    [
        (NOMINAL, GuidedSession(protocol=MeasuringProtocol.SINGLE, stands=1), 0.02),
        (NOMINAL, GuidedSession(protocol=MeasuringProtocol.BEST, cycles=4), None),
        (Model(printer(V400, TOLERANCES)), None, None),
    ],
    ids=["single-posture", "best-design", "printer"],
)
def test_every_number_of_a_plan_is_in_its_json(
    model: Model, session: GuidedSession | None, target_mm: float | None
) -> None:
    plan = measurement_plan(chosen_session(model, session, target_mm), target_mm)
    assert missing(plan_document(plan), mapped(plan)) == []


def test_every_number_of_a_plan_to_go_on_is_in_its_json() -> None:
    case = CASES["ambiguous"]()
    measured, model = case.given.measured, case.given.model
    ranked = rank_measurements(diagnose(measured, model))
    plan = measurement_plan(chosen_session(model), None, ranked)
    document = plan_document(plan, None, case)
    assert missing(document, mapped(plan)) == []
