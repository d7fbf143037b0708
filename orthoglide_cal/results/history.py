"""Did the machine change? Sessions of one machine, compared by four explanations.

    y_i = θ + steps + rate·t_i + scatter_i + L_i w + e_i,   w ~ N(0, 1),   e_i ~ N(0, V_i)

y_i is what session i found of each parameter, active + found, and of the lasting causes that any
session shows. L_i w is what all sessions have in common (legs, gauge scale, the touched bed, the
effect of the temperature): it cancels between them. Steps, rates and scatter have priors of many
sizes and of subsets of parameters, so the evidence of each is a sum of Gaussian integrals.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from itertools import combinations, pairwise, zip_longest
from pathlib import PurePath
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.linalg import block_diag

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Verdict
from orthoglide_cal.diagnosis.assess import assess
from orthoglide_cal.diagnosis.candidates import Candidates, Ids
from orthoglide_cal.diagnosis.explanations import Linearised, Whitened
from orthoglide_cal.diagnosis.fit import Fitted, fit_explanations
from orthoglide_cal.diagnosis.result import CauseParameter as Known
from orthoglide_cal.diagnosis.scores import Score
from orthoglide_cal.errors import UnusableResultError, UsageError
from orthoglide_cal.estimation import solve
from orthoglide_cal.estimation.accuracy import chance_of_residual, half_width
from orthoglide_cal.estimation.budget import EXPANSION_PER_K, REFERENCE_C, fixed_influences
from orthoglide_cal.estimation.gaussian import log_mean, log_sum
from orthoglide_cal.files.input import Input
from orthoglide_cal.files.machine_file import machine_values
from orthoglide_cal.model.cause import Cause
from orthoglide_cal.model.linear_delta import LinearDelta, ProbePlan
from orthoglide_cal.model.machine import Origin
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.results.validity import STEP_K
from orthoglide_cal.schema import Schema
from orthoglide_cal.words import listed, signed

PLAIN = 0.2  # readings that noise leaves so often are not searched for causes
OPEN = 0.05  # of an explanation relative to the likeliest one: less is not looked at
RARE = math.log(0.03)  # log prior of a lasting cause
SIZES = 2.0 ** np.arange(-1.0, 10.0)  # prior ones, in units of what a session knows
FREE = 1e6  # prior size of what is reported
FURTHER, MOST_STEPS = math.log(0.5), 20  # log prior of one more step
STANDS = 0.2  # probability of "unchanged"; 400 such machines are all called so, at 0.5 two not
ESTABLISHED, LEFT_OPEN = 0.95, 0.03  # for a second trend; for another one
LASTS = 0.7  # share of the variance of a bed's local shape that lasts for weeks
U95, ONE_SIDED = half_width(math.inf), half_width(math.inf, 0.9)

Sizes = tuple[Known, ...]
_Common = dict[tuple[str, ...], Floats]
_Shape = tuple[Floats, Floats, LinearDelta]  # touched places (n, 2), what is left (n,), machine


class Trend(StrEnum):
    """What happened between the first session and the last; what matters most first."""

    CHANGED = "changed"
    DRIFTING = "drifting"
    SCATTERING = "scattering"
    UNCHANGED = "unchanged"


PRIOR = {Trend.CHANGED: 0.2, Trend.DRIFTING: 0.1, Trend.SCATTERING: 0.1}
COMBINATIONS = [tuple(chosen) for count in range(3) for chosen in combinations(PRIOR, count)]
AGAIN = "Measure once more: one further session decides between them."
HOMINGS = "Home three times and measure one cycle after each: that decides between them."
ADVICE = {
    Trend.CHANGED: "Look for a collision, a loose carriage or an exchanged part.",
    Trend.DRIFTING: "Look for wear or warming up; calibrate again before the drift matters.",
    Trend.SCATTERING: "Check home switches and couplings: no calibration is better than homing.",
    Trend.UNCHANGED: "Nothing to do: measure again at the next service, or after a collision.",
}


class DatedSession(Schema):
    """One session."""

    path: str
    started: str | None
    parameters: Sizes = Field(description="active + found, and of lasting causes")
    own_expanded: tuple[float, ...] = Field(description="U of what does not cancel between them")
    fitted: tuple[float, ...] = Field(description="by the explanation that is named")
    causes: Ids = Field((), description="lasting causes that it shows")
    temperature_c: float | None = None
    gauges: tuple[str, ...] = ()


class Change(Schema):
    """A step between two sessions, named by their files."""

    at: int = Field(exclude=True, description="number of the session before")
    before: str
    after: str
    parameters: Sizes


class Drift(Schema):
    """A rate; null where no dates are known."""

    name: str
    unit: str
    per_day: float | None = None
    std: float | None = None


class HomingScatter(Schema):
    """Standard deviation of a parameter from session to session."""

    name: str
    unit: str
    std: float


class Reached(Schema):
    """When a limit is reached, if the best values are entered now."""

    limit_mm: float
    scatter_exceeds: tuple[str, ...] = Field(description="parameters; 95 % of their scatter")
    parameter: str | None = Field(None, description="that drifts to it first")
    days: float | None = Field(None, description="after the last session; not before, 95 %")
    date: str | None = None


class History(Schema):
    """Sessions of one machine compared, as `history --json` prints it."""

    schema_version: Literal[1] = 1
    machine: str
    kind: str
    dated: bool = Field(description="false: the order given counts")
    sessions: tuple[DatedSession, ...]
    verdict: Trend
    probability: float
    ambiguous_with: tuple[Trend, ...] = ()
    changes: tuple[Change, ...] = ()
    drift: tuple[Drift, ...] = ()
    scatter: tuple[HomingScatter, ...] = ()
    pooled: Sizes = Field(description="best values now, from all sessions together")
    further: Mapping[int, tuple[float, ...]] = Field(description="sessions more → U of the same")
    prediction: Sizes = Field(description="what the next session will find")
    also: tuple[Trend, ...] = ()
    limit: Reached | None = None
    notes: tuple[str, ...] = ()
    next: str
    shapes: tuple[_Shape, ...] = Field((), exclude=True, repr=False)  # of a bed: first, last


class _Read:
    """One session, judged by the machine of the last one; a printer by what it has in each.

    Once settled it has parameters and causes of any date as it finds them: `values` (p,) in their
    units, `covariance` (p, p) of what is its own, and in `common` what one standard deviation of
    each other source adds, (p, q), by the source and by what makes it the same in other sessions.
    """

    def __init__(self, given: Input, last: Model) -> None:
        self.given = given
        self.last = last.machine
        self.white = white = Whitened.of(given.measured, last.judging(given.model))
        noise, dof = white.machine.instrument.noise_mm, len(white) - len(white.machine.active)
        (self.alone,) = _fits(white, ())
        explained = dof > 0 and chance_of_residual(self.alone.square, dof, noise) > PLAIN
        if not explained:
            solve(given.measured, white.problem.model)  # numbers out of all proportion are refused
        self.found = None if explained else assess(white)
        # Set of lasting causes → probabilities of the explanations with it; {} if none explains.
        self.listed: dict[Ids, dict[Ids, float]] = {}
        if self.found and self.found.judgement.verdict is not Verdict.UNEXPLAINED:
            for ids, probability in self.found.posterior.listed.items():
                lasting = tuple(id for id in ids if CAUSES[id].lasting)
                self.listed.setdefault(lasting, {})[ids] = probability

    def settle(self, standing: Ids, causes: tuple[Cause, ...]) -> None:
        """What it says, if the machine had the standing causes then; `causes` are of any date."""
        own = self.listed.get(standing, {})
        kept = {ids: p for ids, p in own.items() if p >= OPEN * max(own.values())}
        scores = [self.found.scores[ids] for ids in kept] if self.found else []
        fits = _fits(self.white, causes, scores) if scores or causes else [self.alone]
        weights = np.array([*kept.values()] or [1.0]) / (sum(kept.values()) or 1.0)
        values, spreads, common = zip(*(self._under(fit, causes) for fit in fits), strict=True)
        self.common = common[int(np.argmax(weights))]
        self.values = np.asarray(weights @ values)
        apart = np.array(values) - self.values
        self.covariance = np.tensordot(weights, spreads, axes=1) + (apart.T * weights) @ apart
        if self.found and not self.listed:
            width = len(self.alone.offsets)
            self.covariance[:width, :width] += self.found.offsets[1]

    def _under(self, fit: Fitted, causes: tuple[Cause, ...]) -> tuple[Floats, Floats, _Common]:
        """The same under one explanation, whose first effects are these causes."""
        white, active = self.white, self.given.model.machine.active
        conditions, width = self.given.conditions, len(active)
        # Takes the named parameters, in their units, from the unknowns.
        named = (np.eye(len(cause.names), cause.unknowns) / cause.scale for cause in causes)
        taken = block_diag(np.eye(width), *named)
        own = taken.shape[1]
        theta = (effect.theta for effect in fit.effects[: len(causes)])
        values = taken @ np.concatenate([fit.offsets + active, *theta])
        joint = taken @ fit.covariance[:own]
        covariance, estimator = joint[:, :own] @ taken.T, joint @ fit.columns.T / fit.sigma**2
        common: _Common = {}
        for each in (one for one in fit.uncertain if one.source != Origin.GAUGE_PLACEMENT):
            key = [str(each.source)]
            shared = estimator @ each.columns
            if each.source == Origin.GAUGE_SCALE:
                key += sorted(gauge.id for gauge in conditions.gauges)
            if each.local:
                # The symmetric root: nearly the same for nearly the same places.
                plan = ProbePlan.require(white.plan)
                grain = plan.texture[plan.touches]
                turned = (grain / (np.linalg.norm(grain, axis=0) + 1e-12)).T
                shared = fit.scale_factor * math.sqrt(LASTS) * shared @ turned
                key.append(f"{len(grain)} touches")
            common[tuple(key)] = shared
            covariance = covariance - shared @ shared.T
        for each in fixed_influences(white.problem.model, fit.offsets, white.plan):
            # The same unknowns, however plausible they were thought to be then.
            size = CAUSES[each.source].size(self.last) / (each.size or 1.0)
            common[each.source,] = estimator @ each.reduced(white.matrix).columns * size
        if conditions.mean_temperature_c is not None:
            # As `warmth`, but per kelvin the same in all sessions.
            kelvin = conditions.mean_temperature_c - REFERENCE_C
            grown = EXPANSION_PER_K * white.machine.expanding_mm * kelvin / math.sqrt(3.0)
            first = np.arange(len(values))[:, None] < width
            common[Origin.TEMPERATURE,] = np.where(first, grown, 0.0)
        shorter = self.last.nominal_rails.lengths - white.machine.nominal_rails.lengths
        if shorter.any() and ("leg_length",) in common:
            # What the same readings say with the legs that the controller has now.
            size = CAUSES["leg_length"].size(self.last) or 1.0
            values = values - common["leg_length",] @ shorter / size
        return values, covariance, common


def _fits(white: Whitened, causes: tuple[Cause, ...], scores: Sequence[Score] = ()) -> list[Fitted]:
    """Fits of these lasting causes, in place of those of the scores; without scores alone."""
    none = Candidates(causes, (), (), {(): 0.0})

    def with_causes(score: Score) -> Score:
        at = score.at
        base = (*causes, *(cause for cause in score.base if not cause.lasting))
        if lacking := tuple(cause for cause in causes if cause.id not in at.jacobians):
            # Its readings alone say nothing of these.
            broad = (*at.candidates.broad, *lacking)
            at = Linearised.of(at.white, replace(at.candidates, broad=broad))
        replanned = score.replanned and with_causes(score.replanned)
        return replace(score, at=at, base=base, replanned=replanned)

    scores = scores or [Score(Linearised.of(white, none), 0.0, (), 1.0)]
    return fit_explanations([with_causes(score) for score in scores])


def _standing(reads: Sequence[_Read]) -> list[Ids]:
    """Lasting causes at each date: of those of the likeliest set for all that show any."""
    each: list[dict[Ids, float]] = []
    for read in reads:
        prior = read.found.at.candidates.log_prior if read.found else {}
        weights: dict[Ids, float] = {}
        for ids, own in read.listed.items():
            before = sum(math.exp(prior[one]) for one in own)
            weights[ids] = math.log(sum(own.values(), 1e-300) / before) + RARE * len(ids)
        each.append(weights)
    shown = [own for own in each if max(own, key=own.__getitem__, default=())]
    total = {
        ids: sum(own.get(ids, min(own.values())) for own in shown) for own in shown for ids in own
    }
    best = {*max(sorted(total), key=total.__getitem__, default=())}
    return [max(filter(best.issuperset, own), key=own.__getitem__, default=()) for own in each]


class _Move(NamedTuple):
    """A step or a drift: of which parameters, of which prior size; a step with its place."""

    trend: Trend
    at: int
    subset: tuple[int, ...]
    size: float


class _Table:
    """What n sessions say of p parameters, in units of what a session knows."""

    def __init__(self, reads: Sequence[_Read], times: Floats, causes: Sequence[Cause]) -> None:
        machine = reads[-1].last
        self.names, self.units = [*machine.parameter_names], [*machine.parameter_units]
        groups = [range(3), range(len(self.names))]
        for cause in causes:
            groups.append(range(len(self.names), len(self.names) + len(cause.names)))
            self.names += [f"{cause.id} {name}" for name in machine.named(cause.names).values()]
            self.units += [cause.unit] * len(cause.names)
        own = np.array([read.covariance for read in reads])
        self.unit = np.sqrt(np.median(np.diagonal(own, axis1=1, axis2=2), axis=0))
        count, width = len(reads), len(self.unit)
        self.own = own / np.outer(self.unit, self.unit) + 1e-6 * np.eye(width)
        self.centre = np.median([read.values for read in reads], axis=0) / self.unit
        self.values = np.array([read.values for read in reads]) / self.unit - self.centre
        columns = [np.tile(np.eye(width), (count, 1, 1))]
        for key in dict.fromkeys(key for read in reads for key in read.common):
            like = next(read.common[key] for read in reads if key in read.common)
            every = [read.common.get(key, 0.0 * like) / self.unit[:, None] for read in reads]
            # Few directions hold what many unknowns do.
            size, turn = np.linalg.eigh(np.einsum("npq,npr->qr", every, every))
            columns.append(np.array(every) @ turn[:, size > 1e-8 * size.max()])
        self.base = np.concatenate(columns, axis=2)
        self.span = float(np.ptp(times)) or 1.0
        after = np.arange(count) > np.arange(count - 1)[:, None]
        line = (times - times.mean())[None] / self.span
        self.courses = {Trend.CHANGED: 1.0 * after, Trend.DRIFTING: line}
        one_or_two = (chosen for k in (1, 2) for chosen in combinations(range(width), k))
        self.subsets = list(dict.fromkeys(map(tuple, (*one_or_two, *groups, range(width)))))

    def known(self, values: Floats, covariance: Floats, chosen: Sequence[int]) -> Sizes:
        """These parameters in their units, from values (q,) and covariance (q, q)."""
        unit = self.unit[[*chosen]]
        std = (unit * np.sqrt(np.diagonal(covariance))).tolist()
        return tuple(
            Known(name=self.names[k], unit=self.units[k], value=value, std=u, expanded=U95 * u)
            for k, value, u in zip(chosen, (unit * values).tolist(), std, strict=True)
        )

    def fit(self, trends: Sequence[Trend]) -> "tuple[float, _FittedTrends]":
        """Best parts of trends, free in size, and the log evidence: over all that they may be."""
        every = np.eye(len(self.unit))
        scatter = 0.0 * self.unit
        rounds, sizes = (2, SIZES) if Trend.SCATTERING in trends else (1, np.zeros(1))
        tried = [size * own for own in (every.sum(axis=0), *every) for size in sizes]
        for _ in range(rounds):
            # Twice, because other parts fit with the likeliest scatter.
            parts = self._search(trends, scatter)
            fitted = [_FittedTrends(self, parts, each) for each in tried]
            whole = max(fitted, key=lambda each: each.log)
            scatter = whole.scatter
        log = log_mean(np.array([each.log for each in fitted]))
        for part in parts:
            # The chosen one stands for all that the other parts leave open.
            others = _FittedTrends(self, [each for each in parts if each is not part], scatter)
            log += others.one_more(part.trend)[0] + others.log - whole.log
        log += sum(math.log(p if trend in trends else 1.0 - p) for trend, p in PRIOR.items())
        steps = sum(part.trend is Trend.CHANGED for part in parts)
        free = [part._replace(size=FREE) for part in sorted(parts, key=lambda part: part.at)]
        return log + max(steps - 1, 0) * FURTHER, _FittedTrends(self, free, scatter)

    def _search(self, trends: Sequence[Trend], scatter: Floats) -> list[_Move]:
        """The best step and drift, and further steps as long as they are likelier than not."""
        parts: list[_Move] = []
        for trend in (trend for trend in trends if trend in self.courses):
            parts.append(_FittedTrends(self, parts, scatter).one_more(trend)[1])
        while parts and Trend.CHANGED in trends:
            for k, part in enumerate(parts):
                others = _FittedTrends(self, parts[:k] + parts[k + 1 :], scatter)
                parts[k] = others.one_more(part.trend)[1]
            log, more = _FittedTrends(self, parts, scatter).one_more(Trend.CHANGED)
            if log + FURTHER < 0.0 or len(parts) >= MOST_STEPS:
                break
            parts.append(more)
        return parts


class _FittedTrends:
    """These parts and a scatter (p,): unknowns `found` (m,), what is `left`, `log` evidence."""

    def __init__(self, table: _Table, parts: Sequence[_Move], scatter: Floats) -> None:
        self.table, self.parts, self.scatter = table, parts, scatter
        columns = self.columns()
        sizes = [np.full(len(part.subset), part.size**-2.0) for part in parts]
        prior = np.concatenate([np.arange(table.base.shape[2]) >= len(scatter), *sizes])
        self.inverse = np.asarray(np.linalg.inv(table.own + np.diag(scatter**2)), dtype=np.float64)
        self.weighted = self.inverse @ columns
        normal = np.einsum("npm,npk->mk", columns, self.weighted, optimize=True) + np.diag(prior)
        self.covariance = np.asarray(np.linalg.inv(normal))
        self.found = self.covariance @ np.einsum("npm,np->m", self.weighted, table.values)
        self.left = table.values - columns @ self.found
        log = -np.einsum("np,npq,nq->", self.left, self.inverse, table.values)
        log += np.linalg.slogdet(self.inverse)[1].sum() - np.linalg.slogdet(normal)[1]
        self.log = 0.5 * float(log + np.log(prior[prior > 0.0]).sum())

    def columns(self, later: float = 0.0) -> Floats:
        """Derivatives of what the sessions find, so much later, by the unknowns, (n, p, m)."""
        table = self.table
        found = [table.base]
        for part in self.parts:
            shift = later / table.span if part.trend is Trend.DRIFTING else 0.0
            course = table.courses[part.trend][part.at] + shift
            found.append(course[:, None, None] * np.eye(len(table.unit))[:, list(part.subset)])
        return np.concatenate(found, axis=2)

    def one_more(self, trend: Trend) -> tuple[float, _Move]:
        """Log evidence that one more part adds, over all that it may be, and the likeliest."""
        table, course = self.table, self.table.courses[trend]
        shared = np.einsum("gn,npm->gpm", course, self.weighted, optimize=True)
        own = np.einsum("gn,npq->gpq", course**2, self.inverse, optimize=True)
        known = own - shared @ self.covariance @ shared.swapaxes(1, 2)
        seen = course @ np.einsum("npq,nq->np", self.inverse, self.left)
        # By place, subset and size.
        logs = np.empty((len(course), len(table.subsets), len(SIZES)))
        for number, chosen in enumerate(map(list, table.subsets)):
            power, turn = np.linalg.eigh(known[:, chosen][:, :, chosen])
            apart2 = np.einsum("gij,gi->gj", turn, seen[:, chosen])[:, None] ** 2
            spread = SIZES[:, None] ** 2
            scale = 1.0 + spread * np.maximum(power, 0.0)[:, None]
            logs[:, number] = 0.5 * (apart2 * spread / scale - np.log(scale)).sum(axis=2)
        place, subset, size = np.unravel_index(int(logs.argmax()), logs.shape)
        return log_mean(logs), _Move(trend, int(place), table.subsets[subset], float(SIZES[size]))

    @property
    def trends(self) -> tuple[Trend, ...]:
        """What happened, what matters most first."""
        own = [part.trend for part in self.parts] + [Trend.SCATTERING] * bool(self.scatter.any())
        return tuple(each for each in Trend if each in own) or (Trend.UNCHANGED,)

    @property
    def homing(self) -> tuple[HomingScatter, ...]:
        """What is left from session to session beyond what each of them does not know."""
        table = self.table
        known = np.median(table.own, axis=0).diagonal()
        spread = (self.left**2).sum(axis=0) / max(len(self.left) - 1 - len(self.parts), 1)
        size = np.sqrt(np.maximum(spread - known, 0.0)) * table.unit
        return tuple(
            HomingScatter(name=table.names[k], unit=table.units[k], std=float(size[k]))
            for k in np.flatnonzero(self.scatter).tolist()
        )

    def sizes(self, trend: Trend) -> Iterator[tuple[int, Sizes]]:
        """Place and size of each step; rates per unit of time."""
        start = self.table.base.shape[2]
        time = self.table.span if trend is Trend.DRIFTING else 1.0
        for part in self.parts:
            slot = slice(start, start := start + len(part.subset))
            if part.trend is trend:
                values, spread = self.found[slot] / time, self.covariance[slot, slot] / time**2
                yield part.at, self.table.known(values, spread, part.subset)

    def state(self, at: int, later: float = 0.0, measured: bool = False, more: int = 0) -> Sizes:
        """The parameters at a session, or so much later, or as measured, or with so many more."""
        table, covariance, columns = self.table, self.covariance, self.columns(later)[at]
        own = np.median(table.own, axis=0) + np.diag(self.scatter**2)
        if more:
            gained = more * columns.T @ np.linalg.solve(own, columns)
            covariance = np.linalg.inv(np.linalg.inv(covariance) + gained)
        columns[:, len(own) : table.base.shape[2]] *= measured
        spread = columns @ covariance @ columns.T + own * measured
        return table.known(columns @ self.found + table.centre, spread, range(len(own)))

    def reached(self, limit_mm: float, last: datetime | None) -> Reached:
        """When the first length drifts to a limit: |r| t + z √(u² + t² u(r)²) = limit."""
        beyond = [s.name for s in self.homing if s.unit == "mm" and U95 * s.std > limit_mm]
        now = {each.name: each.std for each in self.state(-1)}
        found = Reached(limit_mm=limit_mm, scatter_exceeds=tuple(beyond))
        for rate in (rate for _, rates in self.sizes(Trend.DRIFTING) for rate in rates):
            times = np.linspace(0.0, limit_mm / max(abs(rate.value), 1e-12), 100_001)
            off = abs(rate.value) * times + ONE_SIDED * np.hypot(now[rate.name], rate.std * times)
            days = float(times[np.argmax(off >= limit_mm)])
            if rate.unit == "mm" and last and (found.days is None or days < found.days):
                day = (last + timedelta(days=min(days, 36500.0))).date().isoformat()
                found = found.changed(parameter=rate.name, days=days, date=day)
        return found


_IN_NAME = re.compile(r"(?<!\d)(20\d\d-?[01]\d-?[0-3]\d)(?:[ _T-](\d{4}(?:\d\d)?))?(?!\d)")


def moment_of(given: Input, stated: str | None = None) -> datetime | None:
    """When it was measured: as stated (else UsageError), as it says, or as its name says."""
    named = _IN_NAME.search(PurePath(given.measured.source.path).name)
    name = "T".join(filter(None, named.groups())).replace("-", "") if named else ""
    try:
        found = datetime.fromisoformat((stated or given.conditions.started or name).strip())
    except ValueError:
        if stated is None:
            return None
        raise UsageError(f"{stated!r} is no date.", "Write --dates 2026-03-02,2026-04-07") from None
    return found.replace(tzinfo=found.tzinfo or UTC)


def compare(
    inputs: Sequence[Input], dates: Sequence[str] = (), limit_mm: float | None = None
) -> History:
    """What happened to a machine from session to session.

    Args:
        inputs: two or more sessions of it.
        dates: of them, in the order given; () for what they say themselves.
        limit_mm: largest change that is allowed of a length; None for no limit.

    Raises:
        UsageError: not one machine, or dates that do not fit.
        UnusableResultError: a session does not determine the parameters.
    """
    if len(inputs) < 2:
        raise UsageError("A history needs two sessions or more.", "Name files, or their folder.")
    if len(dates) not in (0, len(inputs)):
        what = f"There are {len(dates)} dates for {len(inputs)} sessions."
        raise UsageError(what, "Give --dates one date for each, in the order of the files.")
    if limit_mm is not None and limit_mm <= 0.0:
        raise UsageError("The limit must be greater than zero.", "Give it in mm: --limit 0.05")
    moments = [at for given, day in zip_longest(inputs, dates) if (at := moment_of(given, day))]
    dated = len(moments) == len(inputs)
    times = np.arange(len(inputs), dtype=np.float64)
    if dated:
        order = sorted(range(len(inputs)), key=moments.__getitem__)
        inputs, moments = [inputs[k] for k in order], [moments[k] for k in order]
        times = np.array([(each - moments[0]) / timedelta(days=1) for each in moments])
    machine = inputs[-1].model.machine
    notes = [] if dated else ["Not every file has a date: the order given counts."]
    notes += _one_machine([given.model for given in inputs])
    reads = []
    for given in inputs:
        try:
            reads.append(_Read(given, inputs[-1].model))
        except UnusableResultError as error:
            what = f"{given.measured.source.path}: {error.what}"
            raise UnusableResultError(what, error.remedy) from error
    standing = _standing(reads)
    causes = tuple(cause for id, cause in CAUSES.items() if any(id in own for own in standing))
    for read, own in zip(reads, standing, strict=True):
        read.settle(own, causes)
    table = _Table(reads, times, causes)
    fitted = [table.fit(trends) for trends in COMBINATIONS if len(trends) < len(inputs)]
    total = log_sum(np.array([log for log, _ in fitted]))
    weighed = [(math.exp(log - total), each) for log, each in fitted]
    # Two sessions do not distinguish a step from a drift or scatter.
    _, best = weighed[1] if len(inputs) == 2 else max(weighed[1:], key=lambda pair: pair[0])
    best = weighed[0][1] if weighed[0][0] > STANDS else best
    share = {trend: sum(p for p, each in weighed if each.trends[0] is trend) for trend in Trend}
    verdict, *others = best.trends
    least = STANDS if verdict is Trend.UNCHANGED else LEFT_OPEN
    rivals = sorted((s for s in {*Trend} - {verdict} if share[s] > least), key=lambda s: -share[s])
    sessions = []
    unit, every = table.unit, range(len(table.unit))
    for k, read in enumerate(reads):
        conditions = read.given.conditions
        total = sum((shared @ shared.T for shared in read.common.values()), read.covariance)
        known = DatedSession(
            path=read.given.measured.source.path,
            started=moments[k].isoformat() if dated else conditions.started,
            parameters=table.known(read.values / unit, total / np.outer(unit, unit), every),
            own_expanded=tuple((U95 * np.sqrt(read.covariance.diagonal())).tolist()),
            fitted=tuple(one.value for one in best.state(k)),
            causes=standing[k],
            temperature_c=conditions.mean_temperature_c,
            gauges=tuple(gauge.id for gauge in conditions.gauges),
        )
        sessions.append(known)
    decides = HOMINGS if Trend.SCATTERING in (verdict, *rivals) else AGAIN
    return History(
        machine=machine.name,
        kind=machine.kind,
        dated=dated,
        sessions=tuple(sessions),
        verdict=verdict,
        probability=min(share[verdict], 1.0),
        ambiguous_with=tuple(rivals),
        changes=tuple(
            Change(at=at, before=sessions[at].path, after=sessions[at + 1].path, parameters=step)
            for at, step in best.sizes(Trend.CHANGED)
        ),
        drift=tuple(
            Drift(name=r.name, unit=r.unit, **({"per_day": r.value, "std": r.std} if dated else {}))
            for _, rates in best.sizes(Trend.DRIFTING)
            for r in rates
        ),
        scatter=best.homing,
        pooled=best.state(-1),
        further={n: tuple(u.expanded for u in best.state(-1, more=n)) for n in (1, 2, 5)},
        prediction=best.state(-1, float(np.median(np.diff(times))), measured=True),
        also=tuple(s for s in others if sum(p for p, t in weighed if s in t.trends) >= ESTABLISHED),
        limit=None if limit_mm is None else best.reached(limit_mm, moments[-1] if dated else None),
        notes=(*notes, *_circumstances(sessions, reads)),
        next=decides if rivals else ADVICE[verdict],
        shapes=tuple(_shape(reads[k]) for k in (0, -1) if reads[k].given.measured.of_bed),
    )


def _one_machine(models: Sequence[Model]) -> list[str]:
    """What differs between the machines of the sessions; raises UsageError if they are several."""
    last = models[-1]
    pairs = ((machine_values(each), machine_values(last.judging(each))) for each in models)
    other = {key for own, by in pairs for key in own if own[key] != by.get(key)}
    if other & {"kind", "name", "leg_length_mm", "joint_limits_mm"}:
        names = listed([*dict.fromkeys(model.machine.name for model in models)])
        raise UsageError(
            f"These are sessions of several machines ({names}): {', '.join(sorted(other))} differ.",
            "Name the files of one, or the machine that all are judged by: --machine FILE",
        )
    for model in models:
        model.machine.check_same(last.machine)
    other -= {"offsets_mm", "history", "gauges", "report"}
    judged = "All are judged by the machine of the last session; others differ in"
    return [f"{judged} {', '.join(sorted(other))}."] if other else []


def _circumstances(sessions: Sequence[DatedSession], reads: Sequence[_Read]) -> Iterator[str]:
    """What else differed between the sessions, and which causes they show."""
    warm = [each.temperature_c for each in sessions if each.temperature_c is not None]
    if warm and max(warm) - min(warm) > STEP_K:
        swing = f"{min(warm):.1f} to {max(warm):.1f} °C"
        yield f"The temperature differs ({swing}); what follows it is not a change of the machine."
    if len({each.gauges for each in sessions if each.gauges}) > 1:
        yield "The gauges differ; the scale error of each set is accounted for."
    if len({tuple(read.white.machine.nominal_rails.lengths) for read in reads}) > 1:
        yield "The arm lengths in the firmware differ: parameters are compared at the last ones."
    machines = [read.given.model.machine for read in reads]
    for (one, old), (two, new) in pairwise(zip(sessions, machines, strict=True)):
        moved = zip(new.parameter_names, np.subtract(new.active, old.active), strict=True)
        entered = ", ".join(f"{name} {signed(by, 3)}" for name, by in moved if abs(by) > 1e-9)
        if entered and not new.keeps_itself:
            yield f"Recorded adjustment between {one.path} and {two.path}: {entered} mm."
    for id in dict.fromkeys(id for each in sessions for id in each.causes):
        shown = [each.path for each in sessions if id in each.causes]
        where = "all sessions: it is pooled" if len(shown) == len(reads) else listed(shown)
        yield f"{id} shows in {where}."


def _shape(read: _Read) -> _Shape:
    plan, left = ProbePlan.require(read.white.plan), read.white.plain(read.alone.left)
    machine, touched = LinearDelta.require(read.white.machine), plan.touches
    return plan.place[touched, :2], left[touched], machine
