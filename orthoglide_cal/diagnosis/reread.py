"""Faults of the record that cannot be undone in the data, because readings lack a counterpart.

Where every reading of one direction has its partner in the other, exchanged gauges are undone by
exchanging the data, and one linear model serves all such hypotheses (`screen`). Where a reading
is missing, the same data are read under another plan instead, with a linear model of its own.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.diagnosis.catalogue import Catalogue
from orthoglide_cal.diagnosis.evidence import NoiseGrid
from orthoglide_cal.diagnosis.explanations import Menu, Names, names
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.diagnosis.refine import Fitted, refine
from orthoglide_cal.diagnosis.screen import Extra, Score, screen


@dataclass(frozen=True, eq=False)
class Reread:
    """An explanation under another plan.

    Attributes:
        frame: the data under that plan.
        catalogue: made for it.
        base: the score of its base there.
        score: the score among all explanations.
    """

    frame: Frame
    catalogue: Catalogue
    base: Score
    score: Score

    def refine(self, noise: NoiseGrid, widen: float = 1.0) -> Fitted:
        """As `refine.refine`."""
        fit = refine(self.frame, self.catalogue, noise, self.base, widen=widen)
        extra = self.score.extra
        assert extra is not None
        places = self.score.log_evidence - self.base.log_evidence
        return dataclasses.replace(
            fit,
            score=Score(fit.log_evidence + places, self.base.base, extra),
            acting=(*fit.acting, extra.cause.at(np.zeros(0), extra.where)),
        )


def reread(
    frame: Frame, menu: Menu, catalogue: Catalogue, noise: NoiseGrid, widen: float = 1.0
) -> dict[Names, Reread]:
    """The best place of every such fault beside every base of at most one cause."""
    single = tuple(base for base in menu.bases if len(base) <= 1)
    bases = dataclasses.replace(menu, patterns=(), relabels=(), bases=single)
    found: dict[Names, Reread] = {}
    for cause in menu.relabels:
        places = catalogue.places[cause.id]
        for where in (where for where in places if where not in catalogue.undone[cause.id]):
            other = dataclasses.replace(frame, plan=cause.reread(frame.plan, where))
            own = Catalogue.of(other, bases)
            for base in screen(other, bases, own, noise, widen).values():
                log = base.log_evidence - math.log(len(places))
                score = Score(log, base.base, Extra(cause, where))
                key = names(*base.base, cause)
                if key not in found or log > found[key].score.log_evidence:
                    found[key] = Reread(other, own, base, score)
    return found
