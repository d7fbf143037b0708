"""`python -m tests.bench.real FOLDER`: what the program says of real printers, date by date.

The files are the user's and stay where they are: each folder in FOLDER is a machine; of files that
lie in FOLDER itself those are one machine whose names differ in a date only. Their order is that of
their names. Every stored measurement is diagnosed; every date is predicted from every other one of
the same kind with its calibrated parameters fitted again, as here, and by the firmware's
own further freedom, three arms, which is computed here by the independent truth.
"""

from __future__ import annotations

import argparse
import itertools
import json
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from orthoglide_cal.cli.app import app
from orthoglide_cal.errors import OrthocalError
from orthoglide_cal.files import Input, read_input
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.probe_plan import ProbePlan
from tests.truth.delta import Delta, Floats, Truth, touches

DATE = re.compile(r"[-_. ]?(19|20)\d\d-?\d\d-?\d\d([-_T ]?\d{4,6})?")
DATA = ("calibration", "mesh")
STEP = 1e-4  # mm, deg
LASTING = ("radius", "angle_a", "angle_b")


@dataclass
class Judged:
    """What is said of one measurement; lengths in µm, but for the parameters."""

    file: str
    data: str
    verdict: str | None = None
    named: list[str] = field(default_factory=list)
    fit_before: float | None = None
    fit_after: float | None = None
    readings: int | None = None
    error: str | None = None
    parameters: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Name -> what it really is, and U; of those that are determined [mm, deg]."""


@dataclass
class Pair:
    """A date predicted from another one; µm r.m.s., parameters fitted again."""

    first: str
    second: str
    data: str
    before: float | None = None
    after: float | None = None
    quartic: float | None = None
    earlier_map: float | None = None
    repeats: float | None = None
    arms: float | None = None
    error: str | None = None

    @property
    def ratio(self) -> float | None:
        """What the extension leaves, by the better of the two baselines."""
        others = [each for each in (self.quartic, self.earlier_map) if each]
        return self.after / min(others) if self.after and others else None


@dataclass
class Machine:
    """A printer, its measurements, and their predictions of each other."""

    name: str
    judged: list[Judged] = field(default_factory=list)
    pairs: list[Pair] = field(default_factory=list)

    def covered(self, names: Sequence[str]) -> tuple[int, int]:
        """Of parameters at two dates: how many agree to within both U, and how many there are."""
        apart = [
            abs(one.parameters[name][0] - other.parameters[name][0])
            <= np.hypot(one.parameters[name][1], other.parameters[name][1])
            for one, other in itertools.combinations(self.judged, 2)
            if one.data == other.data
            for name in names
            if name in one.parameters and name in other.parameters
        ]
        return sum(apart), len(apart)


def machines(folder: Path) -> Iterator[tuple[str, list[Path]]]:
    """Name and files of each, in the order of their names."""
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        if path.is_dir():
            found[path.name] = sorted(each for each in path.rglob("*") if each.is_file())
        elif path.suffix.lower() != ".md":
            found.setdefault(DATE.sub("", path.stem) or path.stem, []).append(path)
    yield from found.items()


def answered(*words: str) -> dict[str, object]:
    """The object that the program prints."""
    result = CliRunner().invoke(app, [*words, "--json"])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    lines = result.stdout.splitlines()
    return dict(json.loads(lines[-1])) if lines else {"error": result.stderr.strip()}


def micrometres(value: float | None) -> float | None:
    return None if value is None else round(1e3 * value, 1)


def judge(path: Path, data: str) -> Judged:
    """The diagnosis of one measurement."""
    said = answered("diagnose", str(path), "--data", data)
    found = Judged(path.name, data)
    if "error" in said:
        found.error = str(said["error"]).removeprefix(f"{path}: ")
        return found
    found.verdict, rms = str(said["verdict"]), said["rms"]
    found.named = ["+".join(each["ids"]) or "nothing" for each in said["explanations"]][:3]
    causes = said["causes"]
    fit = [
        causes[0][f"rms_{when}_mm"] if causes else rms["after_mm"] for when in ("before", "after")
    ]
    found.fit_before, found.fit_after = map(micrometres, fit)
    found.readings = said["input"]["readings"]
    found.parameters = {
        each["name"]: (each["active"] + each["found"], each["expanded"])
        for each in said["parameters"]
        if each["determined"]
    }
    return found


def predict(first: Path, second: Path, data: str) -> Pair:
    """The second date predicted from the first."""
    pair = Pair(first.name, second.name, data)
    words = (str(first), "--data", data, "--holdout", str(second), "--recalibrated")
    said = answered("diagnose", *words)
    if "error" in said:
        pair.error = str(said["error"])
        return pair
    others = said.get("baselines")
    if others:
        pair.before, pair.after, pair.quartic, pair.earlier_map = (
            micrometres(others[f"{name}_mm"])
            for name in ("parameters", "extension", "quartic", "earlier_map")
        )
        pair.repeats = others["repeats"] and round(others["repeats"], 2)
    inputs = (read_input(str(path), stored=data) for path in (first, second))
    pair.arms = micrometres(with_arms(*inputs))
    return pair


def with_arms(first: Input, second: Input) -> float:
    """What is left of the second date's touches with the arms of the first [mm r.m.s.]."""
    (own, read), (then, later) = map(_columns, (first, second))
    arms = np.linalg.lstsq(own, read)[0][-3:]
    left = later - then[:, -3:] @ arms
    left -= then[:, :-3] @ np.linalg.lstsq(then[:, :-3], left)[0]
    return float(np.sqrt(np.mean(left**2)))


