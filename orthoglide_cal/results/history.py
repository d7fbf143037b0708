"""Compare sessions of one machine: did it change?

Each session is diagnosed by itself; what it says of the parameters, active + found, and of the
lasting causes that any session shows is given to the hypotheses about several dates.
"""

import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from itertools import chain, compress, pairwise, zip_longest
from types import MappingProxyType
from typing import Literal

import numpy as np
from pydantic import Field, field_serializer
from scipy.linalg import block_diag

from orthoglide_cal.causes import CAUSES, HOME_SWITCH
from orthoglide_cal.errors import UnusableResultError, UsageError
from orthoglide_cal.estimation.budget import (
    EXPANSION_PER_K,
    REFERENCE_C,
    fixed_influences,
    half_width,
)
from orthoglide_cal.estimation.gaussian import mixture, root_of
from orthoglide_cal.estimation.solution import require_settings
from orthoglide_cal.files.input import Input, copies_in, in_order
from orthoglide_cal.files.machine_file import machine_values
from orthoglide_cal.inference.data import NOTHING, Ids, Linearised, Whitened
from orthoglide_cal.inference.diagnose import Diagnosis, decided
from orthoglide_cal.inference.fit import Fit, fit_hypothesis
from orthoglide_cal.inference.hypothesis import Hypothesis
from orthoglide_cal.inference.prediction import Later
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.inference.sessions import DatedValues, Trend, decide_trends
from orthoglide_cal.losses import DISMISSED
from orthoglide_cal.model.machine import Machine, Origin
from orthoglide_cal.model.model import CONFIDENCE, Cause, Estimate, Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.planning.adjustment import Removed
from orthoglide_cal.results.answer import STEP_K
from orthoglide_cal.schema import Reason, Schema, Sentence
from orthoglide_cal.words import listed

# Limit of effort: where noise leaves as much so often, no cause is sought; a search would name
# one in a hundred of those that are there.
PLAIN = 0.2
LOG_LASTING = math.log(0.03)  # log prior of a lasting cause
LASTS = 0.7  # share of the variance of a bed's local shape that lasts for weeks
ONE_SIDED = half_width(math.inf, 2.0 * CONFIDENCE - 1.0)

Sizes = tuple[Estimate, ...]


class DatedSession(Schema):
    """One session."""

    path: str
    started: str | None
    parameters: Sizes  # active + found, and of lasting causes, less what was adjusted since then
    own_expanded: tuple[float, ...]  # U of what does not cancel between them
    fitted: tuple[float, ...]  # by the explanation that is named
    causes: Ids = ()  # lasting causes that it shows
    refuted: Sentence | None = None  # how causes that it named were refuted
    temperature_c: float | None = None
    gauges: tuple[str, ...] = ()


class Change(Schema):
    """A step between two sessions, named by their files."""

    at: int = Field(exclude=True)  # number of the session before
    before: str
    after: str
    parameters: Sizes


class Reached(Schema):
    """Time when a limit is reached, if the best values are entered now."""

    limit_mm: float
    scatter_exceeds: tuple[str, ...]  # parameters; 95 % of their scatter
    parameter: str | None = None  # that drifts to it first
    days: float | None = None  # after the last session; not before, 95 %
    date: str | None = None


