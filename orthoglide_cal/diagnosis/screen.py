"""Evidence of every listed explanation, linearised where the offsets-only model fits best."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import Cause, PatternCause, RelabelCause, Where
from orthoglide_cal.diagnosis.catalogue import Catalogue
from orthoglide_cal.diagnosis.evidence import Gaussian, NoiseGrid, log_sum, log_sums
from orthoglide_cal.diagnosis.explanations import Menu, Names, names
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.diagnosis.sparse import LOG_ALL, with_single

# Offsets are not judged by their size: one standard deviation of their prior [mm].
OFFSETS_MM = 10.0
# Blunders have no typical size: each is tried at the tolerance and at larger scales.
BLUNDER_SCALES = (1.0, 6.0)


@dataclass(frozen=True)
class Extra:
    """One cause at one place, beside a base.

    Attributes:
        cause: a pattern cause or a relabelling one.
        where: the place.
        count: its size where that is a whole number; None for a size of any value.
    """

    cause: PatternCause | RelabelCause
    where: Where
    count: int | None = None


@dataclass(frozen=True)
class Score:
    """Log evidence (with the prior of places, without that of the set), and the best place."""

    log_evidence: float
    base: tuple[Cause, ...]
    extra: Extra | None


def base_columns(
    slope: Floats, slopes: Sequence[Floats], stds: Sequence[Floats], doubt: Floats
) -> Floats:
    """B of a base: offsets and parameters scaled by their plausible sizes, shape (k, r)."""
    return np.hstack(
        [slope * OFFSETS_MM, doubt, *(c * s for c, s in zip(slopes, stds, strict=True))]
    )


def screen(
    frame: Frame, menu: Menu, catalogue: Catalogue, noise: NoiseGrid, widen: float = 1.0
) -> dict[Names, Score]:
    """Score every set of the menu; `widen` multiplies all tolerances."""
    # Beside an extra there is at most one cause of the base.
    single = [base for base in menu.bases if len(base) <= 1]
    both = [base for base in menu.bases if len(base) > 1]
    density, by_sigma = _of_bases(frame, single, catalogue, noise, widen)
    scores = _alone(single, by_sigma)
    together = [
        (
            cause,
            catalogue.linear[cause.id] * cause.prior_std(frame.machine) * widen,
            scores[names(cause)].log_evidence,
        )
        for cause in menu.broad
    ]
    if together:
        others = base_columns(catalogue.slope, [], [], catalogue.doubt)
        logs = with_single(together, others, catalogue.residuals[""], noise)
        for (cause, _, _), log in zip(together, logs, strict=True):
            scores[names(cause)] = Score(log, (cause,), None)
    scores |= _with_extras(frame, menu, catalogue, noise, single, density, by_sigma, widen)
    if both:
        by_sigma = _of_bases(frame, both, catalogue, noise, widen)[1]
        scores |= _alone(both, by_sigma + LOG_ALL)
    return scores


def _alone(bases: Sequence[tuple[Cause, ...]], by_sigma: Floats) -> dict[Names, Score]:
    """Scores of bases without an extra."""
    logs = log_sums(by_sigma, 1).tolist()
    return {names(*base): Score(log, base, None) for base, log in zip(bases, logs, strict=True)}


def _with_extras(
    frame: Frame,
    menu: Menu,
    catalogue: Catalogue,
    noise: NoiseGrid,
    bases: Sequence[tuple[Cause, ...]],
    density: Gaussian,
    by_sigma: Floats,
    widen: float,
) -> dict[Names, Score]:
    """Scores of every extra beside every base of at most one cause.

    Args:
        bases: the bases.
        density: under them.
        by_sigma: their own log densities, shape (bases, g), as `_of_bases` gives them.
    """
    power, match = density.against(catalogue.columns, catalogue.residuals[""])
    extras: tuple[PatternCause | RelabelCause, ...] = (*menu.patterns, *menu.relabels)
    scores: dict[Names, Score] = {}
    for cause in extras:
        tried = catalogue.undone.get(cause.id, catalogue.places[cause.id])
        if not tried:
            continue
        if isinstance(cause, RelabelCause):
            log = density.log_density(catalogue.residuals[cause.id]) + noise.log_weight[:, None]
        else:
            own = catalogue.own[cause.id]
            log = pattern_density(frame, cause, power[..., own], match[..., own], by_sigma, widen)
        share = math.log(len(catalogue.places[cause.id]))
        log = log_sums(log.reshape(*by_sigma.shape, -1), 1) - share
        best, total = log.argmax(axis=1).tolist(), log_sums(log, 1).tolist()
        for base, number, value in zip(bases, best, total, strict=True):
            log_evidence = value + LOG_ALL if base else value
            extra = _extra(cause, tried, number)
            scores[names(*base, cause)] = Score(log_evidence, base, extra)
    return scores


def _of_bases(
    frame: Frame,
    bases: Sequence[tuple[Cause, ...]],
    catalogue: Catalogue,
    noise: NoiseGrid,
    widen: float,
) -> tuple[Gaussian, Floats]:
    """Densities under many bases at once, padded with columns of zeros to one width.

    Returns:
        The densities; that of the data without an extra, with the weight of each σ, (bases, g).
    """
    columns = []
    for base in bases:
        stds = [cause.prior_std(frame.machine) * widen for cause in base]
        slopes = [catalogue.linear[cause.id] for cause in base]
        columns.append(base_columns(catalogue.slope, slopes, stds, catalogue.doubt))
    padded = np.zeros((len(bases), len(frame), max(own.shape[1] for own in columns)))
    for filled, own in zip(padded, columns, strict=True):
        filled[:, : own.shape[1]] = own
    density = Gaussian(padded, noise)
    residual = catalogue.residuals[""]
    return density, density.log_density(residual[:, None])[..., 0] + noise.log_weight


def evidence_beside(
    frame: Frame,
    score: Score,
    catalogue: Catalogue,
    noise: NoiseGrid,
    density: Gaussian,
    residual: Floats,
    widen: float,
) -> tuple[float, Floats]:
    """Evidence of one explanation from the density of its base at another linearisation.

    Args:
        residual: data (relabelling undone) minus the linearised base at zero parameters, (k,).

    Returns:
        Log evidence; its parts by σ, shape (g,).
    """
    by_sigma = density.log_density(residual[:, None])[:, 0] + noise.log_weight
    extra = score.extra
    if extra is None:
        return log_sum(by_sigma), by_sigma
    places = catalogue.places[extra.cause.id]
    if isinstance(extra.cause, RelabelCause):
        # Only the place at which it was undone; the others stay as the screening left them.
        by_sigma = by_sigma - math.log(len(places))
        return log_sum(by_sigma), by_sigma
    columns = catalogue.columns[:, catalogue.own[extra.cause.id]]
    power, match = density.against(columns, residual)
    log = pattern_density(frame, extra.cause, power, match, by_sigma, widen)
    by_sigma = log_sums(log.reshape(len(log), -1), 1) - math.log(len(places))
    return log_sum(by_sigma), by_sigma


def pattern_density(
    frame: Frame,
    cause: PatternCause,
    power: Floats,
    match: Floats,
    without: Floats,
    widen: float,
) -> Floats:
    """Log density with a pattern c at each place and size, and ln of the size's share.

    Args:
        frame: the data.
        cause: whose pattern it is.
        power: cᵀ S⁻¹ c, shape (..., g, places) [1].
        match: cᵀ S⁻¹ r, shape (..., g, places).
        without: log density without it, shape (..., g).
        widen: factor on the tolerance.

    Returns:
        Shape (..., g, sizes, places).
    """
    power, match = power[..., None, :], match[..., None, :]
    if cause.counts:
        size = np.array(list(cause.counts))[:, None] * cause.millimetres(frame.machine)
        log = (-0.5 * size) * power
        log += match
        log *= size
        share = np.log(list(cause.counts.values()))
    else:
        scales = np.array(BLUNDER_SCALES)
        variance = ((cause.prior_std(frame.machine)[0] * widen * scales) ** 2)[:, None]
        widened = variance * power
        widened += 1.0
        log = match**2 * variance
        log /= widened
        log -= np.log(widened)
        log *= 0.5
        share = np.full(len(scales), -math.log(len(scales)))
    log += (without[..., None] + share)[..., None]
    return log


def _extra(cause: PatternCause | RelabelCause, places: tuple[Where, ...], number: int) -> Extra:
    """The extra of a size and place, counted through sizes and then places."""
    size, place = divmod(number, len(places))
    counts = list(cause.counts) if isinstance(cause, PatternCause) else []
    return Extra(cause, places[place], counts[size] if counts else None)
