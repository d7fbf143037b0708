"""Hypotheses about how a machine responded to a correction: as applied, opposite, not at all, ...

    change = J m + e,   m = order·applied + C g,   g ~ N(0, size²),   e ~ N(0, σ² I)

`change` is that of the readings between two sessions, in independent noise, J its derivative by
what each axis moved, m. A hypothesis is a signed order of what was applied, and what is free about
it: the gain of all axes together, or axes by themselves. σ is unknown: two sessions often differ by
more than their gauge's noise.
"""

import math
from collections.abc import Iterator
from enum import StrEnum
from itertools import combinations, permutations, product
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from orthoglide_cal.estimation.gaussian import log_mean, log_sum, probabilities
from orthoglide_cal.estimation.losses import (
    FALSE_RELEASE,
    MISSED_FAULT,
    NEEDLESS_HOLD,
    is_dismissed,
    state,
)
from orthoglide_cal.inference.evidence import Gaussian, NoiseGrid
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.words import MM_PER_INCH

# Stands a millimetre off change what a gauge shows of an offset by up to this share of it.
STANDS = 0.01
SIZES = 2.0 ** np.arange(-5.0, 6.0)  # prior ones of what is free, in units of what was applied
NOISE = 2.0 ** np.arange(-1.0, 7.0, 0.5)  # that are tried, in units of what is stated


class Behaviour(StrEnum):
    """Response of the machine."""

    AS_MODELLED = "as modelled"
    OPPOSITE = "opposite sign"
    EXCHANGED = "axes exchanged"
    NO_RESPONSE = "no response"
    OTHER_GAIN = "other gain"
    PARTLY = "in part"
    UNDETERMINED = "undetermined"


# A correction that has to be verified went wrong as often as not, in each of five ways as often.
PRIOR = dict.fromkeys(Behaviour, 0.1) | {Behaviour.AS_MODELLED: 0.5}
# Of exchanged axes half have kept their signs: five orders of 46.
SIGNS_KEPT, SIGNS_CHANGED = 0.5 / 5.0, 0.5 / 41.0


class Response(NamedTuple):
    """One hypothesis: what each axis did."""

    behaviour: Behaviour
    share: float  # of the prior of that behaviour
    moved: Floats  # what the axes moved by, shape (3,) [mm]
    free: Floats  # columns of what is free about it, of size 1, shape (3, q) [mm]


def responses(applied: Floats) -> Iterator[Response]:
    """Every hypothesis about what was applied, (3,) [mm], not all zero; or all as one, (1,)."""
    nothing, every = np.zeros((len(applied), 0)), np.abs(applied).max() * np.eye(len(applied))
    yield Response(Behaviour.AS_MODELLED, 1.0, applied, nothing)
    yield Response(Behaviour.OPPOSITE, 1.0, -applied, nothing)
    yield Response(Behaviour.NO_RESPONSE, 1.0, 0.0 * applied, nothing)
    yield Response(Behaviour.OTHER_GAIN, 0.5, applied, applied[:, None])
    for gain in (MM_PER_INCH, 1.0 / MM_PER_INCH):
        yield Response(Behaviour.OTHER_GAIN, 0.25, gain * applied, nothing)
    if len(applied) == 1:
        return  # nothing is exchanged, and a part of it is another gain
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order != (0, 1, 2) or len(set(signs)) > 1:
            share = SIGNS_KEPT if min(signs) > 0.0 else SIGNS_CHANGED
            moved = np.array(signs) * applied[list(order)]
            yield Response(Behaviour.EXCHANGED, share, moved, nothing)
    subsets = [list(axes) for count in (1, 2, 3) for axes in combinations(range(3), count)]
    for subset in subsets:
        yield Response(Behaviour.PARTLY, 1.0 / len(subsets), applied, every[:, subset])


def decide_response(
    change: Floats, jacobian: Floats, applied: Floats, noise_mm: float
) -> tuple[Behaviour, Response]:
    """The statement of least expected loss about a correction, and its likeliest hypothesis.

    Args:
        change: of the readings, in independent noise, shape (k,) [mm].
        jacobian: derivative of it by what the axes moved by, shape (k, 3).
        applied: what was entered, shape (3,) [mm], not all zero.
        noise_mm: standard deviation of one reading, as stated.
    """
    noise, weighed = NoiseGrid(noise_mm * NOISE, np.zeros(len(NOISE))), []
    weights: dict[Behaviour, list[float]] = {}
    for one in responses(applied):
        columns = jacobian @ np.hstack((np.diag(STANDS * one.moved), one.free))
        sizes = np.repeat(SIZES[:, None], columns.shape[1], axis=1)
        sizes[:, : len(one.moved)] = 1.0
        log = log_mean(Gaussian(columns, sizes, noise).by_noise(change - jacobian @ one.moved))
        log += math.log(one.share * PRIOR[one.behaviour])
        weighed.append((log, one))
        weights.setdefault(one.behaviour, []).append(log)
    belief = probabilities({key: float(log_sum(np.array(logs))) for key, logs in weights.items()})
    stated, _ = state(belief, Behaviour.AS_MODELLED, MISSED_FAULT, NEEDLESS_HOLD)
    either = Behaviour.AS_MODELLED, Behaviour.NO_RESPONSE
    if stated in either and not is_dismissed(min(belief[key] for key in either), FALSE_RELEASE):
        return Behaviour.UNDETERMINED, weighed[0][1]
    same = (pair for pair in weighed if pair[1].behaviour is stated)
    return stated, max(same, key=itemgetter(0))[1]