class History(Schema):
    """Sessions of one machine compared, as `history --json` prints it."""

    schema_version: Literal[1] = 1
    machine: str
    kind: str
    simulated: bool  # all sessions are; otherwise those that are were left out
    dated: bool  # false: the order given counts
    sessions: tuple[DatedSession, ...]
    verdict: Trend
    probability: float
    ambiguous_with: tuple[Trend, ...] = ()
    changes: tuple[Change, ...] = ()
    drift: Sizes = ()  # rates, per day if `dated`
    scatter: Sizes = ()  # of homing: std from session to session
    pooled: Sizes  # best values now, from all sessions together
    further: Mapping[int, tuple[float, ...]]  # sessions more → U of the same
    prediction: Sizes  # what the next session will find
    also: tuple[Trend, ...] = ()
    limit: Reached | None = None
    notes: tuple[Sentence, ...] = ()
    next: Sentence
    newest: Machine = Field(exclude=True, repr=False)  # machine of the last session
    # Of a bed, first and last: touched places (n, 2), and what is left of them (n,) [mm].
    shapes: tuple[tuple[Floats, Floats], ...] = Field((), exclude=True, repr=False)

    @field_serializer("drift")
    def _rates(self, drift: Sizes) -> list[dict[str, str | float | None]]:
        known = [(r.value, r.std) if self.dated else (None, None) for r in drift]
        rows = zip(drift, known, strict=True)
        return [{"name": r.name, "unit": r.unit, "per_day": v, "std": u} for r, (v, u) in rows]

    @field_serializer("scatter")
    def _stds(self, scatter: Sizes) -> list[dict[str, object]]:
        return [size.model_dump(include={"name", "unit", "std"}) for size in scatter]


