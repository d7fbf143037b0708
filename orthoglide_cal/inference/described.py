"""A pattern beyond the list in numbers: size, parameters, and what it gains in omitted cycles."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.inference.fit import Fit, leave_out, left_out
from orthoglide_cal.inference.hypothesis import Hypothesis, Pattern
from orthoglide_cal.inference.patterns import at_usual_size, extended, fits_of
from orthoglide_cal.inference.result import FoundPattern
from orthoglide_cal.model.cause import NORMAL_K, Estimate
from orthoglide_cal.model.measured import Measured, Readings
from orthoglide_cal.model.plan import Bools, Floats, Ints, Where, without_zeros

MINUTES = 60.0  # in an hour
# Pattern → name of the parameter of its shapes.
_SHAPE_NAMES = {"drifts": "period", "settles": "time_constant", "steps": "moment"}

_Fits = Sequence[tuple[float, Fit]]


def described(
    hypothesis: Hypothesis,
    base: Fit,
    measured: Measured,
    probability: float,
    accepted: bool,
    before_mm: float,
) -> FoundPattern | None:
    """The last pattern of a hypothesis in numbers; None where no readings of one gauge differ.

    `base` is the fit of its listed causes; `before_mm` is left by the calibrated parameters alone.
    """
    pattern, white = hypothesis.patterns[-1], hypothesis.at.white
    how, plan = pattern.how, white.plan
    fits, before = fits_of(hypothesis, base), at_usual_size(base)
    for other in hypothesis.patterns[:-1]:
        before = extended(before, other)
    after = fits[0][1]
    rows = next(rows for where, rows in plan.wheres(white.raw) if where == pattern.where)
    gauges = list(_gauges(pattern, fits, rows))
    if not gauges:
        return None
    _, size, std, _ = max(gauges, key=lambda gauge: abs(gauge[1]))
    kelvin, unit = how == "temperature", "mm/K" if how == "temperature" else "mm"
    parameters = [
        Estimate(name=name, unit=unit, value=value / by, std=spread / abs(by))
        for name, value, spread, span in gauges
        for by in [span if kelvin else 1.0]
    ]
    where, start, between = dict(pattern.where), None, tuple[Where, ...]()
    heldout, late = None, None
    effect: list[tuple[float, ...]] = [(), ()]
    if how in _SHAPE_NAMES:
        moment, u = _mean_and_std(fits, [MINUTES * shape.parameter for shape in pattern.shapes])
        name = _SHAPE_NAMES[how]
        parameters.append(Estimate(name=name, unit="min", value=float(moment), std=float(u)))
        if how == "steps":
            start = float(moment)
        elif how == "settles":
            start = MINUTES * float(plan.hours[rows].min())
        # The last third of each set-up; the other readings stay.
        ordered, first = plan.sequence
        setup = np.cumsum(first) - 1
        rank = np.arange(len(ordered)) - np.flatnonzero(first)[setup]
        thirds = np.empty(len(ordered), np.intp)
        thirds[ordered] = np.where(3 * rank >= 2 * np.bincount(setup)[setup], 0, -1)
        late = _heldout(rows, before, after, thirds)
    if isinstance(measured, Readings):
        if "posture" in where:
            where["posture"] = measured.posture[int(np.argmax(rows))]
        if how == "steps":
            between = tuple(_between(measured, rows, float(moment), float(u)))
        heldout = _heldout(rows, before, after, measured.cycle)
        effect = [tuple(values.tolist()) for values in _effect(pattern, fits, rows)]
    # More noise takes nothing away.
    left = before if how == "scatters" else after
    return FoundPattern(
        how=how,
        where=where,
        from_minutes=start,
        between=between,
        size_mm=abs(size),
        expanded_mm=NORMAL_K * std,
        parameters=parameters,
        probability=probability,
        accepted=accepted,
        rms_before_mm=before_mm,
        rms_after_mm=white.rms(left.left) if left.white is white else None,
        heldout_before_mm=heldout and heldout[0],
        heldout_after_mm=heldout and heldout[1],
        heldout_ratio=heldout and heldout[1] / heldout[0],
        last_third_before_mm=late and late[0],
        last_third_after_mm=late and late[1],
        effect_mm=effect[0],
        effect_expanded_mm=effect[1],
    )


def _effect(pattern: Pattern, fits: _Fits, rows: Bools) -> tuple[Floats, Floats]:
    """What it adds to each reading, and U of that, both (n,) [mm]; more noise adds U alone."""
    columns = [shape.columns for shape in pattern.shapes]
    if pattern.how == "scatters":
        variances = np.outer([shape.size**2 for shape in pattern.shapes], rows)
        mean, std = _mean_and_std(fits, np.zeros_like(variances), variances)
    else:
        if pattern.how == "repeats":  # of a gauge the zero hides their mean
            columns = [without_zeros(pattern.at.white.plan, one.T).T for one in columns]
        mean, std = _sizes(fits, columns)
    return mean, NORMAL_K * std


def _sizes(fits: _Fits, columns: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Mean and standard deviation of what the columns (m, q) under each fit add up to, (m,)."""
    values, variances = [], []
    for one, (_, fit) in zip(columns, fits, strict=True):
        slot = slice(fit.first_uncertain - one.shape[1], fit.first_uncertain)
        values.append(one @ fit.moved[slot])
        variances.append(((one @ fit.covariance[slot, slot]) * one).sum(axis=1))
    return _mean_and_std(fits, values, np.array(variances))


