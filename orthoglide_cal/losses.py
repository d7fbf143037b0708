"""Losses by which everything is decided: what a wrong statement costs, in minutes of a workshop.

They are stated here only; no probability is compared with a number of its own.
"""

import math
from collections.abc import Hashable, Mapping
from typing import TypeVar

Key = TypeVar("Key", bound=Hashable)

# An answer is left open: one more measurement, stands fetched, set up and read.
OPEN_ANSWER = 30.0
# A sound part is named: it is ordered and replaced, the machine is calibrated again, and the fault
# is still there. A week of 50 hours.
WRONG_NAME = 3000.0
# Offsets are entered that a fault of the record has falsified: what is made until the next check,
# half a week, is scrap.
FALSE_RELEASE = 1500.0
# A fault that these readings hardly show is missed: it is found at the next check, and one session
# more has to be measured then, with its set-up.
MISSED_FAULT = 75.0
# What is right is taken for a fault, or corrected: the machine stands still for two hours.
NEEDLESS_HOLD = 120.0
# The same of a printer: cooled, looked at, heated, calibrated, probed and printed. Three hours.
COLD_HOLD = 180.0
# A step, drift or scatter of a machine is stated that is none: carriage, couplings and switches are
# taken apart in vain. A day of ten hours.
WRONG_STORY = 600.0
# A change of the machine is missed: the next session shows it, and what the machine, a little off,
# has made since is measured again. A quarter of a day.
MISSED_CHANGE = 150.0
# A cause is mentioned as not excluded: its name is read, in five seconds.
MENTION = 5.0 / 60.0

# A session begins: stands are fetched, the machine is stopped and warmed up.
SITTING = 30.0
# An answer is still open after a measurement: somebody comes back for it, a shift later.
STILL_OPEN = 480.0

# Sound sessions for one that is questioned in vain, ten years of one a day: who is questioned more
# often learns to press Return.
SESSIONS_A_QUESTION = 2500.0

# Probability relative to the answer below which one that contradicts it is dismissed: to keep it
# open would cost more than to be wrong.
DISMISSED = OPEN_ANSWER / WRONG_NAME


def is_dismissed(probability: float, missed: float) -> bool:
    """Return whether to keep something open costs more than to miss it [minutes]."""
    return probability * missed < OPEN_ANSWER


def is_likely(nothing: float, missed: float, needless: float) -> bool:
    """Return whether to miss something costs more than a needless search [minutes].

    `nothing` is the probability that there is nothing.
    """
    return (1.0 - nothing) * missed >= nothing * needless


def state(
    belief: Mapping[Key, float], nothing: Key, missed: float, needless: float
) -> tuple[Key, tuple[Key, ...]]:
    """The statement of least expected loss, and what it leaves open, most probable first.

    Something has happened, or the hypothesis `nothing` is stated: by the losses of `is_likely`.
    """
    others = sorted(belief, key=lambda key: -belief[key])
    stated, lost = nothing, missed
    if is_likely(belief[nothing], missed, needless):
        stated, lost = next(key for key in others if key != nothing), needless
    others.remove(stated)
    return stated, tuple(key for key in others if not is_dismissed(belief[key], lost))


def surprising(odds: float, missed: float, needless: float) -> float:
    """The p value below which its null hypothesis is no longer stated.

    A p value is worth odds of at most 1 : −e p ln p against what it was computed under (Sellke,
    Bayarri and Berger, The American Statistician 55 (2001), p. 62). `odds` are those of the
    contrary beforehand; the null hypothesis may be stated wrongly (`missed`), or given up wrongly
    (`needless`): odds · missed < needless.
    """
    from scipy.special import lambertw

    return math.exp(lambertw(-odds * missed / needless / math.e, -1).real)
