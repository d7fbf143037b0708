"""How likely the readings of a session are under an explanation, from this folder's forward model.

Linear in all unknowns about the hidden truth; gauge zeros are free. Everything else is drawn: what
acts, at which place and at which scale of its size, and how much one reading scatters.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import dynesty
import numpy as np
from scipy.linalg import null_space
from scipy.special import logsumexp, ndtri, roots_hermitenorm
from scipy.stats import multivariate_normal

from .effects import state_with, swapped_rows
from .forward import PARTS, jacobian, prior_sd, signals
from .machines import PLACEMENT, SCALE, TOLERANCES
from .plan import Floats
from .session import Session

OFFSET_MM = 10.0
SPREAD = 0.10  # of ln σ about what the gauge's maker states
# Shares of the scales of a cause's size; with another fault no cause is far beyond its size.
ALONE = {1.0: 0.80, 3.0: 0.17, 30.0: 0.03}
USUAL = {1.0: 0.80 / 0.97, 3.0: 0.17 / 0.97}
BLUNDERS = (1.0, 6.0)
TURNS = {-1: 0.42, 1: 0.42, -2: 0.07, 2: 0.07, -3: 0.01, 3: 0.01}
PATTERN_SIZES, NOISIER = (5.0, 30.0), np.geomspace(1.0, 16.0, 4)
CLERICAL = 0.1  # a fault of a whole table, in faults of one gauge
NAMED = {"backlash": 3, "bar_skew": 6}  # parameters; the others of backlash are lags


@dataclass(frozen=True, eq=False)
class Case:
    """One of the alternatives that make up an explanation: r = J x + e with x ~ N(0, sizes²)."""

    share: float
    residual: Floats  # r, shape (k,) [mm]
    jacobian: Floats  # shape (k, q), in the contract's units
    sizes: Floats  # plausible ones, shape (q,)
    positive: int = 0  # the first unknowns, so many, are not negative
    noise: float = 1.0  # how many times as much as stated a reading scatters

    @property
    def columns(self) -> Floats:
        """J of each unknown in its plausible size, shape (k, q) [mm]."""
        return self.jacobian * self.sizes

    def only(self, chosen: list[int]) -> "Case":
        """The same with some of its unknowns."""
        return replace(self, jacobian=self.jacobian[:, chosen], sizes=self.sizes[chosen])


@dataclass(frozen=True, eq=False)
class Evidence:
    """A session without its gauge zeros, and what every explanation would do to it."""

    session: Session

    @cached_property
    def _contrasts(self) -> Floats:
        """Orthonormal combinations of readings without gauge zeros, shape (k, n)."""
        zero = self.session.plan.zero
        return null_space(np.equal.outer(np.arange(zero.max() + 1), zero) * 1.0).T

    @cached_property
    def _state(self) -> Floats:
        return state_with(self.session.offsets, self.session.effects)

    @cached_property
    def _by_state(self) -> Floats:
        return jacobian(self.session.plan, self.session.machine, self._state)

    def _without_zeros(self, readings: Floats, chosen: list[str]) -> Floats:
        """Readings minus the model with all unknowns at zero, shape (k,)."""
        plan, machine = self.session.plan, self.session.machine
        held = np.zeros_like(self._state)
        for part in ("offsets", *chosen):
            held[PARTS[part]] = self._state[PARTS[part]]
        at = signals(plan, machine, held[None])[0] - self._by_state @ held
        return self._contrasts @ (readings - at)

    @cached_property
    def always(self) -> Floats:
        """Offsets, legs, places of the stands and the gauges' scale, shape (k, 3 + 3 + 6 + 1)."""
        plan, machine, step = self.session.plan, self.session.machine, 1e-2
        columns = [OFFSET_MM * self._by_state[:, PARTS["offsets"]]]
        if np.any(self.session.setting.legs):
            columns.append(self._by_state[:, PARTS["leg_length"]] * prior_sd("leg_length"))
            for stand in np.eye(plan.zero.max() + 1):
                up, down = (
                    signals(plan, machine, self._state[None], misplaced=side * step * stand)[0]
                    for side in (1.0, -1.0)
                )
                columns.append(PLACEMENT * (up - down)[:, None] / (2.0 * step))
            columns.append(SCALE * signals(plan, machine, self._state[None]).T)
        return self._contrasts @ np.hstack(columns)

    def cases(self, ids: tuple[str, ...]) -> Iterator[Case]:
        """All alternatives of a set of causes; their shares add up to one.

        Of two causes all parameters act, which is half of what they may be: the rest is left out.
        """
        broad = [id for id in ids if id in PARTS]
        fault = next((id for id in ids if id not in PARTS), None)
        residual = self._without_zeros(self.session.readings, broad)
        own = [self._contrasts @ self._by_state[:, PARTS[id]] for id in broad]
        every = np.hstack([np.zeros((len(residual), 0)), *own])
        sizes = np.concatenate([np.zeros(0), *map(prior_sd, broad)])
        count = NAMED.get("".join(broad), len(sizes)) if len(broad) == 1 else 0
        scales = (USUAL if len(ids) > 1 else ALONE) if broad else {1.0: 1.0}
        half = 0.5 if broad else 1.0
        for scale, share in scales.items():
            case = Case(half * share, residual, every, scale * sizes)
            if fault is not None:
                for more in self._faults(fault, residual):
                    yield replace(
                        more,
                        share=case.share * more.share,
                        jacobian=np.hstack([every, more.jacobian]),
                        sizes=np.concatenate([case.sizes, more.sizes]),
                    )
                continue
            positive = broad == ["backlash"]
            yield replace(case, positive=count * positive)
            # Or any one of the parameters of a cause acts alone.
            for alone in range(count):
                kept = [alone, *range(count, len(sizes))]
                share_of_one = case.share / count
                yield replace(case.only(kept), share=share_of_one, positive=int(positive))

    def _faults(self, id: str, residual: Floats) -> Iterator[Case]:
        """A fault at each place and each scale of its size."""
        plan, rows = self.session.plan, np.arange(self.session.plan.count)
        matrix, none = self._contrasts, (np.zeros((len(residual), 0)), np.zeros(0))
        single = np.eye(plan.count)
        same = np.equal.outer(plan.zero, plan.zero)
        onwards = (same & np.greater_equal.outer(rows, rows)) * 1.0  # from one reading on
        later = [row for row in rows if row != plan.stand[row]]
        if id == "swapped_gauges":
            for leg in range(3):
                right = self.session.readings[swapped_rows(plan, leg)] - self.session.readings
                yield Case(1.0 / 3.0, residual + matrix @ right, *none)
            return
        if id == "sign_flip":
            # Of one gauge, or, rarely, of all.
            shares = np.array([*np.ones(6), CLERICAL]) / (6.0 + CLERICAL)
            turned = [*(plan.zero == zero for zero in range(6)), plan.zero >= 0]
            for share, wrong in zip(shares.tolist(), turned, strict=True):
                right = np.where(wrong, -2.0 * self.session.readings, 0.0)
                yield Case(share, residual + matrix @ right, *none)
            return
        if id == "gauge_slip":
            follow = [row for row in later if onwards[:, row].sum() > 1]
            steps = np.hstack([single, onwards[:, follow]]) * self.session.gauge.revolution
            for (turns, share), step in product(TURNS.items(), steps.T):
                yield Case(share / len(steps.T), residual - turns * (matrix @ step), *none)
            return
        patterns = {
            "misread": single,
            "stand_shift": onwards[:, later],
            "gauge_drift": plan.hours[:, None] * np.equal.outer(plan.zero, range(6)),
        }[id]
        sizes = TOLERANCES[id] * np.array(BLUNDERS)
        for size, pattern in product(sizes, patterns.T):
            share = 1.0 / (len(sizes) * len(patterns.T))
            yield Case(share, residual, (matrix @ pattern)[:, None], np.array([size]))

    def patterns(self) -> dict[str, list[Case]]:
        """Some patterns that no listed cause makes, by their labels."""
        plan, sigma = self.session.plan, self.session.gauge.sigma
        residual = self._without_zeros(self.session.readings, [])
        cells = np.unique(np.stack((plan.setup, plan.displacement)), axis=1, return_inverse=True)[1]
        on_x = np.eye(plan.count)[:, plan.leg == 0]
        roots = {
            "repeats": (np.equal.outer(cells, np.unique(cells)) * 1.0, PATTERN_SIZES),
            "scatters leg x": (on_x, NOISIER),
        }
        return {
            name: [
                Case(1.0 / len(sizes), residual, columns, np.full(columns.shape[1], size * sigma))
                for size in sizes
            ]
            for name, (root, sizes) in roots.items()
            for columns in [self._contrasts @ root]
        }

    def integrated(self, cases: list[Case]) -> float:
        """Log evidence in closed form, but for σ: Gauss–Hermite; no constant -k/2 ln 2π."""
        nodes, weights = roots_hermitenorm(10)
        logs = []
        for case in cases:
            columns, residual = np.hstack([case.columns, self.always]), case.residual
            sigma = case.noise * self.session.gauge.sigma * np.exp(SPREAD * nodes)
            spread = sigma[:, None, None] ** 2 * np.eye(len(residual)) + columns @ columns.T
            root = np.linalg.cholesky(spread)
            white = np.linalg.solve(root, residual[:, None])[..., 0]
            log = -0.5 * (white**2).sum(axis=1) - np.log(np.einsum("gkk->gk", root)).sum(axis=1)
            if case.positive:
                log += [_log_positive(columns, residual, s, case.positive) for s in sigma]
            logs.append(np.log(case.share) + np.log(weights / weights.sum()) + log)
        return float(logsumexp(logs))

    def estimated(self, case: Case, sigma: float) -> tuple[Floats, Floats]:
        """Mean and covariance of offsets [mm] and parameters, the contract's units, in one case."""
        columns = np.hstack([self.always[:, :3], case.columns, self.always[:, 3:]])
        spread = np.linalg.inv(columns.T @ columns / sigma**2 + np.eye(columns.shape[1]))
        mean = spread @ columns.T @ case.residual / sigma**2
        sizes = np.concatenate([np.full(3, OFFSET_MM), case.sizes])
        shown = slice(len(sizes))
        return sizes * mean[shown], spread[shown, shown] * np.outer(sizes, sizes)

    def sampled(self, cases: list[Case], seed: int, live: int = 400) -> tuple[float, float]:
        """The same and its standard error by nested sampling of σ, the case and its unknowns."""
        ends = np.cumsum([case.share for case in cases])
        left, size, _ = np.linalg.svd(self.always, full_matrices=False)
        width = max(case.columns.shape[1] for case in cases)

        def unknowns(cube: Floats) -> Floats:
            return np.concatenate([ndtri(cube[:1]), cube[1:2] * ends[-1], ndtri(cube[2:])])

        def log_likelihood(drawn: Floats) -> float:
            case = cases[min(int(np.searchsorted(ends, drawn[1])), len(cases) - 1)]
            values = drawn[2 : 2 + case.columns.shape[1]].copy()
            values[: case.positive] = np.abs(values[: case.positive])
            error = case.residual - case.columns @ values
            variance = (case.noise * self.session.gauge.sigma * np.exp(SPREAD * drawn[0])) ** 2
            along, wide = left.T @ error, variance + size**2
            square = (error @ error - along @ along) / variance + (along**2 / wide).sum()
            count = len(error) - len(size)
            return float(-0.5 * (square + count * np.log(variance) + np.log(wide).sum()))

        rng = np.random.default_rng(seed)
        sampler = dynesty.NestedSampler(
            log_likelihood, unknowns, 2 + width, nlive=live, rstate=rng, sample="rwalk"
        )
        sampler.run_nested(dlogz=0.02, print_progress=False)
        found = sampler.results
        return float(found.logz[-1] + np.log(ends[-1])), float(found.logzerr[-1])


def _log_positive(columns: Floats, residual: Floats, sigma: float, count: int) -> float:
    """ln of how much likelier the data make it that the first unknowns are positive."""
    precision = columns.T @ columns / sigma**2 + np.eye(columns.shape[1])
    spread = np.linalg.inv(precision)
    mean = spread @ columns.T @ residual / sigma**2
    own = multivariate_normal.cdf(mean[:count], cov=spread[:count, :count])
    return float(np.log(max(own, 1e-300)) + count * np.log(2.0))
