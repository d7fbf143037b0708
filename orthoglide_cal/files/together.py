"""Touches of one printer on several dates, as one measurement by the settings of the last date."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import PurePath

import numpy as np

from orthoglide_cal.errors import UsageError
from orthoglide_cal.files.input import Input
from orthoglide_cal.model.linear_delta import LinearDelta, ProbePlan
from orthoglide_cal.model.measured import Excerpt, Readings, Source
from orthoglide_cal.model.model import differentiate
from orthoglide_cal.model.plan import joined


def together(inputs: Sequence[Input]) -> Input:
    """One measurement of one machine, whose calibrated parameters are others on each date.

    Each touch stands where the settings of the last date would have put the nozzle with its
    carriages at the same heights. What the parameters of another date differ by beyond that is
    unknown, and has no part in the evidence.

    The latest date is the last. Raises UsageError: they are not all touches of one printer.
    """
    last = inputs[-1]
    if not all(each.measured.of_bed for each in inputs):
        what = "--together is for touches of one printer's bed on several dates."
        raise UsageError(what, "Leave it out: each file is then judged alone.")
    machine = LinearDelta.require(last.model.machine)
    zero = np.zeros(len(machine.parameter_names))
    start = 0  # how many readings the dates before have
    reads, plans, values = [], [], []
    for number, each in enumerate(inputs):
        own, read = LinearDelta.require(each.model.machine), each.measured
        own.check_same(machine)
        assert isinstance(read, Readings)
        plan = ProbePlan.require(read.plan)
        day = np.full(len(plan), number)
        place, other = (machine.believed(own, at) for at in (plan.place, plan.other))
        now = replace(plan, place=place, other=other, order=plan.order + start, part=day)
        grown = plan.wanted - now.wanted
        values.append(np.where(plan.distance, read.value + grown, place[:, 2] - plan.surface))
        slope = differentiate(last.model, zero, now, ())[1] * (each is not last)
        plans.append(replace(now, slope=slope, date=day))
        reads.append(read)
        start += len(plan)
    sources = [read.source for read in reads]
    excerpt = sources[-1].excerpt
    words = f"{start} readings of {len(inputs)} dates"
    source = Source(
        sources[-1].path,
        hashlib.sha256("".join(each.sha256 for each in sources).encode()).hexdigest(),
        Excerpt(excerpt.data if excerpt else "", words),
        tuple(each.path for each in sources[:-1]),
    )
    changed = (
        f"{PurePath(before.measured.source.path).name} and"
        f" {PurePath(after.measured.source.path).name}: other {', '.join(names)} in force."
        for before, after in pairwise(inputs)
        if (names := before.model.machine.differing(after.model.machine))
    )
    measured = Readings(
        joined(*plans),
        np.concatenate(values),
        np.concatenate([read.line for read in reads]),
        all(read.timed for read in reads),
        source,
        remarks=tuple(dict.fromkeys((*changed, *(r for read in reads for r in read.remarks)))),
    )
    return replace(last, measured=measured)
