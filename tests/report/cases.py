"""Documents of every kind, made from the answers of the tests of results; shared by tests."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError
from orthoglide_cal.files.input import Check, InputFile
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import JointOffsets
from orthoglide_cal.paper.tables import table_5
from orthoglide_cal.planning.plan import chosen_session, measurement_plan
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.document import Document
from orthoglide_cal.report.documents.answer import diagnosis_document, solution_document
from orthoglide_cal.report.documents.history import history_document
from orthoglide_cal.report.documents.plan import plan_document
from orthoglide_cal.report.documents.reports import calibration_document, verification_document
from orthoglide_cal.report.documents.short import check_document, paper_document
from orthoglide_cal.results.history import compare
from orthoglide_cal.results.verification import verify
from orthoglide_cal.schema import Reason
from tests.machines import NOMINAL
from tests.results import cases
from tests.results.cases import CASES, GAP, GAPED, HOSTILE, case_of, identity_of
from tests.results.sessions import FINE, TRUE, given, session


def changed(model: Model, **new: object) -> Model:
    """The model of a machine with another name, gauge or active offsets."""
    return replace(model, machine=model.machine.changed(**new))


def report_of(case: Case) -> Document:
    return calibration_document(case, identity_of(case))


# Name → maker of a document, one of each kind; each is made once.
DOCUMENTS: dict[str, Callable[[], Document]] = {
    name: cache(lambda make=make: report_of(make())) for name, make in CASES.items()
}


def listed(make: Callable[[], Document]) -> Callable[[], Document]:
    DOCUMENTS[make.__name__] = cache(make)
    return DOCUMENTS[make.__name__]


@listed
def as_left() -> Document:
    case, left, after = cases.as_left()
    return calibration_document(case, identity_of(case), left, after=after)


@listed
def remembered() -> Document:
    """Four sessions of one machine: z changes after the second; with a limit."""
    moved = TRUE + np.array([0.0, 0.0, 0.13])
    sessions = [given(session(TRUE if k < 42 else moved, k)) for k in range(40, 44)]
    dates = ("2026-03-02", "2026-04-07", "2026-05-12", "2026-06-03")
    return history_document(compare(sessions, dates, 0.1))


@listed
def verified() -> Document:
    """A correction with exchanged axes, a change of the machine, and a limit."""
    before = given(session(TRUE, 12, FINE), FINE)
    after = given(session(TRUE - TRUE[[1, 0, 2]], 13, GAPED), FINE)
    found = verify(before, after, TRUE.tolist(), limit_mm=0.05)
    return verification_document(found)


@listed
def solved() -> Document:
    """Readings with a hostile name, of a machine with a hostile name and active offsets."""
    harmful = cases.hostile().given
    model = changed(harmful.model, name=HOSTILE[3], offsets_mm=JointOffsets(0.25, -1.5, 0.0))
    return solution_document(case_of(replace(harmful, model=model)))


@listed
def diagnosed() -> Document:
    """A cause in the machine, and hostile names."""
    model = changed(NOMINAL, name=HOSTILE[3], gauge=FINE.machine.gauge)
    good = session(TRUE, 4, model.extended([CAUSES["axis_gap"].at(GAP)]))
    measured = replace(good, source=replace(good.source, path=HOSTILE[3] + ".csv"))
    read = replace(given(measured, model), machine_file=Path(HOSTILE[0]))
    return diagnosis_document(case_of(read))


@listed
def undecided() -> Document:
    """The paper's second experiment: several explanations, differences instead of readings."""
    return diagnosis_document(cases.ambiguous())


@listed
def faulty() -> Document:
    """A file with faults, hostile in name and value."""
    problems = (
        InputError("No axis.", "Write x, y or z.", line=2, column="leg", value=HOSTILE[3]),
        InputError(f"Columns {HOSTILE[2]} are not known."),
    )
    file = InputFile(path=HOSTILE[3] + ".csv")
    remarks = tuple(Reason.of("unknown_names", kind=t, names=[t], hints=t) for t in HOSTILE)
    return check_document(Check(input=file, valid=False, problems=problems, remarks=remarks))


@listed
def planned() -> Document:
    """A machine with a hostile name, and a target that no number of cycles reaches."""
    plan = measurement_plan(chosen_session(changed(NOMINAL, name=HOSTILE[3]), None, 0.01), 0.01)
    return plan_document(plan, Path(HOSTILE[0]))


@listed
def reproduced() -> Document:
    return paper_document(table_5(NOMINAL))