class _Session:
    """One session, diagnosed with the machine of the last one; a printer with what it has in each.

    Settled: `values` (p,) of parameters and of causes of any date, `covariance` (p, p) of what is
    its own, and in `common` what one standard deviation of each other source adds, (p, q).
    """

    def __init__(self, given: Input, last: Model) -> None:
        require_settings(given.measured)
        self.given, self.last, self.path = given, last.machine, given.measured.source.path
        model = last.judging(given.model)
        self.white = white = Whitened.of(given.measured, model)
        at = Linearised.of(white, NOTHING)
        nothing: dict[Ids, Hypothesis] = {(): Hypothesis(at, 0.0)}  # the parameters alone
        self.belief = self.decision = Diagnosis(given.measured, model, at, nothing)
        self.alone = self.belief.fit_of(())
        self.width = self.alone.offsets.size  # parameters of the machine
        # By what is unexplained the offsets are others, and less sure: (p,) and (p, p).
        self.moved, self.unexplained = np.zeros(self.width), np.zeros((self.width, self.width))
        self.refuted: Reason | None = None  # how what would be named here was refuted
        if len(white) <= self.width or self.belief.chance(self.alone) <= PLAIN:
            self.decision = decided(given.measured, model)

    def conclude(self, later: "_Session | None") -> None:
        """Take over what was decided; a name only if a later session without others agrees."""
        decision = self.decision
        if later and decision.verdict is Verdict.NAMED:
            other = later.decision
            wrong = {*other.accepted, *other.ambiguous_with}
            if other.verdict is not Verdict.UNEXPLAINED and wrong <= {*decision.accepted}:
                unseen = Later(later.white, self.white.machine, np.zeros(self.width), self.width)
                decision = replace(decision, refuted=decision.refutation(unseen))
        if decision.refuted:
            data = {**decision.refuted.data, "of_file": self.given.name}
            self.refuted = decision.refuted.changed(data=data)
        if decision.verdict is Verdict.UNEXPLAINED:
            values, spread = decision.offsets
            self.moved = values - self.alone.offsets
            root = root_of(spread - self.alone.offsets_covariance)
            self.unexplained = root @ root.T
        else:
            self.belief = decision
        # Set of lasting causes → probabilities of the explanations with it.
        self.by_lasting: dict[Ids, dict[Ids, float]] = {}
        for ids, probability in self.belief.listed.items():
            lasting = tuple(id for id in ids if CAUSES[id].lasting)
            self.by_lasting.setdefault(lasting, {})[ids] = probability
        prior = self.belief.at.candidates.log_prior
        # ln of prior times evidence of each set of lasting causes, whatever else was wrong.
        self.log_weight = {
            lasting: math.log(sum(shares.values(), 1e-300))
            - math.log(sum(math.exp(prior[ids]) for ids in shares))
            + LOG_LASTING * len(lasting)
            for lasting, shares in self.by_lasting.items()
        }

    def settle(self, standing: Ids, causes: tuple[Cause, ...], scale: float) -> None:
        """Find the values, if the machine had the standing causes then; `causes` of any date.

        They have the same size at each: `scale` times their usual one.
        """
        shares = self.by_lasting[standing]
        kept = {ids: p for ids, p in shares.items() if p >= DISMISSED * max(shares.values())}
        fits = [*map(self.belief.fit_of, kept)]
        if causes:
            fits = [_fit_with(causes, self.belief.hypotheses[ids], scale) for ids in kept]
        weights = np.array([*kept.values()]) / sum(kept.values())
        values, spreads, common = zip(*(self._under(fit, causes) for fit in fits), strict=True)
        self.common = common[int(np.argmax(weights))]
        self.values, self.covariance = mixture(weights.tolist(), values, spreads)
        self.values[: self.width] += self.moved
        self.covariance[: self.width, : self.width] += self.unexplained

    def _under(
        self, fit: Fit, causes: tuple[Cause, ...]
    ) -> tuple[Floats, Floats, dict[Hashable, Floats]]:
        """The same under one explanation, whose first effects are these causes."""
        white, model, conditions = self.white, self.given.model, self.given.conditions
        # Takes the named parameters, in their units, from the unknowns.
        named = (np.eye(len(cause.names), cause.unknowns) / cause.scale for cause in causes)
        taken = block_diag(np.eye(self.width), *named)
        count = taken.shape[1]
        theta = (model.total(effect) for effect in fit.effects[: len(causes)])
        values = taken @ np.concatenate([fit.offsets + model.machine.active, *theta])
        joint = taken @ fit.covariance[:count]
        covariance, estimator = joint[:, :count] @ taken.T, joint @ fit.columns.T / fit.sigma**2
        common: dict[Hashable, Floats] = {}
        for source in fit.uncertain:
            if source.source == Origin.GAUGE_PLACEMENT:
                continue
            key, shared = [str(source.source)], estimator @ source.columns
            if source.source == Origin.GAUGE_SCALE:
                key += sorted(gauge.id for gauge in conditions.gauges)
            if source.local and (shape := white.machine.local_shape(white.plan)):
                # The symmetric root: nearly the same for nearly the same places.
                grain = shape.columns[white.plan.touches]
                turned = (grain / (np.linalg.norm(grain, axis=0) + 1e-12)).T
                shared = fit.scale_factor * math.sqrt(LASTS) * shared @ turned
                key.append(f"{len(grain)} touches")
            common[tuple(key)] = shared
            covariance = covariance - shared @ shared.T
        for influence in fixed_influences(white.problem.model, fit.offsets, white.plan):
            # The same unknowns, however plausible they were thought to be then.
            cause = CAUSES[influence.source]
            size = cause.size(self.last)
            columns = white.matrix @ influence.columns
            common[cause.id,] = estimator @ columns * (size / (influence.size or 1.0))
            # What the same readings say with the values that the controller has now.
            now = cause.transferred(np.zeros(cause.unknowns), self.last, white.machine)
            values = values - common[cause.id,] @ now / (size or 1.0)
        if conditions.mean_temperature_c is not None:
            # As `warmth`, but per kelvin the same in all sessions.
            kelvin = conditions.mean_temperature_c - REFERENCE_C
            grown = EXPANSION_PER_K * white.machine.leg_mm * kelvin / math.sqrt(3.0)
            first = np.arange(len(values))[:, None] < self.width
            common[Origin.TEMPERATURE,] = np.where(first, grown, 0.0)
        return values, covariance, common


def _fit_with(causes: tuple[Cause, ...], hypothesis: Hypothesis, scale: float) -> Fit:
    """The fit of a hypothesis with these lasting causes in place of its own, of sizes so scaled."""

    def listing(at: Linearised) -> Linearised:
        lacking = tuple(cause for cause in causes if cause.id not in at.jacobians)
        broad = (*at.candidates.broad, *lacking)
        return Linearised.of(at.white, replace(at.candidates, broad=broad)) if lacking else at

    base = (*causes, *(cause for cause in hypothesis.base if not cause.lasting))
    replanned = hypothesis.replanned and listing(hypothesis.replanned)
    at = listing(hypothesis.at)
    return fit_hypothesis(replace(hypothesis, at=at, base=base, scale=scale, replanned=replanned))


