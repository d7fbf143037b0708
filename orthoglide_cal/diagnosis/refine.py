"""One explanation fitted nonlinearly, and its evidence linearised at its own best fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import Acting, Cause, PatternCause, RelabelCause
from orthoglide_cal.diagnosis.catalogue import Catalogue
from orthoglide_cal.diagnosis.evidence import Gaussian, NoiseGrid, log_sum
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.diagnosis.screen import (
    BLUNDER_SCALES,
    OFFSETS_MM,
    Extra,
    Score,
    base_columns,
    evidence_beside,
)
from orthoglide_cal.diagnosis.sparse import LOG_ALL, with_single


@dataclass(frozen=True, eq=False)
class Fitted:
    """An explanation at its best fit.

    Attributes:
        score: the explanation; its extra at the best place, its evidence at this fit.
        offsets: shape (3,) [mm].
        covariance: of offsets, parameters of the base in order, size of the extra; shape (q, q),
            internal units.
        acting: its causes with their best parameters, as effects of the forward model.
        linear: whitened data minus the linearised model at zero parameters, shape (k,) [mm].
        residual: whitened data minus prediction, shape (k,) [mm].
        columns: whitened derivatives by the same unknowns, shape (k, q).
        stds: their plausible sizes, shape (q,).
        sigma: standard deviation of one reading under this explanation [mm].
    """

    score: Score
    offsets: Floats
    covariance: Floats
    acting: tuple[Acting, ...]
    linear: Floats
    residual: Floats
    columns: Floats
    stds: Floats
    sigma: float

    @property
    def offsets_std(self) -> Floats:
        """Standard deviations of the offsets, shape (3,) [mm]."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def wrong_reading(self) -> int | None:
        """Index of the one reading that it calls wrong by an unknown amount, if any."""
        extra = self.score.extra
        if extra is None or not isinstance(extra.cause, PatternCause):
            return None
        return extra.where.index[0] if extra.cause.hides_reading else None

    @property
    def log_evidence(self) -> float:
        """With the prior of places, without that of the set."""
        return self.score.log_evidence


def refine(
    frame: Frame,
    catalogue: Catalogue,
    noise: NoiseGrid,
    score: Score,
    iterations: int = 1,
    widen: float = 1.0,
) -> Fitted:
    """Fit an explanation by Gauss–Newton with its priors, then judge it there.

    Args:
        frame: the data.
        catalogue: places of the extras.
        noise: grid of σ.
        score: the explanation as the screening left it.
        iterations: relinearisations; one is enough for ranking.
        widen: factor on all tolerances.
    """
    base, extra = score.base, score.extra
    sizes = [cause.prior_std(frame.machine) * widen for cause in base]
    theta = [np.zeros(size.size) for size in sizes]
    data, start = frame.data, catalogue.offsets[""]
    pattern = None
    if extra is not None:
        if isinstance(extra.cause, RelabelCause):
            data = frame.relabelled(extra.cause, extra.where)
            place = catalogue.undone[extra.cause.id].index(extra.where)
            start = catalogue.offsets[extra.cause.id][place]
        else:
            place = catalogue.places[extra.cause.id].index(extra.where)
            pattern = catalogue.columns[:, catalogue.own[extra.cause.id]][:, place]
    offsets, sigma = start, float(noise.sigma[np.argmax(noise.log_weight)])

    extra_size, extra_std = _extra_prior(frame, score, widen)
    doubt = catalogue.doubt
    unknowns = 3 + sum(size.size for size in sizes) + extra_std.size
    stds = np.concatenate([np.full(3, OFFSETS_MM), *sizes, extra_std, np.ones(doubt.shape[1])])
    free = None if pattern is None or extra_std.size == 0 else pattern[:, None]
    fixed = np.zeros(len(frame)) if pattern is None else pattern * extra_size
    # First the linear model of the screening, then that of the fit it gives, and so on. The
    # screening's is already that of the offsets alone.
    if not base and data is frame.data:
        iterations = 0
    slope, slopes = catalogue.slope, [catalogue.linear[cause.id] for cause in base]
    linear = _residual_of(catalogue, extra) - fixed
    for iteration in range(iterations + 1):
        if iteration:
            model, slope, slopes = frame.linearised(offsets, list(zip(base, theta, strict=True)))
            linear = data - fixed - model
            linear = linear + sum(c @ t for c, t in zip(slopes, theta, strict=True))
        columns = np.hstack([slope, *slopes, *([free] if free is not None else []), doubt])
        covariance = _covariance(columns, stds, sigma)
        solution = covariance @ (columns.T @ linear) / sigma**2
        residual = linear - columns @ solution
        offsets = offsets + solution[:3]
        theta = _split(solution[3:], [t.size for t in theta])
    density = Gaussian(base_columns(slope, slopes, sizes, doubt), noise)
    log, by_sigma = evidence_beside(frame, score, catalogue, noise, density, linear + fixed, widen)
    if extra is None and len(base) == 1:
        others = base_columns(slope, [], [], doubt)
        (log,) = with_single([(base[0], slopes[0] * sizes[0], log)], others, linear, noise)
    elif base:
        log += LOG_ALL
    weight = np.exp(by_sigma - log_sum(by_sigma))
    sigma_new = float(np.sqrt(weight @ noise.sigma**2))
    covariance = _covariance(columns, stds, sigma_new)
    log += _positivity(base, solution[3:], covariance[3:, 3:])
    size = (
        solution[unknowns - 1 : unknowns]
        if free is not None
        else np.full(1, float(extra.count or 0) if extra else 0)
    )
    return Fitted(
        score=Score(log, base, extra),
        offsets=offsets,
        covariance=covariance,
        acting=_acting(base, theta, score, size),
        linear=linear,
        residual=residual,
        columns=columns,
        stds=stds,
        sigma=sigma_new,
    )


