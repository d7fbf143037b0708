"""One blind bench: groups of sessions, one call of the program for each, and the judgement."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.truth import Gauge, Machine

from .accuracy import HeldOut, another_day
from .cases import Case, Counts, draw_group
from .run import diagnose, folder, write_group
from .scoring import Judged, judge


@dataclass(frozen=True)
class Group:
    """All sessions of one machine and gauge, judged."""

    machine: str
    gauge: str
    judged: tuple[Judged, ...]
    cpu_seconds: float
    later: tuple[HeldOut, ...]
    """Predictions of second sessions."""

    @property
    def per_second(self) -> float:
        """Sessions per second of processor time."""
        return len(self.judged) / max(self.cpu_seconds, 1e-9)


@dataclass(frozen=True)
class Setting:
    """What to draw and how to judge."""

    counts: Counts
    seed: int = 1
    by: str = "distance"
    holdouts: int = 0
    """Second sessions per cause and group."""
    keep: Path | None = None
    """Folder in which the records, truths and answers stay."""


def run_group(machine: Machine, gauge: Gauge, setting: Setting) -> Group:
    """Draw, ask and judge one group."""
    cases: list[Case] = list(draw_group(machine, gauge, setting.counts, setting.seed))
    keep = setting.keep / f"{machine.name}-{gauge.name}" if setting.keep else None
    with folder(keep) as where:
        files = write_group(where, machine, gauge, [(case.name, case.session) for case in cases])
        run = diagnose(where, files)
        if keep is not None:
            truths = (json.dumps({"name": c.name, **c.session.truth()}) for c in cases)
            (where / "truths.jsonl").write_text("\n".join(truths) + "\n", encoding="utf-8")
            (where / "answers.jsonl").write_text(run.output, encoding="utf-8")
        judged = judge(cases, run.answers, setting.by)
        later = another_day(where, judged, setting.holdouts, setting.seed)
    return Group(machine.name, gauge.name, tuple(judged), run.cpu_seconds, tuple(later))


def run_bench(
    machines: Sequence[Machine],
    gauges: Sequence[Gauge],
    setting: Setting,
    report: Callable[[str], None] = lambda text: None,
) -> list[Group]:
    """Run every combination; `report` is told which one begins."""
    groups = []
    for machine in machines:
        for gauge in gauges:
            report(f"{machine.name} with the {gauge.name} gauge …")
            groups.append(run_group(machine, gauge, setting))
    return groups