def _standing(sessions: Sequence[_Session]) -> list[Ids]:
    """Lasting causes at each date: of those of the likeliest set for all that show any."""
    weights = [session.log_weight for session in sessions]
    shown = [weight for weight in weights if max(weight, key=weight.__getitem__, default=())]
    sets = dict.fromkeys(ids for weight in shown for ids in weight)
    total = {ids: sum(w.get(ids, min(w.values())) for w in shown) for ids in sets}
    best = {*max(sorted(total), key=total.__getitem__, default=())}
    return [max(filter(best.issuperset, w), key=w.__getitem__, default=()) for w in weights]


def _reached(
    limit_mm: float, now: Sizes, rates: Sizes, scatter: Sizes, last: datetime | None
) -> Reached:
    """Time when the first length drifts to a limit: |r| t + z √(u² + t² u(r)²) = limit."""
    beyond = tuple(s.name for s in scatter if s.unit == "mm" and s.expanded > limit_mm)
    std, days = {size.name: size.std for size in now}, dict[str, float]()
    for rate in (rate for rate in rates if rate.unit == "mm"):
        times = np.linspace(0.0, limit_mm / max(abs(rate.value), 1e-12), 100_001)
        off = abs(rate.value) * times + ONE_SIDED * np.hypot(std[rate.name], rate.std * times)
        days[rate.name] = float(times[np.argmax(off >= limit_mm)])
    reached = Reached(limit_mm=limit_mm, scatter_exceeds=beyond)
    if not (days and last):
        return reached
    soonest, first = min((time, name) for name, time in days.items())
    date = (last + timedelta(days=min(soonest, 36500.0))).date().isoformat()
    return reached.changed(parameter=first, days=soonest, date=date)


