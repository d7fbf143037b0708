"""The result of `report` and of `export`: one input solved, diagnosed, judged, and what follows."""

from __future__ import annotations

import hashlib
from collections.abc import Container, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Any

import numpy as np

from orthoglide_cal import __version__
from orthoglide_cal.diagnosis import Diagnosis, Verdict, diagnose
from orthoglide_cal.errors import PostureError, UnusableResultError
from orthoglide_cal.estimation import Known, Solution, solve
from orthoglide_cal.estimation.accuracy import CONFIDENCE, chance_of_residual, half_width
from orthoglide_cal.estimation.solution import SUSPICIOUS
from orthoglide_cal.files import Input, machine_values
from orthoglide_cal.model import Model, Source, View
from orthoglide_cal.model.workspace import WorkspaceError, workspace_error
from orthoglide_cal.planning import RankedMeasurement, best_next
from orthoglide_cal.results.adjustment import Adjustment, as_diagnosed, as_found
from orthoglide_cal.results.answer import Answer, Release, Remedy
from orthoglide_cal.results.making import answer_to
from orthoglide_cal.results.release import release
from orthoglide_cal.results.residuals import Explained, Residuals, explained, residuals
from orthoglide_cal.verification import Size, Verification


@dataclass(frozen=True)
class Identity:
    """What makes a report unique.

    Attributes:
        number: the same for the same inputs and options, whenever and however often it is shown.
        issued: time of issue, UTC.
        software: name and version.
    """

    number: str
    issued: datetime
    software: str


def identify(
    inputs: Iterable[tuple[Source, Model]], *options: object, issued: datetime | None = None
) -> Identity:
    """Who this result is: its number follows from what went into it, not from when it is shown.

    Args:
        inputs: each file, with the machine that it is judged by.
        options: whatever else changes the result; their `str` tells them apart.
        issued: time of issue; now if None.
    """
    software = f"orthocal {__version__}"
    parts = [
        (source.sha256, *([source.excerpt.data] if source.excerpt else []), _judging(model))
        for source, model in inputs
    ]
    made_of = repr((software, parts, [str(option) for option in options]))
    digest = hashlib.sha256(made_of.encode()).hexdigest()[:12].upper()
    return Identity(f"OC-{digest[:6]}-{digest[6:]}", issued or datetime.now(UTC), software)


def _judging(model: Model) -> dict[str, Any]:
    """What a machine file says of the machine; what was entered later changes no result."""
    values = machine_values(model)
    return {name: said for name, said in values.items() if name != "history"}


