"""`python -m tests.journeys`: how far four journeys lead through the package.

Each journey is one command, run in a process of its own in which every module is already
imported, so that only its own work is counted. Counted is every call of a Python function that a
module of the package defines, in the order of the calls:

rooms      the folders of the package entered; a module beside them is a room of its own;
files      the files entered; methods that dataclasses generate belong to none and count as one
           more file together;
functions  the different names entered, per file;
changes    consecutive calls that lie in different rooms.

With a journey's name, `python -m tests.journeys measure`, also where its changes happen.
"""

import contextlib
import importlib
import io
import itertools
import multiprocessing
import os
import pkgutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType
from unittest import mock

import orthoglide_cal
from orthoglide_cal.cli import main as program

PACKAGE = orthoglide_cal.__name__
SAMPLES = Path(__file__).parents[1] / "sample_data"
# "{out}" is a folder that is empty at the start.
JOURNEYS = {
    "solve": ("CSV → `solve` answer", "solve", "--json", f"{SAMPLES}/double_posture_session.csv"),
    "diagnose": ("session → `diagnose` verdict", "diagnose", "--json", f"{SAMPLES}/session.yaml"),
    "measure": (
        "60 readings in a simulated `measure`",
        *("measure", "{out}/session.yaml", "--gauge", "simulated", "--seed", "1"),
    ),
    "report": (
        "session → HTML page",
        *("report", f"{SAMPLES}/session.yaml", "--html", "{out}/report.html"),
    ),
}


@dataclass(frozen=True)
class Journey:
    """What one journey entered.

    Attributes:
        title: in words.
        rooms, files, functions: how many different ones.
        changes: from room to room → how often.
        entered: room → how many calls.
    """

    title: str
    rooms: int
    files: int
    functions: int
    changes: Counter[tuple[str, str]]
    entered: Counter[str]


def room_of(module: str) -> str:
    """Second part of a dotted name; the package itself is the room ""."""
    return [*module.split("."), ""][1]


def calls_of(run: Callable[[], None]) -> list[tuple[str, CodeType]]:
    """(module, code) of every call of a function of the package, in order."""
    calls: list[tuple[str, CodeType]] = []

    def enter(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            module = str(frame.f_globals.get("__name__"))
            if module == PACKAGE or module.startswith(f"{PACKAGE}."):
                calls.append((module, frame.f_code))

    sys.setprofile(enter)
    try:
        run()
    finally:
        sys.setprofile(None)
    return calls


def run_quietly(*arguments: str) -> None:
    """One command in this process, without a terminal and with nothing typed."""
    messages = io.StringIO()
    with (
        open(os.devnull, encoding="utf-8") as nothing,
        mock.patch.object(sys, "argv", ["orthocal", *arguments]),
        mock.patch.object(sys, "stdin", nothing),
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(messages),
    ):
        try:
            program()
        except SystemExit as end:
            if end.code:
                raise RuntimeError(messages.getvalue()) from end


def follow(name: str) -> Journey:
    """Take one journey, everything being imported."""
    for module in pkgutil.walk_packages(orthoglide_cal.__path__, f"{PACKAGE}."):
        if not module.name.endswith(".__main__"):
            importlib.import_module(module.name)
    title, *arguments = JOURNEYS[name]
    with tempfile.TemporaryDirectory() as out:
        calls = calls_of(lambda: run_quietly(*(w.replace("{out}", out) for w in arguments)))
    rooms = [room_of(module) for module, _ in calls]
    return Journey(
        title=title,
        rooms=len(set(rooms)),
        files=len({code.co_filename for _, code in calls}),
        functions=len({(code.co_filename, code.co_name) for _, code in calls}),
        changes=Counter((a, b) for a, b in itertools.pairwise(rooms) if a != b),
        entered=Counter(rooms),
    )


def main() -> None:
    """Count and print."""
    wanted = sys.argv[1:]
    # No journey may profit from what another one left in a cache.
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        journeys = pool.map(follow, wanted or list(JOURNEYS), chunksize=1)
    print(f"{'':40}{'rooms':>8}{'files':>8}{'functions':>11}{'changes':>10}{'calls':>10}")
    for taken in journeys:
        print(
            f"{taken.title:40}{taken.rooms:>8}{taken.files:>8}{taken.functions:>11}"
            f"{taken.changes.total():>10,}{taken.entered.total():>10,}"
        )
    for taken in journeys if wanted else ():
        print(f"\n{taken.title}: calls by room")
        for room, count in taken.entered.most_common():
            print(f"{count:>10,}  {room}")
        print("most frequent changes")
        for (before, after), count in taken.changes.most_common(25):
            print(f"{count:>10,}  {before} → {after}")


if __name__ == "__main__":
    main()