def _columns(given: Input) -> tuple[Floats, Floats]:
    """Derivatives of touches by endstops, radius, two angles, arms, (n, 9), and readings (n,)."""
    known, plan = LinearDelta.require(given.model.machine), ProbePlan.require(given.measured.plan)
    machine = Delta(
        "real", known.arm_length_mm, known.delta_radius_mm, known.tower_angles_deg,
        tuple(known.endstops_mm), known.bed_radius_mm,
    )  # fmt: skip
    touch = ~plan.distance
    x, y, high = (*plan.place[touch, :2].T, plan.surface[touch])

    def probed(values: Floats) -> Floats:
        truth = Truth(
            endstops=values[:3], radius=float(values[3]), angles=np.append(values[4:6], 0.0),
            arms=values[6:],
        )  # fmt: skip
        return touches(machine, truth, x, y, high, 0.0 * high)

    nothing = probed(np.zeros(9))
    columns = [(probed(STEP * unit) - nothing) / STEP for unit in np.eye(9)]
    return np.stack(columns, axis=1), given.measured.value[touch]


def stores(path: Path) -> list[str]:
    """What of a file can be read."""
    found = []
    for data in DATA:
        try:
            read = read_input(str(path), stored=data).measured
        except OrthocalError:
            continue
        found += [data] if read.source.excerpt else []
    return found


def bench(folder: Path) -> list[Machine]:
    """Every machine of a folder."""
    found = []
    for name, paths in machines(folder):
        machine = Machine(name)
        print(f"{name}: {len(paths)} files", file=sys.stderr, flush=True)
        for data in DATA:
            own = [path for path in paths if data in stores(path)]
            machine.judged += [judge(path, data) for path in own]
            if data == "mesh":
                machine.pairs += [predict(*two, data) for two in itertools.permutations(own, 2)]
        found.append(machine)
    return found


def table(found: Sequence[Machine]) -> str:
    """All of it, as Markdown."""
    lines = ["| machine | file | data | readings | verdict | explanations | fit, µm |"]
    lines += ["|" + "---|" * 7]
    for machine in found:
        for each in machine.judged:
            fit = f"{each.fit_before} -> {each.fit_after}"
            said = each.verdict or f"refused: {each.error}"
            row = (machine.name, each.file, each.data, each.readings, said, ", ".join(each.named))
            lines.append(f"| {' | '.join(map(str, row))} | {fit} |")
    lines += ["", "| from | to | before | after | quartic | earlier map | arms | ratio | r |"]
    lines += ["|" + "---|" * 9]
    pairs = [pair for machine in found for pair in machine.pairs]
    for pair in pairs:
        ratio = None if pair.ratio is None else round(pair.ratio, 2)
        numbers = (pair.before, pair.after, pair.quartic, pair.earlier_map, pair.arms, ratio)
        row = (pair.first, pair.second, *numbers, pair.repeats)
        lines.append(f"| {' | '.join('' if v is None else str(v) for v in row)} |")
    ratios = [pair.ratio for pair in pairs if pair.ratio is not None]
    if ratios:
        lines.append(
            f"\n{len(ratios)} predictions; extension by the better baseline: median"
            f" {np.median(ratios):.2f}, at most 1.0 in {sum(r <= 1.0 for r in ratios)}."
        )
    for words, names in (("radius and angles", LASTING), ("endstops", tuple("abc"))):
        inside, every = np.sum([machine.covered(names) for machine in found], axis=0).tolist()
        lines.append(f"Of {every} {words} on two dates {inside} agree to within their U.")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.real", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", type=Path, help="file to write everything to")
    given = parser.parse_args(arguments)
    found = bench(given.folder)
    print(table(found))
    if given.json:
        given.json.write_text(json.dumps([asdict(each) for each in found], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
