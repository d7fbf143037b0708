"""The blind bench of printers: sessions with a hidden truth, the answers, and their rates.

`python -m tests.bench.delta` prints them. The readings and the machine file go through files, as
those of a user; the local shape of the bed is drawn as the file states it.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from orthoglide_cal.diagnosis import diagnose
from orthoglide_cal.files import read_input, read_machine_file
from tests.truth.delta import (
    KOSSEL,
    V400,
    Delta,
    DeltaSession,
    Layout,
    delta_csv,
    delta_yaml,
    grain,
    make_delta_session,
)
from tests.truth.delta_outside import DELTA_OUTSIDE, clear_delta_outside
from tests.truth.delta_separation import DELTA_CAUSES, DELTA_PAIRS, GRAIN, delta_separation

from .answers import Answer, NamedCause
from .cases import Case
from .scoring import Judged, confusion, judge, rates
from .tables import label_table, rate_table

THREE = (0.0, 25.0, 50.0)
"""Heights of the blocks under the probe."""
LAYOUTS = (
    Layout(41),
    Layout(121),
    Layout(25, THREE),
    Layout(7),
    Layout(13, THREE),
    Layout(41, THREE),
    Layout(25, cycles=3),
    Layout(400),
)
MANY = 25
"""Places from which an effect outside the list can be told from two causes."""
NOISES = (0.005, 0.013, 0.030)
MACHINES = (V400, replace(KOSSEL, texture=0.005))
"""A plate with foil and magnets, and a glass."""


@dataclass(frozen=True)
class DeltaCounts:
    """How many sessions are drawn."""

    single: int = 48
    """Per cause."""
    healthy: int = 240
    outside: int = 14
    """Per kind of effect outside the list."""
    pair: int = 7
    """Per combination of a fault of the measurement and one of the machine."""
    largest: int = 400
    """No layout has more places."""


def _settings(counts: DeltaCounts) -> list[tuple[Delta, Layout]]:
    chosen = [layout for layout in LAYOUTS if layout.places <= counts.largest]
    return [
        (replace(machine, noise=noise), layout)
        for noise in NOISES
        for machine in MACHINES
        for layout in chosen
    ]


def _draw(seed: int, machine: Delta, hidden: tuple[str, ...], layout: Layout) -> DeltaSession:
    return make_delta_session(seed, machine, hidden, layout, (machine.texture, GRAIN), grain)


def draw(counts: DeltaCounts, seed: int) -> Iterator[Case]:
    """All sessions, over machines, layouts and noises in turn; `seed` fixes them."""
    settings, base = _settings(counts), 100_000 * seed
    for n in range(counts.healthy):
        machine, layout = settings[n % len(settings)]
        yield Case(f"healthy-{n:03d}", _draw(base + n, machine, (), layout), None)
    for number, cause in enumerate(DELTA_CAUSES):
        for n in range(counts.single):
            # Every cause meets other settings first.
            machine, layout = settings[(7 * number + n) % len(settings)]
            session = _draw(base + n, machine, (cause,), layout)
            yield Case(f"{cause}-{n:03d}", session, delta_separation(session))
    for outside, (_, heights) in DELTA_OUTSIDE.items():
        able = [
            each for each in settings if each[1].places >= MANY and len(each[1].heights) >= heights
        ]
        for n in range(counts.outside):
            session = clear_delta_outside(base + n, *able[n % len(able)], outside)
            yield Case(f"{outside}-{n:03d}", session, None)
    for number, pair in enumerate(DELTA_PAIRS):
        for n in range(counts.pair):
            machine, layout = settings[(7 * number + n) % len(settings)]
            session = _draw(base + n, machine, pair, layout)
            yield Case(f"{'-'.join(pair)}-{n:03d}", session, delta_separation(session))


def ask(where: Path, session: DeltaSession) -> Answer:
    """The answer to one session, through a machine file and a CSV."""
    machine, record = where / "machine.yaml", where / "touches.csv"
    machine.write_text(delta_yaml(session.machine), encoding="utf-8")
    record.write_text(delta_csv(session), encoding="utf-8")
    given = read_input(str(record), read_machine_file(machine).model)
    found = diagnose(given.measured, given.model)
    return Answer(
        verdict=str(found.verdict),
        causes=tuple(
            NamedCause(
                cause.id,
                cause.probability,
                tuple(cause.aliases),
                cause.heldout_before_mm,
                cause.heldout_after_mm,
                cause.heldout_ratio,
            )
            for cause in found.causes
        ),
        ambiguous_with=tuple(found.ambiguous_with),
        offsets=tuple(found.offsets_mm.tolist()),
        std=tuple(found.std_mm.tolist()),
    )


def run(counts: DeltaCounts, seed: int) -> list[Judged]:
    """Draw, ask and judge."""
    cases = list(draw(counts, seed))
    with tempfile.TemporaryDirectory() as name:
        answers = [ask(Path(name), case.session) for case in cases]
    return judge(cases, answers)


def report(judged: Sequence[Judged]) -> str:
    """Rates, what was taken for what, and the misses."""
    taken = (
        f"{label:<16}" + ", ".join(f"{name} {count}" for name, count in counts.most_common())
        for label, counts in confusion(judged).items()
    )
    missed = (_miss(item) for item in judged if not item.right)
    return "\n\n".join(
        (rate_table(rates(judged)), label_table(judged), "\n".join(taken), "\n".join(missed))
    )


def _miss(item: Judged) -> str:
    far, layout = item.case.separation, item.case.session.layout
    stands = (
        f"{far.distance:.1f} from {far.nearest}, {far.visible:.1f} from healthy, own {far.own:.1f}"
        if far
        else ""
    )
    also = ",".join(sorted(item.answer.mentioned - set(item.answer.ids)))
    return (
        f"{item.case.name} [{item.kind}] {layout.places} places, {len(layout.heights)} heights,"
        f" {layout.cycles} cycles, {1e3 * item.case.session.machine.noise:g} µm {stands}:"
        f" {item.answer.verdict} {','.join(item.answer.ids)}" + (f" (or {also})" if also else "")
    )


def main(arguments: list[str] | None = None) -> int:
    """Returns 1 if a demand is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.delta", description=__doc__)
    parser.add_argument("--sessions", type=int, default=48, help="per cause")
    parser.add_argument("--healthy", type=int, default=240)
    parser.add_argument("--outside", type=int, default=14, help="per effect outside the list")
    parser.add_argument("--pair", type=int, default=7, help="per combination")
    parser.add_argument("--largest", type=int, default=400, help="places of a layout")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    counts = DeltaCounts(given.sessions, given.healthy, given.outside, given.pair, given.largest)
    judged = run(counts, given.seed)
    print(report(judged))
    return int(not all(rate.met for rate in rates(judged)))


if __name__ == "__main__":
    sys.exit(main())
