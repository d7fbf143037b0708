"""The sessions of one bench: drawn from a seed, each with its truth and its distance to rivals."""

from collections.abc import Iterator
from dataclasses import dataclass

from tests.truth import (
    CAUSES,
    OUTSIDE,
    Gauge,
    Machine,
    Separation,
    Session,
    all_pairs,
    clear_outside,
    make_session,
    separation,
)

SLOW = ("gauge_drift", "thermal_drift")
SLOW_PACE = 2.5
"""[min] per posture of every second session with a slow cause: at 0.4 min a plausible creep stays
below the gauge's noise, and a bench of nothing but invisible effects would prove nothing."""

KINDS = ("distinct", "close", "faint", "healthy", "outside", "pair", "half pair")


@dataclass(frozen=True)
class Counts:
    """How many sessions one (machine, gauge) group draws."""

    single: int = 20
    """Per cause."""
    healthy: int = 125
    outside: int = 5
    """Per kind of effect outside the list."""
    pair: int = 2
    """Per combination of a measurement and a machine cause."""


@dataclass(frozen=True, eq=False)
class Case:
    """One session of the bench."""

    name: str
    """Unique in its group; the name of its file without the ending."""
    session: Session
    separation: Separation | None
    """None for healthy and outside sessions."""

    def kind(self, by: str = "distance") -> str:
        """What is asked of the answer: one of `KINDS`.

        `distinct`: every rival and the healthy machine are as far away as the separation's bound.
        `close`: some rival is nearer. `faint`: the healthy machine itself is nearer, so that
        `consistent` is right too. `pair`: no single cause is nearer; `half pair`: one is.

        Args:
            by: `distance` to the rivals' best fits, or `margin` over the truth's own fit.
        """
        if self.session.outside is not None:
            return "outside"
        if self.separation is None:
            return "healthy"
        bound = self.separation.bound
        if len(self.session.causes) == 2:
            return "pair" if self.separation.distance >= bound else "half pair"
        if self.separation.visible < bound:
            return "faint"
        far = self.separation.margin if by == "margin" else self.separation.distance
        return "distinct" if far >= bound else "close"


def draw_group(machine: Machine, gauge: Gauge, counts: Counts, seed: int) -> Iterator[Case]:
    """Draw all sessions of one machine and gauge; `seed` fixes them."""
    base = 100_000 * seed
    for n in range(counts.healthy):
        yield Case(f"healthy-{n:03d}", make_session(base + n, machine, gauge), None)
    for cause in CAUSES:
        for n in range(counts.single):
            pace = SLOW_PACE if cause in SLOW and n % 2 else 0.4
            session = make_session(base + n, machine, gauge, (cause,), pace=pace)
            yield Case(f"{cause}-{n:03d}", session, separation(session))
    for outside in OUTSIDE:
        for n in range(counts.outside):
            session = clear_outside(base + n, machine, gauge, outside)
            yield Case(f"outside-{outside}-{n:03d}", session, None)
    for pair in all_pairs():
        for n in range(counts.pair):
            session = make_session(base + n, machine, gauge, pair)
            yield Case(f"{'-'.join(pair)}-{n:03d}", session, separation(session))