@dataclass(frozen=True, eq=False)
class Calibration:
    """What one input says; what follows from it is computed when it is asked for.

    Attributes:
        identity: number, time, software.
        input: what was measured, on which machine, under which conditions.
        release: may the solution's offsets be entered, and why not.
        solution: of the offsets alone (with the causes accepted in the machine file); it can
            check itself again. None if there is no result.
        diagnosis: None also where these data cannot be diagnosed.
        verification: of the session measured after the adjustment (as left); None without one.
        following: what to measure next where the diagnosis leaves several explanations open; None
            if nothing is open, or no measurement could tell.
    """

    identity: Identity
    input: Input
    release: Release
    solution: Solution | None = None
    diagnosis: Diagnosis | None = None
    verification: Verification | None = None
    following: RankedMeasurement | None = None

    @cached_property
    def answer(self) -> Answer:
        """What every page and `--json` say."""
        chosen = self.solution and not self.solution.method_is_default
        method = str(self.solution.method) if self.solution and chosen else None
        return answer_to(self.input, method, diagnosed=self.diagnosis, details=True)

    @cached_property
    def model(self) -> Model:
        """The machine with the causes that the diagnosis finds in it, as if accepted now."""
        known, diagnosis = self.input.model, self.diagnosis
        if diagnosis is None or diagnosis.verdict is Verdict.AMBIGUOUS:
            return known
        day = self.identity.issued.date().isoformat()
        return known.extended(
            cause.effect.accepted(day, diagnosis.source.sha256)
            for cause in diagnosis.causes
            if cause.in_machine and cause.effect.cause.lasting
        )

    @property
    def found(self) -> tuple[Solution, Adjustment]:
        """The solution, and what follows from its own offsets.

        Raises:
            UnusableResultError: there is none; says why, and what to do.
        """
        if self.solution is None or self.alone is None:
            remedies = " ".join(remedy.sentence for remedy in self.release.remedies)
            raise UnusableResultError(" ".join(self.release.reasons), remedies)
        return self.solution, self.alone

    @property
    def diagnosed(self) -> tuple[Diagnosis, Adjustment]:
        """The diagnosis, and what follows from the offsets that it leads to.

        Raises:
            UnusableResultError: there is none.
        """
        if self.diagnosis is None or self.adjustment is None:
            raise UnusableResultError("There is no diagnosis.", " ".join(self.release.reasons))
        return self.diagnosis, self.adjustment

    @cached_property
    def alone(self) -> Adjustment | None:
        """The solution's own offsets, with the accepted causes alone; None without a result.

        What is promised of them takes a cause into account that was named and does not bar them.
        """
        solution, diagnosis = self.solution, self.diagnosis
        if solution is None:
            return None
        named = diagnosis is not None and diagnosis.verdict is Verdict.NAMED
        if diagnosis is not None and named and self.release.usable:
            real = Known(self.model, diagnosis.offsets_mm, diagnosis.covariance_mm2)
        else:
            real = Known(self.input.model, solution.offsets_mm, solution.covariance_mm2)
        return as_found(solution, diagnosis, real, self.input.conditions.mean_temperature_c)

    @cached_property
    def adjustment(self) -> Adjustment | None:
        """The offsets to enter, with their uncertainty; None without a result.

        Those of the solution; of the diagnosis where it knows better and those are not released.
        """
        solution, diagnosis = self.solution, self.diagnosis
        if solution is None or diagnosis is None or self.release.usable:
            return self.alone
        if diagnosis.verdict is Verdict.CONSISTENT:
            return self.alone
        real = Known(self.model, diagnosis.offsets_mm, diagnosis.covariance_mm2)
        return as_diagnosed(solution, diagnosis, real, self.input.conditions.mean_temperature_c)

    @cached_property
    def settled(self) -> bool:
        """Whether the controller has the parameters already, as well as the readings know them.

        No change exceeds what noise and a local shape make of it, nor do all together (χ²): what
        else may be wrong, and what is taken as the controller has it, would be the same again.
        Never of joint offsets, which are told as an excess.
        """
        solution, model = self.solution, self.input.model
        if solution is None or not (model.machine.absolute and self.release.usable):
            return False
        if any(effect.cause.compensable for effect in model.accepted):
            return False  # it is to be entered, too
        known, change = solution.budget.without(model.machine.fixed_parameters), solution.offsets_mm
        if np.any(np.abs(change) > known.expanded_mm):
            return False
        apart = float(change @ np.linalg.solve(known.covariance_mm2, change))
        widened = known.k / half_width(np.inf)
        return chance_of_residual(apart, len(change), widened) >= 1.0 - CONFIDENCE

    @property
    def enters(self) -> bool:
        """Whether there is something to enter, and it may be."""
        return self.release.usable and not self.settled

    @cached_property
    def residuals(self) -> Residuals | None:
        """Measured and predicted by the solution, entry by entry; None without a result.

        Nor of readings that are not taken at legs.
        """
        measured = self.input.measured
        if self.solution is None or measured.view is not View.LEGS:
            return None
        return residuals(measured, self.solution.predicted_mm)

    @cached_property
    def explained(self) -> Explained | None:
        """What the diagnosis explains of the residuals; None without a diagnosis."""
        return None if self.diagnosis is None else explained(self.diagnosis)

    @property
    def left_mm(self) -> dict[str, float]:
        """Step → r.m.s. of the data that it leaves, from "as found" on; empty without a result."""
        if self.solution is None:
            return {}
        solution, many = self.solution, self.solution.model.machine.vocabulary.many
        left = {"as found": solution.rms_before_mm, many: solution.rms_after_mm}
        diagnosis, parts = self.diagnosis, self.explained
        if diagnosis is not None and parts is not None and diagnosis.verdict is Verdict.NAMED:
            left[" and ".join(cause.id for cause in diagnosis.causes)] = parts.rms_after_mm
        return left

    @property
    def noise_mm(self) -> float | None:
        """How much of the r.m.s. that the last step leaves is the gauge's noise.

        All of it where noise alone leaves as much in one case of a thousand; None without spare
        readings.
        """
        solution = self.solution
        if solution is None or solution.rms_of_noise_mm is None:
            return None
        left = list(self.left_mm.values())[-1]
        noise = solution.rms_of_noise_mm
        chance = chance_of_residual(solution.dof * left**2, solution.dof, noise)
        return noise if chance < SUSPICIOUS else left

    @cached_property
    def workspace(self) -> WorkspaceError | None:
        """Tool-position error before and after the adjustment; None if it cannot be computed."""
        found = self.adjustment
        if found is None or not found.machine.has_cube:
            return None
        try:
            budget = found.budget
            return workspace_error(self.model, found.offsets_mm, budget.covariance_mm2, budget.k)
        except PostureError:
            return None

    @property
    def as_found(self) -> Size | None:
        """The differences as measured; None without any."""
        table = self.adjustment.promised if self.adjustment else ()
        return Size.of({row.difference: row.measured_mm for row in table}) if table else None

    @property
    def expected(self) -> Size | None:
        """What should remain of them once the adjustment is entered; None without any."""
        table = self.adjustment.promised if self.adjustment else ()
        return Size.of({row.difference: row.expected_mm for row in table}) if table else None

    @property
    def as_left(self) -> Size | None:
        """The differences as measured after the adjustment; None if they were not."""
        return self.verification.as_left if self.verification else None


