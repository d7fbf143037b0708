"""The causes that compete on one data set, and how plausible each set of them is beforehand.

Tried are "nothing is wrong", one cause, and two causes, these also with wrong readings. A base is a
set of causes with many parameters acting everywhere (none, one of the machine or the bars, or
both); an extra is one cause at one of many places, or one that relabels readings.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass

from orthoglide_cal.causes import CAUSES, UNLISTED, PatternCause, RelabelCause
from orthoglide_cal.model.cause import Cause, Stage
from orthoglide_cal.model.model import Model

Ids = tuple[str, ...]  # of causes that act together, sorted; () is "nothing is wrong"

# Prior weight of the kinds of explanation; the last but one is shared by the unlisted patterns.
ONE_CAUSE = 0.38
TWO_CAUSES = ONE_CAUSE**2 / 2.0  # independent of each other

MANY = 1000  # places of a bed: enough for every term of a shape


@functools.lru_cache(maxsize=1024)
def ids_of(*causes: Cause) -> Ids:
    """Ids of a set of causes, sorted."""
    return tuple(sorted(cause.id for cause in causes))


@dataclass(frozen=True)
class Candidates:
    """The causes to be tried on one data set."""

    broad: tuple[Cause, ...]  # causes with machine-wide parameters
    pairs: tuple[tuple[Cause, ...], ...]  # of them, those that may act together
    # Causes that add one pattern at one of many places, then those that relabel.
    extras: tuple[PatternCause | RelabelCause, ...]
    log_prior: Mapping[Ids, float]  # ln prior weight of each set of ids

    @classmethod
    @functools.lru_cache(maxsize=8)
    def of(cls, model: Model, ordered: bool, spots: int = MANY) -> Candidates:
        """Causes that are possible on the machine, and sets of one or two of them.

        Two act together only if at least one lies in the contact or the record, or is a companion
        of all on that kind of machine; two others of the machine at once are left to "unlisted".

        Not those that the model knows already or rules out; `ordered` if the time order of the
        readings is known, `spots` the number of places of a bed that were touched.
        """
        # What a controller corrects may be more by now.
        known = {effect.cause.id for effect in model.accepted} - model.machine.corrected.keys()
        usable = [
            cause
            for cause in (cause.within(spots) for cause in CAUSES.values())
            if cause is not None
            if cause.possible(model.machine) and (ordered or not cause.timed)
            if cause.id not in known and cause.id not in model.ruled_out
            # What such readings hold of themselves.
            if not (cause.timed and cause.id in model.machine.unobservable)
        ]
        extras: tuple[PatternCause | RelabelCause, ...] = (
            *(cause for cause in usable if isinstance(cause, PatternCause)),
            *(cause for cause in usable if isinstance(cause, RelabelCause)),
        )
        broad = tuple(cause for cause in usable if cause not in extras)
        contact = [cause for cause in broad if cause.stage is Stage.CONTACT]
        beside = [cause for cause in broad if cause.id in model.machine.companions]
        pairs = tuple((a, b) for a in broad if a.in_machine for b in contact)
        pairs += tuple((a, b) for a in broad if a.in_machine and a not in beside for b in beside)
        both = [*pairs, *((cause, extra) for cause in broad for extra in extras)]
        log_prior: dict[Ids, float] = {}
        for share, sets in ((ONE_CAUSE, [(cause,) for cause in usable]), (TWO_CAUSES, both)):
            weight = {ids_of(*causes): math.prod(c.weight for c in causes) for causes in sets}
            total = sum(weight.values())
            log_prior |= {ids: math.log(share * w / total) for ids, w in weight.items()}
        # A slip happens whatever else is wrong.
        for slip in (cause for cause in extras if cause.hides_reading):
            log_prior |= {
                ids_of(*pair, slip): log_prior[ids_of(*pair)] + log_prior[slip.id,]
                for pair in pairs
            }
        log_prior[()] = math.log(1.0 - UNLISTED - sum(map(math.exp, log_prior.values())))
        return cls(broad, pairs, extras, log_prior)
