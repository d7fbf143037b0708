"""The sessions of one bench: drawn from a seed, each with its truth and its distance to rivals."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product

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
from tests.truth.delta import KOSSEL, V400, Delta, DeltaSession, Layout, make_delta_session
from tests.truth.delta_separation import (
    DELTA_CAUSES,
    DELTA_OUTSIDE,
    DELTA_PAIRS,
    GRAIN,
    clear_delta_outside,
    delta_separation,
)

SLOW = ("gauge_drift", "thermal_drift")
SLOW_PACE = 2.5
"""[min] per posture of every second session with a slow cause: at 0.4 min a plausible creep stays
below the gauge's noise, and a bench of nothing but invisible effects would prove nothing."""

THREE = (0.0, 25.0, 50.0)
"""Heights of the blocks under the probe of a printer."""
LAYOUTS = (
    Layout(41), Layout(121), Layout(25, THREE), Layout(7), Layout(13, THREE), Layout(41, THREE),
    Layout(25, cycles=3), Layout(400),
)  # fmt: skip
SHAPED = 9
"""Places from which anything may be said of a bed's shape: three for each of its square terms."""
MANY = 25
"""Places from which an effect outside the list can be told from two causes."""
NOISES = (0.005, 0.013, 0.030)
PRINTERS = (V400, replace(KOSSEL, texture=0.005))
"""A plate with foil and magnets, and a glass."""

SHAPES = {"bed_shape", "tower_lean"}
"""At one height they show the same; which sizes are the more plausible is no evidence."""

KINDS = ("distinct", "close", "faint", "healthy", "outside", "pair", "half pair")


@dataclass(frozen=True)
class Counts:
    """How many sessions are drawn: of each machine with each gauge, or of all printers together."""

    single: int
    """Per cause."""
    healthy: int
    outside: int
    """Per kind of effect outside the list."""
    pair: int
    """Per combination of a cause of the measurement and one of the machine."""
    largest: int = 400
    """No layout of a printer has more places."""


FULL = Counts(single=20, healthy=125, outside=5, pair=2)
FULL_PRINTERS = Counts(single=48, healthy=240, outside=14, pair=7)


@dataclass(frozen=True, eq=False)
class Case:
    """One session of the bench."""

    name: str
    """Unique; the name of its file without the ending."""
    session: Session | DeltaSession
    separation: Separation | None
    """None for healthy and outside sessions."""

    @property
    def kind(self) -> str:
        """What is asked of the answer: one of `KINDS`.

        `distinct`: every rival and the healthy machine are as far away as the separation's bound.
        `close`: some rival is nearer, or a shape is seen from one height. `faint`: the healthy
        machine itself is nearer, so that `consistent` is right too. `pair`: no single cause is
        nearer; `half pair`: one is.
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
        flat = isinstance(self.session, DeltaSession) and len(self.session.layout.heights) < 2
        clear = self.separation.distance >= bound and not (flat and {*self.session.causes} & SHAPES)
        return "distinct" if clear else "close"


def draw_gauges(
    machines: Sequence[Machine], gauges: Sequence[Gauge], counts: Counts, seed: int
) -> Iterator[Case]:
    """Sessions of every machine with every gauge; `seed` fixes them."""
    base = 100_000 * seed
    for machine, gauge in ((machine, gauge) for machine in machines for gauge in gauges):
        end = f"-{machine.name}-{gauge.name}"
        for n in range(counts.healthy):
            yield Case(f"healthy-{n:03d}{end}", make_session(base + n, machine, gauge), None)
        for outside, n in product(OUTSIDE, range(counts.outside)):
            session = clear_outside(base + n, machine, gauge, outside)
            yield Case(f"outside-{outside}-{n:03d}{end}", session, None)
        singles = product([(cause,) for cause in CAUSES], range(counts.single))
        for hidden, n in chain(singles, product(all_pairs(), range(counts.pair))):
            pace = SLOW_PACE if hidden[0] in SLOW and len(hidden) == 1 and n % 2 else 0.4
            session = make_session(base + n, machine, gauge, hidden, pace=pace)
            yield Case(f"{'-'.join(hidden)}-{n:03d}{end}", session, separation(session))


def draw_printers(counts: Counts, seed: int) -> Iterator[Case]:
    """Sessions over noises, printers and layouts in turn; `seed` fixes them.

    The local shape of the bed is drawn as the machine file states it.
    """
    settings: list[tuple[Delta, Layout]] = [
        (replace(machine, noise=noise), layout)
        for noise in NOISES
        for machine in PRINTERS
        for layout in LAYOUTS
        if layout.places <= counts.largest
    ]
    base = 100_000 * seed

    def drawn(number: int, n: int, hidden: tuple[str, ...]) -> DeltaSession:
        # Every cause meets other settings first.
        least = SHAPED if "bed_shape" in hidden else 0
        able = [setting for setting in settings if setting[1].places >= least]
        machine, layout = able[(7 * number + n) % len(able)]
        bumps = machine.texture, GRAIN
        return make_delta_session(base + n, machine, hidden, layout, bumps)

    for n in range(counts.healthy):
        yield Case(f"healthy-{n:03d}", drawn(0, n, ()), None)
    for outside, (_, heights) in DELTA_OUTSIDE.items():
        able = [(printer, layout) for printer, layout in settings
                if layout.places >= MANY and len(layout.heights) >= heights]  # fmt: skip
        for n in range(counts.outside):
            session = clear_delta_outside(base + n, *able[n % len(able)], outside)
            yield Case(f"outside-{outside}-{n:03d}", session, None)
    singles = product(enumerate((cause,) for cause in DELTA_CAUSES), range(counts.single))
    pairs = product(enumerate(DELTA_PAIRS), range(counts.pair))
    for (number, hidden), n in chain(singles, pairs):
        session = drawn(number, n, hidden)
        yield Case(f"{'-'.join(hidden)}-{n:03d}", session, delta_separation(session))