def _covariance(columns: Floats, stds: Floats, sigma: float) -> Floats:
    """Posterior covariance of the unknowns of a linear model with priors, shape (q, q)."""
    precision = columns.T @ columns / sigma**2 + np.diag(1.0 / stds**2)
    return np.asarray(np.linalg.inv(precision), dtype=np.float64)


def _residual_of(catalogue: Catalogue, extra: Extra | None) -> Floats:
    """Residual of the offsets-only fit, a relabelling undone, shape (k,)."""
    if extra is None or not isinstance(extra.cause, RelabelCause):
        return catalogue.residuals[""]
    place = catalogue.undone[extra.cause.id].index(extra.where)
    return catalogue.residuals[extra.cause.id][:, place]


def _extra_prior(frame: Frame, score: Score, widen: float) -> tuple[float, Floats]:
    """Known size [mm] of an extra, and the prior of an unknown one (shape (0,) or (1,))."""
    extra = score.extra
    if extra is None or isinstance(extra.cause, RelabelCause):
        return 0.0, np.zeros(0)
    if extra.count is not None:
        return extra.count * extra.cause.millimetres(frame.machine), np.zeros(0)
    return 0.0, extra.cause.prior_std(frame.machine) * widen * max(BLUNDER_SCALES)


def _split(values: Floats, sizes: list[int]) -> list[Floats]:
    return np.split(values[: sum(sizes)], np.cumsum(sizes)[:-1]) if sizes else []


def _positivity(base: Sequence[Cause], values: Floats, covariance: Floats) -> float:
    """ln of how much likelier the data make it that widths are positive than the prior does."""
    log, start = 0.0, 0
    for cause in base:
        count = len(cause.names)
        if cause.positive:
            own = slice(start, start + count)
            score = values[own] / np.sqrt(np.diag(covariance)[own])
            log += float((log_ndtr(score) - np.log(0.5)).sum())
        start += count + len(cause.nuisance)
    return log


def _acting(
    base: Sequence[Cause], theta: list[Floats], score: Score, size: Floats
) -> tuple[Acting, ...]:
    acting = [cause.at(value) for cause, value in zip(base, theta, strict=True)]
    extra = score.extra
    if extra is not None:
        value = size if isinstance(extra.cause, PatternCause) else np.zeros(0)
        acting.append(extra.cause.at(value, extra.where))
    return tuple(acting)
