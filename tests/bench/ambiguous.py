"""Ambiguous sessions, and whether the measurement that is recommended decides them.

The truth goes on measuring at the same machine exactly what is recommended; both records are
written to one file, read and diagnosed as any other.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from itertools import product

import numpy as np

from orthoglide_cal.inference import Diagnosis, NextMeasurement, Verdict, diagnose
from orthoglide_cal.model.readings import GaugePlan
from orthoglide_cal.planning import rank_measurements
from tests.inference.sessions import known
from tests.truth import Gauge, Machine, Session, continue_session, make_session, separation
from tests.truth.separation import STANDS_OUT

from .cases import SLOW, SLOW_PACE
from .scoring import showing


@dataclass(frozen=True, eq=False)
class Ambiguous:
    """A session of which something that matters is open, and what is to be measured next."""

    session: Session
    found: Diagnosis
    following: tuple[NextMeasurement, ...]

    @property
    def pair(self) -> tuple[str, str]:
        """What is accepted, and what it cannot be told from, or what beside it would not show."""
        accepted = "+".join(sorted(cause.id for cause in self.found.causes))
        unshown = (fault.id for fault in self.found.unshown if fault.matters)
        return accepted, ", ".join(sorted({*self.found.ambiguous_with, *unshown}))

    @property
    def recommended(self) -> NextMeasurement | None:
        """The best; None where no measurement tells anything of what is open."""
        best = self.following[0]
        return best if best.between else None


def continued(session: Session, option: NextMeasurement, seed: int) -> Session:
    """The session with an option measured by the truth."""
    names = {item.name for item in fields(GaugePlan)} - {"contact", "setup", "date", "precision"}
    return continue_session(session, seed, **{name: getattr(option.plan, name) for name in names})


def joined_diagnosis(session: Session, option: NextMeasurement, seed: int) -> Diagnosis:
    """What is said of a session together with an option, measured by the truth."""
    return diagnose(*known(continued(session, option, seed)))


def is_named(session: Session, found: Diagnosis) -> bool:
    """Whether causes are named, all of them real, none is left out that shows, and none is to be
    looked for that would not show."""
    named = {cause.id for cause in found.causes}
    return is_decided(found) and hidden_and_showing(session) <= named <= set(session.causes)


def is_decided(found: Diagnosis) -> bool:
    """Whether causes are named, and nothing stays open on which the offsets depend."""
    return found.verdict is Verdict.NAMED and not any(fault.matters for fault in found.unshown)


def is_answered(session: Session, found: Diagnosis) -> bool:
    """The same, each cause under its own name or one that stands for it.

    A knock that leaves one reading before it, or one after it where the stand is gone, is one wrong
    reading: the record is the same, whatever is read later, and so is what is to be done. It is
    named `misread`, which holds of both, with `stand_shift` as its alias. Counted by the id alone
    such a name is wrong as often as it was a knock.
    """
    said = [{cause.id, *cause.aliases} for cause in found.causes]
    hidden = set(session.causes)
    real = all(names & hidden for names in said)
    return is_decided(found) and real and hidden_and_showing(session) <= set().union(*said)


def hidden_and_showing(session: Session) -> set[str]:
    """The hidden causes without which the others would be far from the record."""
    return showing(session.causes, separation(session).distances, STANDS_OUT)


def draw(
    seed: int, hidden: Iterable[tuple[str, ...]], count: int, machines: Iterable[Machine],
    gauges: Sequence[Gauge],
) -> Iterator[Ambiguous]:  # fmt: skip
    """Those of `count` sessions per set of hidden causes, machine and gauge that are not decided:
    they are ambiguous, or what would not show beside the named causes would change the offsets."""
    for machine, gauge, causes, n in product(machines, gauges, hidden, range(count)):
        slow = len(causes) == 1 and causes[0] in SLOW and n % 2
        pace = SLOW_PACE if slow else 0.4
        session = make_session(100_000 * seed + n, machine, gauge, causes, pace=pace)
        found = diagnose(*known(session))
        if found.verdict is Verdict.AMBIGUOUS or any(fault.matters for fault in found.unshown):
            yield Ambiguous(session, found, rank_measurements(found))


@dataclass
class Tally:
    """How often the recommendation decides, and one from the bottom half of the ranking.

    Counted are sessions that are `asked` to go on, those that end `named` (the right name, and
    nothing open) or `answered` (see `is_answered`), those that the `bottom` option names, and
    `silent` ones: nothing is recommended, because nothing would tell.
    """

    counts: Counter[str] = field(default_factory=Counter)
    chance: float = 0.0
    """Sum of what the program foretells."""

    def share(self, what: str = "named") -> float:
        """Of the recommendations."""
        return self.counts[what] / self.counts["asked"]

    def __str__(self) -> str:
        asked, silent = self.counts["asked"], self.counts["silent"]
        return (
            f"{asked} recommendations: {self.share():.1%} lead to the right name,"
            f" {self.share('answered'):.1%} to the right answer under any of its names (foretold"
            f" {self.chance / asked:.1%}), {self.share('bottom'):.1%} from the bottom half name it;"
            f" {silent} sessions without one: no reading can tell. Of all that is ambiguous, these"
            f" included, {self.counts['named'] / (asked + silent):.1%} end in the right name"
        )


def tally(cases: Iterable[Ambiguous], seed: int) -> Tally:
    """Let the truth measure what is recommended, and an option drawn from the bottom half."""
    found = Tally()
    rng = np.random.default_rng([seed, 6])
    for n, case in enumerate(cases):
        best, ranking = case.recommended, case.following
        if best is None:
            found.counts["silent"] += 1
            continue
        low = ranking[int(rng.integers(len(ranking) // 2, len(ranking)))]
        found.chance += best.chance
        after, bottom = (joined_diagnosis(case.session, each, n) for each in (best, low))
        named = is_named(case.session, after)
        answered, worse = is_answered(case.session, after), is_named(case.session, bottom)
        found.counts.update(asked=1, named=named, answered=answered, bottom=worse)
        if not named:
            said = [(each.id, *each.aliases) for each in after.causes], after.ambiguous_with
            said = *said, [fault.id for fault in after.unshown if fault.matters]
            what = f"{best.what} ({best.chance:.2f})"
            print(f"{case.session.label} {case.pair}: {what}; then {said}")
    return found
