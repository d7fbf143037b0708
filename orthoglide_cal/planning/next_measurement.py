"""The next measurement: what can be done, ranked by what it decides and determines for the time."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product
from operator import ne

import numpy as np
from scipy.special import ndtr

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation.budget import fixed_influences, influences
from orthoglide_cal.estimation.gaussian import Mixture, whiten
from orthoglide_cal.estimation.solution import without_zeros
from orthoglide_cal.inference.data import UNSEEN, Ids
from orthoglide_cal.inference.diagnose import Diagnosis
from orthoglide_cal.inference.fit import Fit
from orthoglide_cal.inference.prediction import Expected, expect
from orthoglide_cal.inference.result import NextMeasurement
from orthoglide_cal.losses import SITTING, STILL_OPEN
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import NORMAL_K, Model
from orthoglide_cal.model.orthoglide import (
    MINUTES_PER_POSTURE,
    MINUTES_PER_SETUP,
    double_posture,
    visiting,
)
from orthoglide_cal.model.plan import Bools, Floats, Plan, PlanT
from orthoglide_cal.model.readings import AXES, Contact, GaugePlan, other_axes
from orthoglide_cal.planning.plan import TRACE_SIGMA, estimator_for, lengths
from orthoglide_cal.planning.steps import (
    GuidedSession,
    MeasuringProtocol,
    Order,
    clock,
    steps_of,
    timed_plan,
)
from orthoglide_cal.schema import Reason

# Long enough for what creeps to show.
WAIT_MIN = 15.0
# A step that every gauge shows and that no revolution of a dial is taken for [mm].
STEP_MM = 0.3
HALF_WAY = 0.5  # along the leg
# A gauge place nearer to another than this share of the leg teaches nothing new.
ANOTHER_PLACE = 0.08
LEGS = (0, 1, 2)
MORE_CYCLES = (1, 5)  # of what is read in addition
ALONE_CYCLES = (1, 2, 3, 5)  # of a session of its own
# The likeliest explanations that a measurement is ranked by.
MOST_EXPLANATIONS = 8


def options(first: Plan | None, machine: Machine) -> Iterator[NextMeasurement]:
    """All that can be done next within the limits of a machine.

    The stands stay where they are, with all that is wrong with them; or they are set up again, and
    only what is wrong with the machine and its bars is met again. `first` was read with gauges that
    stand in space. None, where nothing can be solved with it: sessions as `measure` guides them, of
    the best design where plungers would leave the bar.
    """
    if first is not None:
        first = GaugePlan.require(first)
        yield from _going_on(first, machine)
        yield from _set_up_again(first, machine)
        return
    usual = double_posture(machine)
    protocol = MeasuringProtocol.BEST if machine.bar_warning(usual) else MeasuringProtocol.DOUBLE
    for cycles in ALONE_CYCLES:
        session = GuidedSession(protocol=protocol, cycles=cycles)
        plan, minutes = timed_plan(session.steps(machine), MINUTES_PER_SETUP)
        task = Reason.of("session_alone", protocol=protocol, cycles=cycles)
        yield NextMeasurement(what=task, plan=plan, minutes=minutes, session=session.options)


def _later(first: Plan, plan: PlanT) -> PlanT:
    """A plan as a part of its own behind all that was read."""
    return replace(
        plan,
        order=plan.order + int(first.order.max()) + 1,
        hours=plan.hours + float(first.hours.max()),
        part=plan.part + first.parts,
    )


def _walks(machine: Machine, gauge_at: float) -> tuple[tuple[Reason, tuple[float, ...]], ...]:
    """Ways as far as limits and plunger permit, with the displacements of a cycle [mm]."""
    low, high = machine.reach_mm(gauge_at)
    least, most = (machine.posture_at(at) or f"{at:+.4g} mm" for at in (low, high))
    ends = {"least": least, "most": most}
    half_way = Reason.of("walk_half_way", **ends, half_mm=(high / 2, low / 2))
    return (
        (Reason.of("walk_down", **ends), (0.0, high, low)),
        (Reason.of("walk_up", **ends), (0.0, low, high)),
        (half_way, (0.0, high / 2, high, high / 2, 0.0, low / 2, low, low / 2)),
    )


def _going_on(first: GaugePlan, machine: Machine) -> Iterator[NextMeasurement]:
    """Sessions on the leg that was read last, if the stands are still there, fixed in space."""
    standing = first.in_time[first.standing[first.in_time]]
    # Of each direction that is read there, its last reading.
    rows = [*dict(zip(first.direction[standing].tolist(), standing.tolist(), strict=True)).values()]
    if not rows:
        return
    leg = int(first.leg[standing[-1]])

    def option(
        task: Reason, stops: Sequence[float], wait_min: float = 0.0, short_mm: Floats | float = 0.0
    ) -> NextMeasurement:
        """Further postures, in the same set-ups, each carriage commanded short by `short_mm`."""
        index = np.array(rows * len(stops))
        plan = replace(
            first.subset(index),
            setup=first.setup[index],
            displacement=np.repeat(stops, len(rows)),
            order=int(first.order.max()) + 1 + np.arange(len(index)),
            entered=first.stood[index] + short_mm,
        )
        # A bar that was turned before is not turned again.
        as_it_lies = replace(plan, turned=np.zeros_like(plan.turned))
        *times, minutes = clock(steps_of(as_it_lies, machine, Order.PAPER, stands=2))
        start = float(first.hours.max()) + (MINUTES_PER_POSTURE + wait_min) / 60.0
        plan = replace(plan, hours=start + np.array(times) / 60.0)
        return NextMeasurement(what=task, plan=plan, minutes=minutes + wait_min, continues=True)

    last = float(first.displacement[first.in_time[-1]])
    again = {"leg": AXES[leg], "posture": machine.posture_at(last) or f"{last:g} mm"}
    there = replace(first.subset(np.array(rows)), displacement=np.full(len(rows), last))
    warning = machine.bar_warning(there)
    if warning is None or not warning.size:
        yield option(Reason.of("read_again", **again), [last])
        yield option(Reason.of("read_later", **again), [last], wait_min=WAIT_MIN)
    # Of two stands the one that is farther from half-way bounds the travel.
    farthest = max(first.gauge_at[rows].tolist(), key=lambda at: abs(at - HALF_WAY))
    walks = _walks(machine, farthest)
    for cycles, (walk, stops) in product(MORE_CYCLES, walks):
        task = Reason.of("read_on", leg=AXES[leg], cycles=cycles, walk=walk)
        yield option(task, (*stops * cycles, 0.0))
    walk, stops = walks[0]
    low, high = machine.limits_mm
    for axis in other_axes(leg):
        moved = machine.joints_at(leg, np.array(stops))[:, axis] - machine.home_mm
        for step in (STEP_MM, -STEP_MM):
            if low <= (moved - step).min() and (moved - step).max() <= high:
                by = {"carriage": AXES[axis], "short_mm": step}
                task = Reason.of("read_short", leg=AXES[leg], walk=walk, **by)
                yield option(task, (*stops, 0.0), short_mm=step * np.eye(3)[axis])
                break


def _set_up_again(first: GaugePlan, machine: Machine) -> Iterator[NextMeasurement]:
    """Sessions with the stands set up again, labels and + sides of the gauges checked."""

    def option(
        task: Reason,
        legs: Sequence[int],
        stops: tuple[float, ...],
        gauge_at: float = HALF_WAY,
        turned: bool = False,
    ) -> NextMeasurement:
        """One leg after the other, then back to iso, with new set-ups, as a part of its own."""
        read = visiting((*stops, 0.0), gauge_at, legs)
        read = replace(read, turned=np.full(len(read), turned))
        steps = steps_of(read, machine, Order.PAPER, stands=2)
        plan, minutes = timed_plan(steps, MINUTES_PER_SETUP)
        plan = replace(
            _later(first, plan),
            setup=plan.setup + first.setups,
            # What was commanded short was so for those readings alone.
            entered=plan.entered + first.stood[first.in_time[-1]],
        )
        return NextMeasurement(what=task, plan=plan, minutes=minutes)

    walks = _walks(machine, HALF_WAY)
    usual = walks[0][1]
    fixed = first.gauge_at[first.contact == Contact.FIXED]
    half_way = bool(np.any(np.not_equal(fixed, HALF_WAY)))
    for cycles, legs in product(MORE_CYCLES, ((0,), (1,), (2,), LEGS)):
        again, turn = ("stand_again", "turn_bar") if len(legs) == 1 else ("repeat", "turn_bars")
        how = {"leg": AXES[legs[0]], "cycles": cycles, "half_way": half_way}
        for walk, stops in walks:
            yield option(Reason.of(again, **how, walk=walk), legs, stops * cycles)
        yield option(Reason.of(turn, **how), legs, usual * cycles, turned=True)
    for cycles, at in product(MORE_CYCLES, machine.gauge_places):
        if np.all(np.abs(fixed - at) > ANOTHER_PLACE):
            task = Reason.of("repeat_at", cycles=cycles, gauge_mm=at * machine.leg_mm)
            yield option(task, LEGS, usual * cycles, gauge_at=at)
    yield option(Reason.of("repeat_reversed", half_way=half_way), LEGS[::-1], usual)


# `plan FILE` asks for all, and so does the calibration that it shows as well.
@lru_cache(maxsize=1)
def rank_measurements(diagnosis: Diagnosis) -> tuple[NextMeasurement, ...]:
    """All that can be done next, best first.

    By the expected loss after it. Where readings can decide nothing that is open, by the reduction
    of the parameters' U per minute.

    If explanation h is true, new readings y change its log odds over a rival r by

        ln p(y | h) − ln p(y | r),   y ~ N(m_h, S_h) predicted by h,  N(m_r, S_r) by r,

    from the posterior of each. Its mean is the Kullback–Leibler divergence of the two, its variance
    ½ tr (A − 1)² + |b|² with A = S_h^½ S_r⁻¹ S_h^½, b = S_h^½ S_r⁻¹ (m_h − m_r). The rival is
    dismissed where the odds then pass the diagnosis' own bound.

    Sessions that cannot be solved together with the first readings are judged alone: y is as the
    posterior of h has it, but p(y | r) and p(y | h) are N(μ, P), of causes of any plausible size.
    With D = P_r⁻¹ − P_h⁻¹ and b = P_r⁻¹ (m_h − μ_r) − P_h⁻¹ (m_h − μ_h) the variance is
    ½ tr (D S_h)² + bᵀ S_h b.
    """
    model, measured = diagnosis.model, diagnosis.measured
    plan = measured.plan if isinstance(measured, Readings) else None
    first, choice = plan, list[NextMeasurement]()
    if plan is not None:
        # What the kind of machine has to offer other than gauges on legs.
        for task, new, minutes in model.machine.further(plan):
            choice.append(NextMeasurement(what=task, plan=_later(plan, new), minutes=minutes))
    if not choice:
        first = plan if plan is not None and plan.fixed else None
        try:
            choice += options(first, model.machine)
        except UsageError:  # without postures
            return ()
    # With many readings a probability may be too small for a number: such a one decides nothing.
    possible = [(share, fit) for share, fit in diagnosis.by_place if share > 0.0]
    likeliest = sorted(possible, key=lambda pair: -pair[0])[:MOST_EXPLANATIONS]
    # Readings that cannot be solved together with the first ones are judged alone.
    alone = [] if first is not None else [(share, fit.unread) for share, fit in likeliest]
    predicted = predictions(model, first, choice, [*likeliest, *alone])
    true, judged = slice(len(likeliest)), slice(-len(likeliest), None)
    readings = slice(-len(model.machine.parameter_names))
    odds = [p.part(true, readings).log_odds(p.part(judged, readings)) for p in predicted]
    # Distances; of readings that are judged alone those that change the log odds by as much.
    apart = np.stack([
        np.sqrt(np.maximum(mean + mean.T, 0.0)) if alone else p.part(true, readings).distances
        for p, (mean, _) in zip(predicted, odds, strict=True)
    ])  # fmt: skip
    shares, fits = np.array([share for share, _ in likeliest]), [fit for _, fit in likeliest]
    # Another session meets what lasts. All patterns are one answer: that it is not listed.
    hypotheses = [fit.hypothesis for fit in fits]
    met = ([e.cause for e in fit.effects if e.cause.lasting or first is not None] for fit in fits)
    pairs = zip(hypotheses, met, strict=True)
    ids = [(one.label,) if one.patterns else tuple(c.id for c in causes) for one, causes in pairs]
    # Whether two explanations are different answers: other causes, another remedy, (f, f).
    remedies = ("" if one.patterns else one.remedy for one in hypotheses)
    answers = [*zip(map(frozenset, ids), remedies, strict=True)]
    differ = [[all(map(ne, one, other)) for other in answers] for one in answers]
    others = np.array(differ) & diagnosis.undecided
    # ln of how far below its bound a rival (second index) is against the true one; one that may be
    # at several places keeps at each its part of what its name may keep, and so do patterns.
    alike = [("",) if one.patterns else name for one, name in zip(hypotheses, ids, strict=True)]
    places, known = Counter(alike), np.ones_like(shares) if alone else shares
    bounds = np.array([[diagnosis.kept(h, best) for h in hypotheses] for best in hypotheses])
    bounds /= [places[name] for name in alike]
    spare, shares = np.log(known[:, None] / known * bounds), shares / shares.sum()
    # Chance that new readings dismiss all other answers than the true explanation.
    sure = [np.where(others, ndtr((spare + mean) / std), 1.0).min(axis=1) for mean, std in odds]
    chances = (np.stack(sure) @ shares * others.any()).tolist()
    # A session of its own; where it leaves several answers, somebody comes back for it.
    asked = zip(choice, chances, strict=True)
    losses = [SITTING + o.minutes + (1.0 - chance) * STILL_OPEN for o, chance in asked]
    open_pairs = others & (apart.max(axis=0) >= TRACE_SIGMA) & (min(losses) < STILL_OPEN)
    decides = bool(open_pairs.any())
    # U is that of a listed explanation.
    listed = np.where([one.patterns != () for one in hypotheses], 0.0, shares)
    within = sum(share * fit.offsets_covariance for share, fit in diagnosis.left_open)
    between = np.diag(diagnosis.covariance_mm2 - within)
    taken = 0.0 if first is None else _fixed(model, first, fits[0])
    now = NORMAL_K * np.sqrt((np.diag(diagnosis.covariance_mm2) + taken).max())
    ranking = []
    for number, option in enumerate(choice):
        chance = chances[number] if decides else 0.0
        then = predicted[number].part(judged, slice(None))
        split = np.split(np.arange(then.means.shape[1]), [readings.stop])
        spreads = then.given(then.means[0, readings], *split).covariance
        variance = listed @ np.diagonal(spreads, axis1=1, axis2=2) / listed.sum()
        variance += (1.0 - chance) * between
        whole = option.plan if first is None else Plan.joined(first, option.plan)
        variance = np.maximum(variance + _fixed(model, whole, fits[0]), 0.0)
        expanded = NORMAL_K * np.sqrt(variance)
        measurement = option.changed(
            expanded=expanded,
            expanded_mm=lengths(model, expanded.tolist()),
            chance=chance,
            **_separated(open_pairs, apart[number], ids),
        )
        gained = float(expanded.max() - now) / (SITTING + option.minutes)
        ranking.append((losses[number] if decides else 0.0, gained, measurement))
    # What is worth as much but for rounding stays in the order in which it is offered.
    ranking.sort(key=lambda row: (round(row[0], 9), round(row[1], 9)))
    return tuple(measurement for *_, measurement in ranking)


def best_next(diagnosis: Diagnosis) -> NextMeasurement | None:
    """The measurement, if any, that best distinguishes what is left open, or hidden but matters."""
    best = next(iter(rank_measurements(diagnosis)), None) if diagnosis.undecided else None
    return best if best is not None and best.separates else None


def _fixed(model: Model, plan: Plan, answer: Fit) -> Floats:
    """Variance that numbers taken as the controller has them add to each parameter, (p,)."""
    nominal = np.zeros(len(model.machine.parameter_names))
    taken = fixed_influences(model, nominal, plan)
    columns = [one.columns for one in taken if one.source not in answer.ids]
    if not columns:
        return nominal
    estimator = estimator_for(model, plan, influences(model, nominal, plan))
    return np.asarray(((estimator @ np.hstack(columns)) ** 2).sum(axis=1))


def _separated(open_pairs: Bools, sigma: Floats, ids: Sequence[Ids]) -> dict[str, object]:
    """The likeliest explanation with a rival that can be distinguished, and its likeliest such one.

    As fields of a measurement; none without such a pair. Explanations come in the order of their
    probability; those with patterns, then a rival that holds only some of the causes, come last.
    """
    pairs: list[tuple[int, int]] = [(a, b) for a, b in np.argwhere(np.triu(open_pairs, 1)).tolist()]
    if not pairs:
        return {}

    def last(pair: tuple[int, int]) -> tuple[bool, bool, bool]:
        one, other = (set(ids[k]) for k in pair)
        return bool(sigma[pair] < TRACE_SIGMA), not one | other <= CAUSES.keys(), other < one

    pair = min(pairs, key=last)
    one, other = (ids[k] for k in pair)
    lacking = [tuple(id for id in a if id not in b) for a, b in ((one, other), (other, one))]
    between = tuple(lacking) if all(lacking) else (one, other)
    # Of each the first cause that the other lacks, or has as well.
    separates = (min(x, key=y.__contains__, default="") for x, y in (between, between[::-1]))
    size = float(sigma[pair])
    return {"between": between, "separates": tuple(separates), "separation_sigma": size}


def predictions(
    model: Model,
    first: Plan | None,
    choice: Sequence[NextMeasurement],
    weighted: Sequence[tuple[float, Fit]],
) -> list[Mixture]:
    """Predictions of each option by explanations fitted to `first`, with their probabilities."""
    predicted: dict[int, Mixture] = {}
    for continues in {option.continues for option in choice}:
        plans = {k: o.plan for k, o in enumerate(choice) if o.continues is continues}
        plan, spans = _together(first, [*plans.values()])
        stay = first if continues else None
        explained = [(*pair, expect(pair[1], model, plan, first, continues)) for pair in weighted]
        for (k, new), span in zip(plans.items(), spans, strict=True):
            predicted[k] = _combined(explained, span, new, stay)
    return [predicted[k] for k in range(len(choice))]


def _combined(
    explained: Sequence[tuple[float, Fit, Expected]], new: slice, plan: Plan, stay: Plan | None
) -> Mixture:
    """Combinations of new readings, `plan`, and the parameters behind them.

    No new gauge zero enters them, and their noise is independent of that of the first readings: in
    a new set-up deviations from its mean, in one that goes on from the mean of what was read there.
    Only those count in which explanations can differ. Those of the plan are expected at `new`.
    """

    def free(values: Floats) -> Floats:
        """Values (n, c) in combinations without zeros, with unit noise, shape (m, c)."""
        if stay is None:
            set_ups = plan.subset(np.arange(len(plan)))  # numbered from 0
            return without_zeros(set_ups, values[new].T).T
        zeros = Plan.joined(stay, plan).zeros
        same = zeros[len(stay) :] @ zeros[: len(stay)].T
        mean = same / same.sum(axis=1, keepdims=True)
        noise = np.eye(len(mean)) + mean @ mean.T
        return whiten(noise, values[new] - mean @ values[: len(stay)])[0]

    shares, fits, expected = zip(*explained, strict=True)
    means = free(np.column_stack([mean for mean, _, _ in expected]))
    roots = [free(root) for _, _, root in expected]
    columns = np.hstack((means[:, 1:] - means[:, :1], *roots))
    columns = columns[:, columns.any(axis=0)]
    # An orthonormal basis of the directions that exceed the noise, shape (m, r).
    m, c = columns.shape
    size2, vectors = np.linalg.eigh(columns @ columns.T if m <= c else columns.T @ columns)
    kept = size2 > (UNSEEN * min(fit.sigma for fit in fits)) ** 2
    basis = vectors[:, kept] if m <= c else columns @ (vectors[:, kept] / np.sqrt(size2[kept]))
    noise = np.diag(np.repeat((1.0, 0.0), (basis.shape[1], fits[0].offsets.size)))
    covariances = []
    for spread, fit, (mean, _, root) in zip(roots, fits, expected, strict=True):
        both = np.vstack((basis.T @ spread, root[len(mean) :]))
        covariances.append(both @ both.T + fit.sigma**2 * noise)
    values = np.hstack(((basis.T @ means).T, [fit.offsets for fit in fits]))
    return Mixture(values[..., None], np.stack(covariances), np.log(shares)[:, None])


def _together(first: Plan | None, plans: Sequence[Plan]) -> tuple[Plan, list[slice]]:
    """One plan of the first readings and all new ones, and the rows of each of these in it.

    Every plan comes behind the first readings' last travel, as if there were no other.
    """
    parts = [] if first is None else [first]
    spans = []
    for plan in plans:
        if first is not None:
            parts.append(first.subset(first.last_travel))
        start = sum(map(len, parts))
        spans.append(slice(start, start + len(plan)))
        parts.append(plan)
    order = np.concatenate([part.in_time.argsort() for part in parts])
    order += np.repeat(np.cumsum([0, *map(len, parts[:-1])]), [len(part) for part in parts])
    return replace(Plan.joined(*parts), order=order), spans
