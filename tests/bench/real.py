"""`python -m tests.bench.real FOLDER`: what the program says of real printers, date by date.

The files are the user's and stay where they are: each folder in FOLDER is a machine; of files that
lie in FOLDER itself those are one machine whose names differ in a date only. Their order is that of
their names; of identical files the first counts. Every stored measurement is diagnosed; every mesh
is predicted from the one before and the one after it with its calibrated parameters fitted again,
as here, and by the firmware's own further freedom, three arms, which is computed here by the
independent truth. Two processes share the machines.
"""

import argparse
import hashlib
import itertools
import json
import multiprocessing
import os
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from orthoglide_cal.errors import OrthocalError
from orthoglide_cal.estimation.arms import free_arms
from orthoglide_cal.files.input import Input, read_input
from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.model.linear_delta import LinearDelta, ProbePlan
from orthoglide_cal.report.case import Case
from orthoglide_cal.results.making import answer_to
from tests.bench import ONE_CORE
from tests.truth.delta import Delta, Floats, Truth, touches

Found = dict[str, Any]
DATE = re.compile(r"[-_. ]?(19|20)\d\d-?\d\d-?\d\d([-_T ]?\d{4,6})?")
DATA = ("calibration", "mesh")
STEP = 1e-4  # mm, deg
LASTING = ("radius", "angle_a", "angle_b")


def covered(judged: Sequence[Found], names: Sequence[str]) -> tuple[int, int]:
    """Of parameters at two dates: how many agree to within both U, and how many there are."""
    pairs = [
        (one["parameters"][name], other["parameters"][name])
        for one, other in itertools.combinations(judged, 2)
        if one["data"] == other["data"]
        for name in names
        if name in one["parameters"] and name in other["parameters"]
    ]
    agree = [abs(value - then) <= np.hypot(u, u_then) for (value, u), (then, u_then) in pairs]
    return sum(agree), len(pairs)


def machines(folder: Path) -> Iterator[tuple[str, list[Path]]]:
    """Name and files of each, in the order of their names."""
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        if path.is_dir():
            found[path.name] = sorted(each for each in path.rglob("*") if each.is_file())
        elif path.suffix.lower() != ".md":
            found.setdefault(DATE.sub("", path.stem) or path.stem, []).append(path)
    for name, paths in found.items():
        known = {hashlib.sha256(path.read_bytes()).digest(): path for path in reversed(paths)}
        yield name, sorted(known.values())


def micrometres(value: float | None) -> float | None:
    return None if value is None else round(1e3 * value, 1)


def answered(path: Path, data: str, later: Path | None = None) -> Found:
    """The answer as `diagnose --json` has it, without what nothing here shows.

    Other data of the same file are judged by themselves.
    """
    try:
        given = replace(free_arms(read_input(str(path), stored=data)), others=())
        known: dict[str, Any] = {}
        if later:
            held = free_arms(read_input(str(later), stored=data))
            known = {"holdout": held.measured, "then": held.model, "recalibrated": True}
        diagnosis = diagnose(given.measured, given.model, **known)
        return Case(given, answer_to(given, diagnosed=diagnosis)).data()
    except OrthocalError as error:
        return {"error": str(error)}


def judge(path: Path, data: str) -> Found:
    """What is said of one measurement; lengths in µm, but for the parameters."""
    said = answered(path, data)
    if "error" in said:
        error = str(said["error"]).removeprefix(f"{path}: ")
        return {"file": path.name, "data": data, "error": error, "parameters": {}}
    causes, rms = said["causes"], said["rms"]
    before, after = (
        causes[0][f"rms_{when}_mm"] if causes else rms["after_mm"] for when in ("before", "after")
    )
    return {
        "file": path.name,
        "data": data,
        "verdict": said["verdict"],
        "named": ["+".join(each["ids"]) or "nothing" for each in said["explanations"]][:3],
        "fit_before": micrometres(before),
        "fit_after": micrometres(after),
        "readings": said["input"]["readings"],
        # Name -> what it really is, and U; of those that are determined [mm, deg].
        "parameters": {
            each["name"]: (each["active"] + each["found"], each["expanded"])
            for each in said["parameters"]
            if each["determined"]
        },
    }


