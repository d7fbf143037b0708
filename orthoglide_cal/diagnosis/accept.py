"""Making a cause part of the machine: the fitted parameters as they go into the machine file."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from datetime import date

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis.assess import assess
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.diagnosis.posterior import DISMISSED
from orthoglide_cal.diagnosis.result import AMBIGUOUS, CONSISTENT, UNEXPLAINED
from orthoglide_cal.effects import Effect
from orthoglide_cal.errors import UnusableResultError, UsageError
from orthoglide_cal.machine import Estimate, IdentifiedCause, Machine
from orthoglide_cal.measured import Measured


def extend(
    measured: Measured, machine: Machine, effects: Sequence[Effect], id: str, on: date
) -> Machine:
    """The machine with one more identified cause.

    Args:
        measured: the data that it is identified from.
        machine: as known so far.
        effects: causes already identified, as effects.
        id: cause to accept.
        on: date to note.

    Raises:
        UsageError: there is no such cause.
        UnusableResultError: these data do not support it, or it lies in the measurement.
    """
    cause = CAUSES.get(id)
    if cause is None:
        raise UsageError(f"There is no cause {id!r}.", f"Choose one of {', '.join(CAUSES)}.")
    if not cause.lasting:
        raise UnusableResultError(
            f"{id} lies in the measurement, not in the machine: it cannot be accepted.",
            cause.advice,
        )
    frame = Frame.of(measured, machine, effects)
    found = assess(frame)
    verdict = found.answer.verdict
    if verdict in (CONSISTENT, UNEXPLAINED):
        raise UnusableResultError(
            f"These data are {verdict}: they do not support {id} as an extension.",
            "Run orthocal diagnose and see what it says.",
        )
    if verdict == AMBIGUOUS:
        # What stands in its place in an explanation without it; the explanations that hold it
        # may differ in what else was wrong with the measurement.
        sets = (found.answer.accepted, *found.posterior.rivals())
        shared = set.intersection(*map(set, sets))
        doubtful = [
            other
            for other in dict.fromkeys(other for names in sets for other in names)
            if id not in shared and other not in shared and not CAUSES[other].in_machine
        ]
        if doubtful:
            raise UnusableResultError(
                f"These data cannot tell what lies in the machine from {', '.join(doubtful)},"
                " which lies in the measurement.",
                "Take the reading that orthocal diagnose names, then accept.",
            )
    listed = found.posterior.listed
    keys = [key for key in listed if id in key and listed[key] > 0.0]
    best = max(keys, key=lambda key: listed[key]) if keys else ()
    if not best or listed[best] < DISMISSED * listed[found.answer.accepted]:
        raise UnusableResultError(
            f"These data speak against {id}.",
            f"They name {', '.join(found.answer.accepted)}.",
        )
    fit = found.fit(best)
    start = 3
    for act in fit.acting:
        if act.cause.id == id:
            break
        start += act.theta.size
    own = slice(start, start + len(cause.names))
    covariance = fit.covariance[own, own]
    stds = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(stds, stds)
    parameters = {
        name: Estimate(
            cause.admissible(float(value)) / cause.scale, float(std / cause.scale), cause.unit
        )
        for name, value, std in zip(cause.names, act.theta, stds, strict=False)
    }
    identified = IdentifiedCause(
        id,
        "",
        parameters,
        on.isoformat(),
        measured.source.sha256,
        tuple(tuple(row) for row in correlation.round(6).tolist()),
    )
    return dataclasses.replace(machine, identified=(*machine.identified, identified))
