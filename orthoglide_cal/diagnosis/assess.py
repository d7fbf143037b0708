"""All explanations of one data set, weighed: the numerical half of a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.diagnosis.catalogue import Catalogue
from orthoglide_cal.diagnosis.evidence import NoiseGrid
from orthoglide_cal.diagnosis.explanations import Menu, Names, menu_of
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.diagnosis.posterior import Answer, Posterior, answer, misfit
from orthoglide_cal.diagnosis.refine import Fitted, refine
from orthoglide_cal.diagnosis.reread import reread
from orthoglide_cal.diagnosis.result import AMBIGUOUS, CONSISTENT, NAMED
from orthoglide_cal.diagnosis.screen import Score, screen
from orthoglide_cal.diagnosis.unlisted import Unlisted, unlisted_patterns

# Explanations within this much log evidence of the best are fitted nonlinearly, the best few.
WORTH_A_FIT = 8.0
FITS = 3
# A cause this probable beside "nothing is wrong" widens the offsets' uncertainty.
WEIGHS = 0.01


@dataclass(frozen=True, eq=False)
class Assessment:
    """Explanations of one data set with their probabilities.

    Attributes:
        frame: the data.
        menu: what was tried.
        catalogue: places of the extras.
        noise: grid of σ.
        scores: set of ids → score of the screening.
        fits: nonlinear fits of the sets that matter; always those of () and of the best set.
        refit: fits a set nonlinearly.
        unlisted: patterns beyond the list.
        posterior: probabilities.
        answer: the verdict.
    """

    frame: Frame
    menu: Menu
    catalogue: Catalogue
    noise: NoiseGrid
    scores: Mapping[Names, Score]
    fits: dict[Names, Fitted]
    refit: Callable[[Names], Fitted]
    unlisted: tuple[Unlisted, ...]
    posterior: Posterior
    answer: Answer

    def fit(self, key: Names) -> Fitted:
        """The nonlinear fit of a set of ids; made when first asked for."""
        if key not in self.fits:
            self.fits[key] = self.refit(key)
        return self.fits[key]

    @property
    def accepted(self) -> Fitted:
        """The fit of the accepted set; of the offsets alone if there is none."""
        return self.fit(self.answer.accepted)

    def offsets(self) -> tuple[Floats, Floats]:
        """Offsets and standard deviations under the answer, shapes (3,), (3,) [mm].

        Averaged over the explanations that the data leave open, weighted by probability, so
        that the choice among them is part of the uncertainty.
        """
        verdict = self.answer.verdict
        if verdict == NAMED:
            return self.accepted.offsets, self.accepted.offsets_std
        listed = self.posterior.listed
        if verdict == AMBIGUOUS:
            keys = [self.posterior.best, *self.posterior.rivals()]
        elif verdict == CONSISTENT:
            unseen = [(cause,) for cause in self.posterior.unseen()]
            keys = [(), *(key for key in unseen if listed[key] >= WEIGHS * listed[()])]
        else:
            return self._unexplained_offsets()
        weights = np.array([listed[key] for key in keys])
        weights /= weights.sum()
        values = np.stack([self.fit(key).offsets for key in keys])
        variances = np.stack([self.fit(key).offsets_std ** 2 for key in keys])
        mean = weights @ values
        return mean, np.sqrt(weights @ (variances + (values - mean) ** 2))

    def _unexplained_offsets(self) -> tuple[Floats, Floats]:
        """Offsets-only fit, its uncertainty widened by the likeliest unlisted pattern."""
        pattern = max(self.unlisted, key=lambda u: u.log_evidence)
        fit = self.fit(())
        slope = fit.columns[:, :3]
        spread = pattern.sigma**2 * np.eye(len(self.frame)) + pattern.columns @ pattern.columns.T
        estimator = np.linalg.pinv(slope)
        likeliest = np.diag(estimator @ spread @ estimator.T)
        # Whatever it is may also return with its posture, where repeats cannot average it out:
        # as large in each cell as what is left in the readings.
        left = float(fit.residual @ fit.residual) / max(len(self.frame) - 3, 1)
        cells = self.frame.matrix @ (
            self.frame.plan.cells[:, None] == np.unique(self.frame.plan.cells)
        )
        returning = left * np.diag(
            estimator @ (np.eye(len(self.frame)) + cells @ cells.T) @ estimator.T
        )
        return fit.offsets, np.sqrt(np.maximum(likeliest, returning))


def assess(frame: Frame, widen: float = 1.0) -> Assessment:
    """Weigh every explanation.

    Args:
        frame: the data.
        widen: factor on all tolerances, to see how the answer depends on them.
    """
    machine = frame.machine
    menu = menu_of(machine, frame.timed)
    noise = NoiseGrid.around(machine.gauge.noise_mm)
    catalogue = Catalogue.of(frame, menu)
    scores = screen(frame, menu, catalogue, noise, widen)
    others = {
        key: other
        for key, other in reread(frame, menu, catalogue, noise, widen).items()
        if key not in scores or other.score.log_evidence > scores[key].log_evidence
    }
    scores |= {key: other.score for key, other in others.items()}

    def refit(key: Names) -> Fitted:
        if key in others:
            return others[key].refine(noise, widen)
        return refine(frame, catalogue, noise, scores[key], widen=widen)

    weight = {key: score.log_evidence + menu.log_prior[key] for key, score in scores.items()}
    order = sorted(weight, key=lambda key: -weight[key])
    chosen = [key for key in order[:FITS] if weight[key] > weight[order[0]] - WORTH_A_FIT]
    fits = {key: refit(key) for key in chosen}
    evidence = {key: score.log_evidence for key, score in scores.items()}
    evidence.update({key: fit.log_evidence for key, fit in fits.items()})

    unlisted = unlisted_patterns(
        frame, catalogue.slope, catalogue.doubt, catalogue.residuals[""], noise
    )
    posterior = Posterior.of(evidence, menu, {u.what: u.log_evidence for u in unlisted})
    best = posterior.best
    if best not in fits:
        fits[best] = refit(best)
    left = fits[best].residual
    chance = misfit(
        float(left @ left), len(frame) - effective_unknowns(fits[best]), machine.gauge.noise_mm
    )
    return Assessment(
        frame,
        menu,
        catalogue,
        noise,
        scores,
        fits,
        refit,
        tuple(unlisted),
        posterior,
        answer(posterior, chance),
    )


def effective_unknowns(fit: Fitted) -> float:
    """Degrees of freedom that a fit with priors takes up: trace of its hat matrix."""
    gain = fit.covariance @ fit.columns.T / fit.sigma**2
    return float(np.trace(fit.columns @ gain))
