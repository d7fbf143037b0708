"""Ambiguous sessions, and whether the measurement that is recommended decides them.

The truth goes on measuring at the same machine exactly what is recommended; both records are
written to one file, read and diagnosed as any other.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from itertools import product

import numpy as np

from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.inference.result import NextMeasurement, Verdict
from orthoglide_cal.model.readings import GaugePlan
from orthoglide_cal.planning.next_measurement import rank_measurements
from tests.inference.sessions import known
from tests.truth import Gauge, Machine, Session, continue_session, make_session, separation
from tests.truth.separation import STANDS_OUT

from .cases import SLOW, SLOW_PACE
from .scoring import showing


def continued(session: Session, option: NextMeasurement, seed: int) -> Session:
    """The session with an option measured by the truth."""
    names = {item.name for item in fields(GaugePlan)} - {"contact", "setup", "date", "precision"}
    return continue_session(session, seed, **{name: getattr(option.plan, name) for name in names})


def joined_diagnosis(session: Session, option: NextMeasurement, seed: int) -> Diagnosis:
    """What is said of a session together with an option, measured by the truth."""
    return diagnose(*known(continued(session, option, seed)))


def is_named(session: Session, found: Diagnosis, aliases: bool = False) -> bool:
    """Whether causes are named, all of them real, and nothing that shows or matters is left out.

    With `aliases` each may stand for another one. A knock that leaves one reading before it, or one
    after it where the stand is gone, is one wrong reading: the record is the same, whatever is read
    later, and so is what is to be done. It is named `misread`, which holds of both, with
    `stand_shift` as its alias. Counted by the id alone such a name is wrong as often as it was a
    knock.
    """
    if found.verdict is not Verdict.NAMED or any(fault.matters for fault in found.unshown):
        return False
    names = [{cause.id, *(cause.aliases if aliases else ())} for cause in found.causes]
    shown = showing(session.causes, separation(session).distances, STANDS_OUT)
    return all(each & {*session.causes} for each in names) and shown <= set().union(*names)


def draw(
    seed: int, hidden: Iterable[tuple[str, ...]], count: int, machines: Iterable[Machine],
    gauges: Sequence[Gauge],
) -> Iterator[tuple[Session, Diagnosis]]:  # fmt: skip
    """Those of `count` sessions per set of hidden causes, machine and gauge that are not decided:
    they are ambiguous, or what would not show beside the named causes would change the offsets."""
    for machine, gauge, causes, n in product(machines, gauges, hidden, range(count)):
        slow = len(causes) == 1 and causes[0] in SLOW and n % 2
        pace = SLOW_PACE if slow else 0.4
        session = make_session(100_000 * seed + n, machine, gauge, causes, pace=pace)
        found = diagnose(*known(session))
        if found.verdict is Verdict.AMBIGUOUS or any(fault.matters for fault in found.unshown):
            yield session, found


@dataclass
class Tally:
    """How often the recommendation decides, and one from the bottom half of the ranking.

    Counted are sessions that are `asked` to go on, those that end `named` (the right name, and
    nothing open) or `answered` (the same under any of its names), those that the `bottom` option
    names, and `silent` ones: nothing is recommended, because nothing would tell.
    """

    counts: Counter[str] = field(default_factory=Counter)
    chance: float = 0.0
    """Sum of what the program foretells."""

    def share(self, what: str = "named") -> float:
        """Of the recommendations."""
        return self.counts[what] / self.counts["asked"]


def tally(cases: Iterable[tuple[Session, Diagnosis]], seed: int) -> Tally:
    """Let the truth measure what is recommended, and an option drawn from the bottom half."""
    total = Tally()
    rng = np.random.default_rng([seed, 6])
    for n, (session, found) in enumerate(cases):
        best, *others = rank_measurements(found)
        if not best.between:
            total.counts["silent"] += 1
            continue
        ranking = [best, *others]
        low = ranking[int(rng.integers(len(ranking) // 2, len(ranking)))]
        after, bottom = (joined_diagnosis(session, each, n) for each in (best, low))
        named = is_named(session, after)
        total.chance += best.chance
        total.counts.update(
            asked=1, named=named, answered=is_named(session, after, aliases=True),
            bottom=is_named(session, bottom),
        )  # fmt: skip
        if not named:
            said = [(each.id, *each.aliases) for each in after.causes], after.ambiguous_with
            print(f"{session.label}: {best.what} ({best.chance:.2f}); then {said}")
    return total