def predict(first: Path, second: Path, data: str) -> Found:
    """The second date predicted from the first; µm r.m.s., parameters fitted again."""
    pair: Found = {"first": first.name, "second": second.name, "data": data}
    said = answered(first, data, second)
    if "error" in said:
        return {**pair, "error": str(said["error"])}
    others = said.get("baselines")
    if others:
        names = ("parameters", "extension", "quartic", "earlier_map")
        values = (micrometres(others[f"{name}_mm"]) for name in names)
        pair.update(zip(("before", "after", *names[2:]), values, strict=True))
        pair["repeats"] = others["repeats"] and round(others["repeats"], 2)
    inputs = (read_input(str(path), stored=data) for path in (first, second))
    return {**pair, "arms": micrometres(with_arms(*inputs))}


def ratio(pair: Found) -> float | None:
    """What the extension leaves, by the better of the two baselines."""
    others = [pair[name] for name in ("quartic", "earlier_map") if pair.get(name)]
    return pair["after"] / min(others) if pair.get("after") and others else None


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
    found = []
    for data in DATA:
        try:
            read = read_input(str(path), stored=data).measured
        except OrthocalError:
            continue
        found += [data] if read.source.excerpt else []
    return found


def judge_machine(named: tuple[str, list[Path]]) -> Found:
    """One machine: its measurements, and their predictions of each other."""
    name, paths = named
    own = {data: [path for path in paths if data in stores(path)] for data in DATA}
    judged = [judge(path, data) for data in DATA for path in own[data]]
    pairs = [
        predict(*two, "mesh")
        for pair in itertools.pairwise(own["mesh"])
        for two in (pair, pair[::-1])
    ]
    print(f"{name}: {len(paths)} files", file=sys.stderr, flush=True)
    return {"name": name, "judged": judged, "pairs": pairs}


def bench(folder: Path) -> list[Found]:
    """Every machine of a folder; a process each on one core."""
    os.environ.update(ONE_CORE)  # read by the libraries of a new process
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        return list(pool.map(judge_machine, machines(folder)))


def columns(header: str, rows: Iterable[Sequence[object]]) -> str:
    """Columns as wide as they need; names of columns are separated by commas."""
    cells = (["" if cell is None else str(cell) for cell in row] for row in rows)
    lines = [header.split(","), *cells]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join((line[0].ljust(widths[0]), *map(str.rjust, line[1:], widths[1:])))
        for line in lines
    )


def table(found: Sequence[Found]) -> str:
    judged = [
        (machine["name"], each["file"], each["data"], each.get("readings"),
         each.get("verdict") or f"refused: {each['error']}", " ".join(each.get("named", ())),
         f"{each.get('fit_before')} -> {each.get('fit_after')}")
        for machine in found
        for each in machine["judged"]
    ]  # fmt: skip
    pairs = [(pair, ratio(pair)) for machine in found for pair in machine["pairs"]]
    names = ("first", "second", "before", "after", "quartic", "earlier_map", "arms", "repeats")
    predicted = [(*map(pair.get, names), share and round(share, 2)) for pair, share in pairs]
    parts = [
        columns("machine,file,data,readings,verdict,explanations,fit in µm", judged),
        columns("from,to,before,after,quartic,earlier map,arms,r,ratio", predicted),
    ]
    ratios = [share for _, share in pairs if share is not None]
    if ratios:
        parts.append(
            f"{len(ratios)} predictions; extension by the better baseline: median"
            f" {np.median(ratios):.2f}, at most 1.0 in {sum(r <= 1.0 for r in ratios)}."
        )
    for words, own in (("radius and angles", LASTING), ("endstops", tuple("abc"))):
        counts = [covered(machine["judged"], own) for machine in found]
        inside, every = np.sum(counts, axis=0).tolist()
        parts.append(f"Of {every} {words} on two dates {inside} agree to within their U.")
    return "\n\n".join(parts)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.real", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", type=Path, help="file to write everything to")
    given = parser.parse_args(arguments)
    found = bench(given.folder)
    print(table(found))
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