def calibrate(
    given: Input,
    method: str | None = None,
    *,
    diagnosed: Diagnosis | None = None,
    sensitivity: Container[Verdict] = (),
    verification: Verification | None = None,
    issued: datetime | None = None,
) -> Calibration:
    """Solve, diagnose and judge one input.

    Args:
        given: the input.
        method: name of an estimator; the default for the data if None.
        diagnosed: a diagnosis of it that was made already; it is made here if None.
        sensitivity: verdicts for which the diagnosis says how they depend on the tolerances.
        verification: of a later session, to be shown as left.
        issued: time of issue; now if None.

    Raises:
        UsageError, InputError: as `solve`. A result that must not be used raises nothing: the
            report says so.
    """
    measured, model = given.measured, given.model
    try:
        solution = solve(measured, model, method)
    except UnusableResultError as error:
        remedies = (Remedy(sentence=error.remedy),) if error.remedy else ()
        refused = Release(reasons=(error.what,), remedies=remedies, sound=False)
        identity = _identify(given, method, verification, issued)
        return Calibration(identity, given, refused, verification=verification)
    try:
        diagnosed = diagnosed or diagnose(measured, model, sensitivity=sensitivity)
    except UnusableResultError:
        # Numbers out of all proportion: the solution's own check is all there is.
        diagnosed = None
    following = None if diagnosed is None else best_next(diagnosed)
    decision = release(solution, diagnosed, following)
    identity = _identify(given, solution.method, verification, issued)
    return Calibration(identity, given, decision, solution, diagnosed, verification, following)


def _identify(
    given: Input, method: str | None, left: Verification | None, issued: datetime | None
) -> Identity:
    """Of one input alone, or with what was measured after the adjustment."""
    first = given.measured.source, given.model
    if left is None:
        return identify([first], method, issued=issued)
    return identify([first, *left.inputs], method, *left.options, issued=issued)


@dataclass(frozen=True, eq=False)
class Export:
    """A calibration whose offsets may go to the controller, or are forced to.

    Attributes:
        calibration: the result.
        adjustment: its adjustment.
    """

    calibration: Calibration
    adjustment: Adjustment

    @property
    def forced(self) -> tuple[str, ...]:
        """Why it must not be used, exported all the same; empty if it may be used."""
        return self.calibration.release.reasons

    @property
    def status(self) -> str:
        """ "released" or "FORCED"."""
        return "FORCED" if self.forced else "released"


def export(calibration: Calibration, force: bool = False) -> Export:
    """Release the offsets for the controller.

    Args:
        calibration: solved, diagnosed and judged.
        force: export a result that must not be used; it is marked in every format.

    Raises:
        UnusableResultError: the result must not be used, or there is none. What to do instead
            stands in the release; the error adds how to export all the same.
    """
    decision, adjustment = calibration.release, calibration.adjustment
    if adjustment is None or not (decision.usable or force):
        force_it = "To export all the same, marked as forced: --force"
        reasons = " ".join(decision.reasons)
        raise UnusableResultError(
            f"Export refused. {reasons}", "" if adjustment is None else force_it
        )
    return Export(calibration, adjustment)
