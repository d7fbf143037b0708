"""A pattern beyond the list in numbers: size, parameters, and what it gains in omitted cycles."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.inference.belief import Belief
from orthoglide_cal.inference.fit import Fit, leave_out, left_out
from orthoglide_cal.inference.hypothesis import Hypothesis, Pattern
from orthoglide_cal.inference.patterns import at_usual_size, extended, fits_of
from orthoglide_cal.inference.result import FoundPattern
from orthoglide_cal.model.cause import NORMAL_K, Estimate
from orthoglide_cal.model.measured import Measured, Readings
from orthoglide_cal.model.plan import Bools, Floats, Ints, Plan, Where, without_zeros

MINUTES = 60.0  # in an hour
# Pattern → name of the parameter of its shapes.
_SHAPE_NAMES = {"drifts": "period", "settles": "time_constant", "steps": "moment"}

_Fits = Sequence[tuple[float, Fit]]


def described(
    hypothesis: Hypothesis,
    belief: Belief,
    measured: Measured,
    probability: float,
    accepted: bool,
    before_mm: float,
) -> FoundPattern | None:
    """The last pattern of a hypothesis in numbers; None where no readings of one gauge differ.

    `before_mm` is left by the calibrated parameters alone, r.m.s.
    """
    base = belief.fit(hypothesis.ids)
    pattern, white = hypothesis.patterns[-1], hypothesis.at.white
    fits, before = fits_of(hypothesis, base), at_usual_size(base)
    for other in hypothesis.patterns[:-1]:
        before = extended(before, other)
    after = fits[0][1]
    wheres = white.plan.wheres(white.raw)
    rows = next(rows for where, rows in wheres if where == pattern.where)
    where = dict(pattern.where)
    if "posture" in where and isinstance(measured, Readings):
        where["posture"] = measured.posture[int(np.argmax(rows))]
    gauges = list(_gauges(pattern, fits, rows))
    if not gauges:
        return None
    _, size, std, _ = max(gauges, key=lambda one: abs(one[1]))
    kelvin, unit = pattern.how == "temperature", "mm/K" if pattern.how == "temperature" else "mm"
    parameters = [
        Estimate(name=name, unit=unit, value=value / by, std=spread / abs(by))
        for name, value, spread, span in gauges
        for by in [span if kelvin else 1.0]
    ]
    start, late = None, None
    between: tuple[Where, ...] = ()
    if pattern.how in _SHAPE_NAMES:
        shapes = np.array([shape.parameter for shape in pattern.shapes])
        known = _mean_and_std(np.array([share for share, _ in fits]), MINUTES * shapes)
        columns = {"name": _SHAPE_NAMES[pattern.how], "unit": "min"}
        parameters.append(Estimate(**columns, value=known[0], std=known[1]))
        late = _heldout(rows, before, after, _last_third(white.plan))
        start = {
            "steps": known[0],
            "settles": MINUTES * float(white.plan.hours[rows].min()),
        }.get(pattern.how)
        if pattern.how == "steps" and isinstance(measured, Readings):
            between = tuple(_between(measured, rows, *known))
    left = before if pattern.how == "scatters" else after
    heldout = None
    effect: list[tuple[float, ...]] = [(), ()]
    if isinstance(measured, Readings):
        effect = [tuple(values.tolist()) for values in _effect(pattern, fits, rows)]
        heldout = _heldout(rows, before, after, measured.cycle)
    return FoundPattern(
        how=pattern.how,
        where=where,
        from_minutes=start,
        between=between,
        size_mm=abs(size),
        expanded_mm=NORMAL_K * std,
        parameters=parameters,
        probability=probability,
        accepted=accepted,
        rms_before_mm=before_mm,
        # More noise takes nothing away.
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
    shares, values = np.array([share for share, _ in fits]), np.zeros((len(fits), len(rows)))
    if pattern.how == "scatters":
        variances = np.outer([shape.size**2 for shape in pattern.shapes], rows)
    else:
        plan, columns = pattern.at.white.plan, [shape.columns for shape in pattern.shapes]
        if pattern.how == "repeats":  # of a gauge the zero hides their mean
            columns = [without_zeros(plan, one.T).T for one in columns]
        known = _unknowns(pattern, fits)
        values = np.array([one @ mean for one, (mean, _) in zip(columns, known, strict=True)])
        spreads = ((one @ spread) * one for one, (_, spread) in zip(columns, known, strict=True))
        variances = np.array([spread.sum(axis=1) for spread in spreads])
    mean = shares @ values
    return mean, NORMAL_K * np.sqrt(shares @ ((values - mean) ** 2 + variances))


def _unknowns(pattern: Pattern, fits: _Fits) -> list[tuple[Floats, Floats]]:
    """What scales the columns of each shape: mean (q,) and covariance (q, q)."""
    known = []
    for shape, (_, fit) in zip(pattern.shapes, fits, strict=True):
        slot = slice(fit.first_uncertain - shape.columns.shape[1], fit.first_uncertain)
        known.append((fit.moved[slot], fit.covariance[slot, slot]))
    return known


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


def _last_third(plan: Plan) -> Ints:
    """0 for the readings in the last third of each set-up, −1 for the others, (n,)."""
    rows, first = plan.sequence
    setup = np.cumsum(first) - 1
    rank, count = np.arange(len(rows)) - np.flatnonzero(first)[setup], np.bincount(setup)[setup]
    cells = np.empty(len(rows), np.intp)
    cells[rows] = np.where(3 * rank >= 2 * count, 0, -1)
    return cells


def _gauges(
    pattern: Pattern, fits: _Fits, rows: Bools
) -> Iterator[tuple[str, float, float, float]]:
    """What it does to each gauge: name, peak to peak, its standard deviation [mm], and span [K].

    Positive where the later of the two readings is the larger. More noise is one for all.
    """
    shares = np.array([share for share, _ in fits])
    if pattern.how == "scatters":
        sizes = np.array([shape.size for shape in pattern.shapes])
        # Sizes between those that were tried are as likely.
        between = sizes * math.log(pattern.sizes[1] / pattern.sizes[0]) / math.sqrt(12.0)
        yield "noise", *_mean_and_std(shares, sizes, between**2), 1.0
        return
    plan, columns = pattern.at.white.plan, [shape.columns for shape in pattern.shapes]
    known = _unknowns(pattern, fits)
    effect = columns[0] @ known[0][0]
    for gauge in dict.fromkeys(plan.shared[rows].tolist()):
        own = np.flatnonzero(plan.shared == gauge)
        ends = own[effect[own].argmin()], own[effect[own].argmax()]
        first, last = sorted(ends, key=plan.order.__getitem__)
        apart = [shape[last] - shape[first] for shape in columns]
        values = np.array([one @ mean for one, (mean, _) in zip(apart, known, strict=True)])
        variances = [one @ spread @ one for one, (_, spread) in zip(apart, known, strict=True)]
        if not np.any(apart[0]):
            continue
        entry, span = plan.entry(int(first)), float(apart[0].sum())
        name = f"{entry['direction']}_{entry['leg']}" if "leg" in entry else "readings"
        by = 1.0 if pattern.parameters is None else float(pattern.parameters[0])
        yield name, *_mean_and_std(shares, values, np.array(variances)), by * span


def _mean_and_std(
    shares: Floats, values: Floats, variances: Floats | float = 0.0
) -> tuple[float, float]:
    """Of a mixture, shares (m,) that sum to 1."""
    mean = float(shares @ values)
    return mean, math.sqrt(float(shares @ ((values - mean) ** 2 + variances)))


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
        which, error, _ = leave_out(fit.white, fit, blocks)
        chosen = rows[which]
        errors.append(rms((error / fit.white.plan.precision[which])[chosen]))
    return errors[0], errors[1]
