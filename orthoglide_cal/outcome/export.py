"""The offsets for the controller: released, or forced and marked so."""

from __future__ import annotations

from dataclasses import dataclass

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Source
from orthoglide_cal.outcome.adjustment import Adjustment
from orthoglide_cal.outcome.answer import Answer
from orthoglide_cal.outcome.calibration import Calibration, Identity


@dataclass(frozen=True, eq=False)
class Export:
    """What goes to the controller.

    Attributes:
        identity: number, time, software.
        source: the data.
        machine: with the offsets active so far.
        adjustment: previous, change and new of each joint; the check posture.
        answer: uncertainty.
        forced: reasons why it must not be used, exported all the same; empty if it may be used.
        cautions: what to know although it may be used.
    """

    identity: Identity
    source: Source
    machine: Machine
    adjustment: Adjustment
    answer: Answer
    forced: tuple[str, ...]
    cautions: tuple[str, ...]

    @property
    def status(self) -> str:
        """ "released" or "FORCED"."""
        return "FORCED" if self.forced else "released"


class RefusedError(UnusableResultError):
    """The result must not be used; `reasons` says why.

    Args:
        reasons: in sentences.
        remedies: what to do instead.
        forcible: True if --force would help.
    """

    def __init__(self, reasons: tuple[str, ...], remedies: tuple[str, ...], forcible: bool) -> None:
        force = ("To export all the same, marked as forced: --force",) if forcible else ()
        super().__init__(f"Export refused. {' '.join(reasons)}", " ".join((*remedies, *force)))
        self.reasons = reasons
        self.remedies = remedies


def export(calibration: Calibration, force: bool = False) -> Export:
    """Release the offsets for the controller.

    Args:
        calibration: solved, diagnosed and judged.
        force: export a result that must not be used; it is marked in every format.

    Raises:
        RefusedError: the result must not be used, or there is none.
    """
    decision, findings = calibration.release, calibration.findings
    if findings is None:
        raise RefusedError(decision.reasons, decision.remedies, forcible=False)
    if not decision.usable and not force:
        raise RefusedError(decision.reasons, decision.remedies, forcible=True)
    return Export(
        identity=calibration.identity,
        source=calibration.measured.source,
        machine=calibration.machine,
        adjustment=findings.adjustment,
        answer=findings.answer,
        forced=decision.reasons,
        cautions=decision.cautions,
    )