def _mean_and_std(
    fits: _Fits, values: Sequence[Floats | float] | Floats, variances: Floats | float = 0.0
) -> tuple[Floats, Floats]:
    """Of values, and variances, under each fit, (f, ...), by their shares, which sum to 1."""
    shares, under = np.array([share for share, _ in fits]), np.array(values)
    mean = shares @ under
    return mean, np.sqrt(shares @ ((under - mean) ** 2 + variances))


def _between(measured: Readings, rows: Bools, minutes: float, std: float) -> Iterator[Where]:
    """The last of some readings before a moment, and the first after it, as far as it is known."""
    plan, reach = measured.plan, NORMAL_K * std
    ranks = np.flatnonzero(rows[plan.in_time])
    times = MINUTES * plan.hours[plan.in_time[ranks]] + 1e-6
    for rank in (*ranks[times < minutes - reach][-1:], *ranks[times >= minutes + reach][:1]):
        k = int(plan.in_time[rank])
        own = {**plan.entry(k), "posture": measured.posture[k], "cycle": measured.cycle[k]}
        names = ("leg", "direction", "posture", "cycle") if "leg" in own else ()
        yield {"order": str(rank + 1)} | {name: str(own[name]) for name in names}


def _gauges(
    pattern: Pattern, fits: _Fits, rows: Bools
) -> Iterator[tuple[str, float, float, float]]:
    """What it does to each gauge: name, peak to peak, its standard deviation [mm], and span [K].

    Positive where the later of the two readings is the larger. More noise is one for all.
    """
    shapes, plan = pattern.shapes, pattern.at.white.plan
    if pattern.how == "scatters":
        sizes = np.array([shape.size for shape in shapes])
        # Sizes between those that were tried are as likely.
        between = sizes * math.log(pattern.sizes[1] / pattern.sizes[0]) / math.sqrt(12.0)
        size, std = _mean_and_std(fits, sizes, between**2)
        yield "noise", float(size), float(std), 1.0
        return
    fit, columns = fits[0][1], shapes[0].columns
    effect = columns @ fit.moved[fit.first_uncertain - columns.shape[1] : fit.first_uncertain]
    by = 1.0 if pattern.parameters is None else float(pattern.parameters[0])
    for gauge in dict.fromkeys(plan.shared[rows].tolist()):
        own = np.flatnonzero(plan.shared == gauge)
        ends = own[effect[own].argmin()], own[effect[own].argmax()]
        first, last = sorted(ends, key=plan.order.__getitem__)
        apart = [(shape.columns[last] - shape.columns[first])[None] for shape in shapes]
        if np.any(apart[0]):
            mean, std = _sizes(fits, apart)
            entry = plan.entry(int(first))
            name = f"{entry['direction']}_{entry['leg']}" if "leg" in entry else "readings"
            yield name, float(mean[0]), float(std[0]), by * float(apart[0].sum())


def _heldout(rows: Bools, before: Fit, after: Fit, cells: Ints) -> tuple[float, float] | None:
    """Errors of predicting some readings, one of the cells (n,) left out at a time, r.m.s. [mm].

    Those of a cell below 0 stay. Without and with the pattern; None where no reading has another
    cell.
    """
    blocks = [block[cells[block[:, 0]] >= 0] for block in left_out(before.white, (), cells)]
    blocks = [block for block in blocks if len(block)]
    if len(np.unique(cells)) < 2 or not any(rows[block].any() for block in blocks):
        return None
    errors = []
    for fit in (before, after):
        which, error, _ = leave_out(fit, blocks)
        errors.append(rms((error / fit.white.plan.precision[which])[rows[which]]))
    return errors[0], errors[1]
