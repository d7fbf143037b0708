"""Everything that a calibration report shows, computed once."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from orthoglide_cal import __version__
from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import CAUSES, machine_effects
from orthoglide_cal.diagnosis.result import AMBIGUOUS, CONSISTENT, Diagnosis
from orthoglide_cal.errors import PostureError, UnusableResultError
from orthoglide_cal.estimation import Solution, solve
from orthoglide_cal.estimation.methods import pose_differences
from orthoglide_cal.machine import IdentifiedCause, Machine
from orthoglide_cal.measured import Differences, Measured
from orthoglide_cal.outcome.adjustment import Adjustment, adjust
from orthoglide_cal.outcome.answer import Answer, choose_answer, plain_answer
from orthoglide_cal.outcome.case import Case, Conditions
from orthoglide_cal.outcome.release import Release, release
from orthoglide_cal.outcome.summary import (
    Deviations,
    Explained,
    as_expected,
    as_found,
    explained,
)
from orthoglide_cal.outcome.traces import Traces, traces
from orthoglide_cal.outcome.workspace import WorkspaceError, workspace_error
from orthoglide_cal.verification import Verification


@dataclass(frozen=True, eq=False)
class Identity:
    """What makes a report unique.

    Attributes:
        number: from the input's digest and the time of issue.
        issued: time of issue, UTC.
        software: name and version.
    """

    number: str
    issued: datetime
    software: str


@dataclass(frozen=True, eq=False)
class Findings:
    """What a solved session says.

    Attributes:
        solution: of the offsets alone (with the causes accepted in the machine file).
        diagnosis: None if it was not made.
        answer: offsets and uncertainty that the report stands for.
        plain: the same of the offsets alone, whatever the diagnosis says.
        adjustment: what to enter.
        traces: measured and predicted by the solution.
        explained: what the diagnosis explains; None without a diagnosis.
        found, expected: sizes of the differences as found and after the adjustment.
        workspace: tool-position error before and after; None if it cannot be computed.
    """

    solution: Solution
    diagnosis: Diagnosis | None
    answer: Answer
    plain: Answer
    adjustment: Adjustment
    traces: Traces
    explained: Explained | None
    found: Deviations | None
    expected: Deviations | None
    workspace: WorkspaceError | None


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibration report's content.

    Attributes:
        identity: number, time, software.
        machine, measured, conditions: the input.
        session: True if the input is a session file.
        findings: None if there is no result.
        release: may the offsets be entered, and why not.
        verification: of the session measured after the adjustment (as left); None without one.
    """

    identity: Identity
    machine: Machine
    measured: Measured
    conditions: Conditions
    session: bool
    findings: Findings | None
    release: Release
    verification: Verification | None = None


def identify(sha256: str, issued: datetime | None = None) -> Identity:
    """A report's identity; two reports never share it, not even of the same input."""
    moment = issued or datetime.now(UTC)
    digest = hashlib.sha256(f"{sha256} {moment.isoformat()}".encode()).hexdigest()
    number = f"OC-{moment:%Y%m%d-%H%M%S}-{digest[:8].upper()}"
    return Identity(number, moment, f"orthocal {__version__}")


def calibrate(
    case: Case,
    method: str | None = None,
    *,
    diagnosed: bool = True,
    verification: Verification | None = None,
    issued: datetime | None = None,
) -> Calibration:
    """Solve, diagnose and judge one input.

    Args:
        case: the input.
        method: name of an estimator; the default for the data if None.
        diagnosed: False leaves the diagnosis out.
        verification: of a later session, to be shown as left.
        issued: time of issue; now if None.

    Raises:
        UsageError, InputError: as `solve`. A result that must not be used raises nothing: the
            report says so.
    """
    identity = identify(case.measured.source.sha256, issued)
    machine, measured = case.machine, case.measured
    findings = None
    try:
        solution = solve(measured, machine, method, machine_effects(machine))
    except UnusableResultError as error:
        decision = Release(False, (error.what,), (error.remedy,) if error.remedy else ())
    else:
        diagnosis = _diagnose(measured, machine) if diagnosed else None
        decision = release(solution, diagnosis)
        findings = _findings(measured, machine, solution, diagnosis, decision)
    return Calibration(
        identity=identity,
        machine=machine,
        measured=measured,
        conditions=case.conditions,
        session=case.session,
        findings=findings,
        release=decision,
        verification=verification,
    )


def _diagnose(measured: Measured, machine: Machine) -> Diagnosis | None:
    from orthoglide_cal.diagnosis import diagnose

    try:
        effects = machine_effects(machine)
        found = diagnose(measured, machine, effects)
        if found.verdict == CONSISTENT:
            return found
        # How the answer depends on the tolerances takes time, and says nothing of healthy data.
        return diagnose(measured, machine, effects, sensitivity=True)
    except UnusableResultError:
        return None


def _findings(
    measured: Measured,
    machine: Machine,
    solution: Solution,
    diagnosis: Diagnosis | None,
    decision: Release,
) -> Findings:
    plain = plain_answer(solution)
    # Usable offsets are those that were solved for; otherwise the diagnosis knows better.
    answer = plain if decision.usable else choose_answer(solution, diagnosis)
    shown = traces(measured, _predicted(measured, machine, solution))
    real = machine if diagnosis is None else _with_causes(machine, diagnosis)
    return Findings(
        solution=solution,
        diagnosis=diagnosis,
        answer=answer,
        plain=plain,
        adjustment=adjust(solution, answer, machine),
        traces=shown,
        explained=explained(diagnosis, shown.leg, shown.order) if diagnosis else None,
        found=as_found(solution),
        expected=as_expected(solution),
        workspace=_workspace(real, answer),
    )


def _predicted(measured: Measured, machine: Machine, solution: Solution) -> Floats:
    """What the solution predicts for each entry of the file, shape (n,) [mm]."""
    if isinstance(measured, Differences):
        posed = pose_differences(measured, machine, measured.kind, machine_effects(machine))
        modelled = posed.problem.model(solution.offsets_mm).tolist()
        by_name = dict(zip(posed.names, modelled, strict=True))
        return np.array([by_name[name] for name in measured.names])
    assert solution.readings_mm is not None
    return solution.readings_mm


def _with_causes(machine: Machine, diagnosis: Diagnosis) -> Machine:
    """The machine with the causes that the diagnosis finds in it."""
    if diagnosis.verdict == AMBIGUOUS:
        return machine
    found = tuple(
        IdentifiedCause(cause.id, cause.where, cause.parameters, "", "")
        for cause in diagnosis.causes
        if cause.in_machine and CAUSES[cause.id].lasting
    )
    return replace(machine, identified=(*machine.identified, *found))


def _workspace(machine: Machine, answer: Answer) -> WorkspaceError | None:
    try:
        return workspace_error(
            machine, answer.offsets_mm, answer.covariance_mm2, answer.k, machine_effects(machine)
        )
    except PostureError:
        return None