def compare(
    inputs: Sequence[Input],
    dates: Sequence[str] = (),
    limit_mm: float | None = None,
    adjusted: Mapping[str, Removed] = MappingProxyType({}),
) -> History:
    """Compare two or more sessions of a machine; simulated ones count only where no other is there.

    Args:
        dates: of them, in the order given; () for what they say themselves.
        limit_mm: largest change that is allowed of a length; None for no limit.
        adjusted: digest of a session → what was adjusted after it.

    Raises UsageError: not one machine, or dates that do not fit; UnusableResultError: a session
    does not determine the parameters.
    """
    if len(dates) not in (0, len(inputs)):
        fault = f"{len(inputs)} sessions need as many dates, not {len(dates)}."
        raise UsageError(fault, "Give --dates one date for each, in the order of the files.")
    inputs, notes = [*inputs], list[Reason]()
    for k, date in enumerate(dates):
        inputs[k] = replace(inputs[k], conditions=inputs[k].conditions.changed(started=date))
        if inputs[k].moment is None:
            raise UsageError(f"{date!r} is no date.", "Write --dates 2026-03-02,2026-04-07")
    measured = [one for one in inputs if not one.measured.source.simulated]
    if measured and len(measured) < len(inputs):
        notes.append(Reason.of("left_out", count=len(inputs) - len(measured)))
    inputs = measured or inputs
    if copies := copies_in(inputs):
        notes.append(Reason.of("stored_again", names=[inputs[k].name for k in copies]))
        inputs = [given for k, given in enumerate(inputs) if k not in copies]
    if len(inputs) < 2:
        without = ": simulated and copied ones do not count" * bool(notes)
        remedy = "Name the files. In a folder only sessions count, no tables (CSV): name those."
        raise UsageError(f"A history needs two sessions or more{without}.", remedy)
    inputs, moments = in_order(inputs)
    times = np.arange(len(inputs), dtype=np.float64)
    if dated := bool(moments):
        times = np.array([(moment - moments[0]) / timedelta(days=1) for moment in moments])
    else:
        notes.append(Reason.of("undated"))
    notes += _one_machine([given.model for given in inputs])
    sessions = []
    for given in inputs:
        try:
            sessions.append(_Session(given, inputs[-1].model))
        except UnusableResultError as error:
            path = given.measured.source.path
            raise UnusableResultError(f"{path}: {error.what}", error.remedy) from error
    notes += (entered := [*_entered(inputs)])
    recorded = {note.data["before"] for note in entered}
    for session, later in zip_longest(sessions, sessions[1:]):
        known = session.path in recorded or adjusted.get(session.given.measured.source.sha256)
        session.conclude(None if known else later)
    pairs = [*zip(sessions, standing := _standing(sessions), strict=True)]
    causes = tuple(cause for id, cause in CAUSES.items() if any(id in ids for ids in standing))
    # In usual sizes of the causes, by the likeliest explanation of each session.
    shares = ((session, session.by_lasting[ids]) for session, ids in pairs if ids)
    likeliest = (s.belief.hypotheses[max(p, key=p.__getitem__)] for s, p in shares)
    scale = max((one.scale for one in likeliest), default=1.0)
    for session, ids in pairs:
        session.settle(ids, causes, scale)
    machine = inputs[-1].model.machine
    named = [*zip(machine.parameter_names, machine.parameter_units, strict=True)]
    groups = [range(3), range(len(named))]
    for cause in causes:
        groups.append(range(len(named), len(named) + len(cause.names)))
        names = machine.named(cause.names).values()
        named += [(f"{cause.id} {name}", cause.unit) for name in names]
    notes += _put_right(sessions, adjusted, [name for name, _ in named])

    def sized(values: Floats, covariance: Floats, chosen: Sequence[int] = ()) -> Sizes:
        """Return some of the parameters, or all: values (q,), covariance (q, q)."""
        names = [named[k] for k in chosen] or named
        rows = zip(names, values.tolist(), np.sqrt(np.diagonal(covariance)).tolist(), strict=True)
        return tuple(Estimate(name=id, unit=unit, value=v, std=u) for (id, unit), v, u in rows)

    data = DatedValues(
        np.array([session.values for session in sessions]),
        np.array([session.covariance for session in sessions]),
        [session.common for session in sessions],
        times,
        groups,
    )
    verdict, probability, rivals, also, fit = decide_trends(data)
    rows = []
    for k, (session, ids) in enumerate(pairs):
        conditions = session.given.conditions
        total = sum((shared @ shared.T for shared in session.common.values()), session.covariance)
        row = DatedSession(
            path=session.path,
            started=moments[k].isoformat() if dated else conditions.started,
            parameters=sized(session.values, total),
            own_expanded=tuple(u.expanded for u in sized(session.values, session.covariance)),
            fitted=tuple(fit.state(k)[0].tolist()),
            causes=ids,
            refuted=session.refuted,
            temperature_c=conditions.mean_temperature_c,
            gauges=tuple(gauge.id for gauge in conditions.gauges),
        )
        rows.append(row)
    drifts = (sized(rate, spread, p.subset) for p, rate, spread in fit.sizes(Trend.DRIFTING))
    drift = tuple(chain(*drifts))
    scatter = tuple(compress(sized(0.0 * fit.homing, np.diag(fit.homing**2)), fit.scatter))
    now, last = sized(*fit.state(-1)), moments[-1] if dated else None
    advice: str = verdict
    if rivals:
        advice = "home_repeatedly" if Trend.SCATTERING in (verdict, *rivals) else "one_more_session"
    elif any(session.refuted for session in sessions):
        advice = "refuted"
    shapes = []
    for session in (sessions[0], sessions[-1]):
        plan, left = session.white.plan, session.white.plain(session.alone.left)
        if plan.touches.any():
            shapes.append((plan.spots[plan.touches, :2], left[plan.touches]))
    return History(
        machine=machine.name,
        kind=machine.kind,
        simulated=not measured,
        dated=dated,
        sessions=tuple(rows),
        verdict=verdict,
        probability=probability,
        ambiguous_with=rivals,
        changes=tuple(
            Change(
                at=step.at,
                before=sessions[step.at].path,
                after=sessions[step.at + 1].path,
                parameters=sized(size, spread, step.subset),
            )
            for step, size, spread in fit.sizes(Trend.CHANGED)
        ),
        drift=drift,
        scatter=scatter,
        pooled=now,
        further={n: tuple(u.expanded for u in sized(*fit.state(-1, more=n))) for n in (1, 2, 5)},
        prediction=sized(*fit.state(-1, float(np.median(np.diff(times))), measured=True)),
        also=also,
        limit=None if limit_mm is None else _reached(limit_mm, now, drift, scatter, last),
        notes=(*notes, *_circumstances(inputs, rows)),
        next=Reason.of(advice),
        newest=machine,
        shapes=tuple(shapes),
    )


