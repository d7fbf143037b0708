"""The explanations that compete for the data: none, one cause, two causes, or something unlisted.

A base is a set of causes with many parameters acting everywhere (none, one of the machine or
the bars, or both); an extra is one cause at one of many places, or one that relabels readings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from orthoglide_cal.causes import CAUSES, Cause, PatternCause, RelabelCause, Step
from orthoglide_cal.machine import Machine

# Prior weight of the kinds of explanation.
NOTHING = 0.48
ONE_CAUSE = 0.36
TWO_CAUSES = 0.12
UNLISTED = 0.04

Names = tuple[str, ...]


@dataclass(frozen=True)
class Menu:
    """The causes to be tried on one data set.

    Attributes:
        broad: causes with machine-wide parameters.
        patterns: causes that add one pattern at one of many places.
        relabels: causes that relabel readings.
        bases: sets of broad causes, the empty one first.
        log_prior: ln prior weight of each set of ids (sorted).
    """

    broad: tuple[Cause, ...]
    patterns: tuple[PatternCause, ...]
    relabels: tuple[RelabelCause, ...]
    bases: tuple[tuple[Cause, ...], ...]
    log_prior: Mapping[Names, float]


def names(*causes: Cause) -> Names:
    """Ids of a set of causes, sorted."""
    return tuple(sorted(cause.id for cause in causes))


def menu_of(machine: Machine, timed: bool) -> Menu:
    """Causes that the machine file gives a plausible size, and all sets of one or two of them.

    Two act together only if at least one lies in the contact or the record; two of the machine
    at once are left to "unlisted".

    Args:
        machine: tolerances and gauge; a gauge without a dial cannot slip.
        timed: whether the time order of the readings is known.
    """
    usable = [
        cause
        for cause in CAUSES.values()
        if cause.possible(machine)
        and (timed or not cause.timed)
        and not any(found.id == cause.id for found in machine.identified)
    ]
    patterns = tuple(c for c in usable if isinstance(c, PatternCause))
    relabels = tuple(c for c in usable if isinstance(c, RelabelCause))
    broad = tuple(c for c in usable if not isinstance(c, PatternCause | RelabelCause))
    contact = [cause for cause in broad if cause.step is Step.CONTACT]
    both = [(a, b) for a in broad if a.in_machine for b in contact]
    bases: list[tuple[Cause, ...]] = [(), *((cause,) for cause in broad), *both]

    extras = (*patterns, *relabels)
    pairs = [names(*base) for base in both]
    pairs += [names(cause, extra) for cause in broad for extra in extras]
    log_prior: dict[Names, float] = {(): math.log(NOTHING)}
    for cause in usable:
        log_prior[names(cause)] = math.log(ONE_CAUSE / len(usable))
    for pair in pairs:
        log_prior[pair] = math.log(TWO_CAUSES / len(pairs))
    return Menu(broad, patterns, relabels, tuple(bases), log_prior)
