"""Evidence of every listed explanation, linearised where the offsets-only model fits best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import Cause, PatternCause, RelabelCause, Where
from orthoglide_cal.causes.gauge_slip import TURNS
from orthoglide_cal.diagnosis.evidence import Gaussian, NoiseGrid, log_sum
from orthoglide_cal.diagnosis.explanations import Menu, Names, names
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.estimation import fit_offsets

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
        turns: miscounted turns of a slip; None for other causes.
    """

    cause: PatternCause | RelabelCause
    where: Where
    turns: int | None = None


@dataclass(frozen=True)
class Score:
    """Log evidence (with the prior of places, without that of the set), and the best place."""

    log_evidence: float
    base: tuple[Cause, ...]
    extra: Extra | None


@dataclass(frozen=True, eq=False)
class Catalogue:
    """Places of all extras on these data, made once.

    Attributes:
        places: cause id → its places.
        columns: cause id → W·pattern of one unit, shape (k, places) [mm per unit].
        offsets: fitted offsets with each relabelling undone, id → (places, 3); "" → (3,).
        residuals: what is left then, id → (k, places); "" → (k,).
        slope: derivative of the data by the offsets at the offsets-only fit, (k, 3).
        linear: broad cause id → derivative by its parameters there, where it is absent, (k, p).
    """

    places: Mapping[str, tuple[Where, ...]]
    columns: Mapping[str, Floats]
    offsets: Mapping[str, Floats]
    residuals: Mapping[str, Floats]
    slope: Floats
    linear: Mapping[str, Floats]

    @classmethod
    def of(cls, frame: Frame, menu: Menu) -> Catalogue:
        """Enumerate the places and fit the offsets to each relabelled data set."""
        places = {
            c.id: c.places(frame.plan, frame.machine) for c in (*menu.patterns, *menu.relabels)
        }
        columns = {c.id: frame.matrix @ c.patterns(frame.plan, places[c.id]) for c in menu.patterns}
        versions = [frame.data]
        for cause in menu.relabels:
            versions += [frame.relabelled(cause, where) for where in places[cause.id]]
        fit = fit_offsets(frame.problem, np.stack(versions))
        offsets: dict[str, Floats] = {"": fit.offsets_mm[0]}
        residuals: dict[str, Floats] = {"": fit.residuals_mm[0]}
        start = 1
        for cause in menu.relabels:
            stop = start + len(places[cause.id])
            offsets[cause.id] = fit.offsets_mm[start:stop]
            residuals[cause.id] = fit.residuals_mm[start:stop].T
            start = stop
        absent = [(c, np.zeros(c.prior_std(frame.machine).size)) for c in menu.broad]
        _, slope, slopes = frame.linearised(offsets[""], absent)
        linear = {c.id: part for c, part in zip(menu.broad, slopes, strict=True)}
        return cls(places, columns, offsets, residuals, slope, linear)


def base_columns(slope: Floats, slopes: Sequence[Floats], stds: Sequence[Floats]) -> Floats:
    """B of a base: offsets and parameters scaled by their plausible sizes, shape (k, r)."""
    return np.hstack([slope * OFFSETS_MM, *(c * s for c, s in zip(slopes, stds, strict=True))])


def screen(
    frame: Frame, menu: Menu, catalogue: Catalogue, noise: NoiseGrid, widen: float = 1.0
) -> dict[Names, Score]:
    """Score every set of the menu; `widen` multiplies all tolerances."""
    scores: dict[Names, Score] = {}
    for base in menu.bases:
        stds = [cause.prior_std(frame.machine) * widen for cause in base]
        slopes = [catalogue.linear[cause.id] for cause in base]
        columns = base_columns(catalogue.slope, slopes, stds)
        density = Gaussian(columns, noise)
        scores.update(score_base(frame, menu, catalogue, noise, base, density, widen))
    return scores


def score_base(
    frame: Frame,
    menu: Menu,
    catalogue: Catalogue,
    noise: NoiseGrid,
    base: tuple[Cause, ...],
    density: Gaussian,
    widen: float,
) -> dict[Names, Score]:
    """Scores of a base alone and with every extra that the menu allows beside it."""
    residual = catalogue.residuals[""]
    alone = density.log_density(residual[:, None])[:, 0]
    scores = {names(*base): Score(float(log_sum(noise.log_weight + alone)), base, None)}
    extras: tuple[PatternCause | RelabelCause, ...] = (*menu.patterns, *menu.relabels)
    for cause in extras:
        key = names(*base, cause)
        places = catalogue.places[cause.id]
        if key not in menu.log_prior or not places:
            continue
        if isinstance(cause, RelabelCause):
            log = density.log_density(catalogue.residuals[cause.id])[..., None]
        else:
            log = pattern_density(
                frame, cause, catalogue.columns[cause.id], density, alone, residual, widen
            )
        total, _, extra = _average(cause, places, log, noise)
        scores[key] = Score(total, base, extra)
    return scores


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
    alone = density.log_density(residual[:, None])[:, 0]
    extra = score.extra
    if extra is None:
        by_sigma = noise.log_weight + alone
        return float(log_sum(by_sigma)), by_sigma
    places = catalogue.places[extra.cause.id]
    if isinstance(extra.cause, RelabelCause):
        # Only the place at which it was undone; the others stay as the screening left them.
        by_sigma = noise.log_weight + alone - np.log(len(places))
        return float(log_sum(by_sigma)), by_sigma
    columns = catalogue.columns[extra.cause.id]
    log = pattern_density(frame, extra.cause, columns, density, alone, residual, widen)
    total, by_sigma, _ = _average(extra.cause, places, log, noise)
    return total, by_sigma


def pattern_density(
    frame: Frame,
    cause: PatternCause,
    columns: Floats,
    density: Gaussian,
    alone: Floats,
    residual: Floats,
    widen: float,
) -> Floats:
    """Log density with a pattern at each place and size and ln of its share, (g, places, sizes)."""
    power = density.quadratic(columns)[..., None]
    match = density.product(columns, residual)[..., None]
    if cause.id == "gauge_slip":
        revolution = frame.machine.gauge.revolution_mm or 0.0
        size = np.array(list(TURNS), dtype=np.float64) * revolution
        gain = size * match - 0.5 * size**2 * power + np.log(list(TURNS.values()))
    else:
        scales = np.array(BLUNDER_SCALES)
        variance = (cause.prior_std(frame.machine)[0] * widen * scales) ** 2
        widened = 1.0 + variance * power
        gain = 0.5 * (match**2 * variance / widened - np.log(widened)) - np.log(len(scales))
    return np.asarray(alone[:, None, None] + gain)


def _average(
    cause: PatternCause | RelabelCause,
    places: tuple[Where, ...],
    log: Floats,
    noise: NoiseGrid,
) -> tuple[float, Floats, Extra]:
    """Average over σ, sizes and places; the parts by σ; the place that counts most."""
    weighted = log + noise.log_weight[:, None, None] - np.log(len(places))
    by_place = log_sum(weighted, axis=0)
    place, size = np.unravel_index(int(np.argmax(by_place)), by_place.shape)
    turns = list(TURNS)[size] if cause.id == "gauge_slip" else None
    extra = Extra(cause, places[place], turns)
    return float(log_sum(by_place)), log_sum(weighted, axis=(1, 2)), extra