def _one_machine(models: Sequence[Model]) -> list[Reason]:
    """Differences between the machines of sessions; raises UsageError for several machines."""
    last = models[-1]
    pairs = ((machine_values(model), machine_values(last.judging(model))) for model in models)
    other = {key for then, by in pairs for key in then if then[key] != by.get(key)}
    if other & {"kind", "name", "leg_length_mm", "joint_limits_mm"}:
        names = listed([*dict.fromkeys(model.machine.name for model in models)])
        fault = f"These are sessions of several machines ({names}):"
        remedy = "Name the files of one, or the machine that all are judged by: --machine FILE"
        raise UsageError(f"{fault} {', '.join(sorted(other))} differ.", remedy)
    for model in models:
        model.machine.check_same(last.machine)
    other -= {"offsets_mm", "history", "gauges", "report"}
    return [Reason.of("judged_by_last", names=sorted(other))] if other else []


def _entered(inputs: Sequence[Input]) -> Iterator[Reason]:
    """Values entered, or corrected otherwise, from one session to the next."""
    for before, after in pairwise(inputs):
        old, new = before.model.machine, after.model.machine
        paths = {"before": before.measured.source.path, "after": after.measured.source.path}
        # What a machine that is homed anew has otherwise is no adjustment of it.
        changes = zip(new.parameter_names, np.subtract(new.active, old.active), strict=True)
        sizes = [(name, float(by), "mm") for name, by in changes if abs(by) > 1e-9]
        if sizes and not old.differing(new):
            yield Reason.of("adjusted", **paths, sizes=sizes)
        then, now = old.corrected, new.corrected
        if ids := [id for id in {**then, **now} if then.get(id) != now.get(id)]:
            yield Reason.of("corrected_otherwise", **paths, ids=ids)


def _put_right(
    sessions: Sequence[_Session], adjusted: Mapping[str, Removed], names: Sequence[str]
) -> Iterator[Reason]:
    """Take what was adjusted off the sessions before it: they then tell of the machine as it is."""
    for count, (before, after) in enumerate(pairwise(sessions), start=1):
        old, new = (session.given.measured.source for session in (before, after))
        sizes = []
        for id, size in adjusted.get(old.sha256, ()):
            name = size.name if id == HOME_SWITCH.id else f"{id} {size.name}"
            sizes.append((name, size.value, size.unit))
            here = np.array([other == name for other in names], dtype=float)
            for earlier in sessions[:count]:
                earlier.values = earlier.values - size.value * here
                earlier.common[old.sha256, id, name] = size.std * here[:, None]
        if sizes:
            yield Reason.of("adjusted", before=old.path, after=new.path, sizes=sizes)


def _circumstances(inputs: Sequence[Input], sessions: Sequence[DatedSession]) -> Iterator[Reason]:
    """Other differences between the sessions, and the causes that they show."""
    warm = [s.temperature_c for s in sessions if s.temperature_c is not None]
    if warm and max(warm) - min(warm) > STEP_K:
        yield Reason.of("temperatures_vary", low_c=min(warm), high_c=max(warm))
    if len({s.gauges for s in sessions if s.gauges}) > 1:
        yield Reason.of("gauges_vary")
    if len({tuple(given.model.machine.nominal_rails.lengths) for given in inputs}) > 1:
        yield Reason.of("arms_vary")
    for id in dict.fromkeys(id for session in sessions for id in session.causes):
        shown = [session.path for session in sessions if id in session.causes]
        code = "shown_in_all" if len(shown) == len(sessions) else "shown_in"
        yield Reason.of(code, id=id, paths=shown)
