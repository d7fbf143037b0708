"""SIGKILL after and during every single step: nothing acknowledged is lost, the result is equal."""

import os
import signal
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace

import pytest

from orthoglide_cal.files.readings import session_text
from orthoglide_cal.planning.steps import MeasuringProtocol
from orthoglide_cal.session import events as journal_module
from orthoglide_cal.session.asking import Style
from orthoglide_cal.session.dialogue import Dialogue
from orthoglide_cal.session.events import Journal, Opened, replay
from orthoglide_cal.session.gauges import SimulatedGauge

from .virtual import (
    DOUBLE,
    SINGLE,
    a_dialogue,
    answered,
    offsets,
    opened,
    setting_of,
    steps_of,
    without_times,
)

SEED = 21
PHASES = ("before writing", "half written", "synchronised", "acknowledged")


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def simulated(protocol: MeasuringProtocol, cycles: int) -> tuple[SimulatedGauge, Opened]:
    gauge = SimulatedGauge(setting_of(steps_of(protocol, cycles)), SEED)
    return gauge, opened(protocol, cycles, source=("simulated",), seed=SEED)


def result(dialogue: Dialogue) -> tuple[list[float], str]:
    """Offsets to the last digit, and the session file without its times."""
    text = session_text(dialogue.so_far.session)
    return offsets(dialogue).tolist(), without_times(text)


def uninterrupted(path: Path, protocol: MeasuringProtocol, cycles: int) -> Dialogue:
    gauge, first = simulated(protocol, cycles)
    return answered(path, repeat(""), first=first, gauge=gauge)[0]


def deadly(phase: str) -> SimpleNamespace:
    """`os` that ends the process without warning in one phase of the second record written."""
    records = 0

    def write(descriptor: int, data: memoryview) -> int:
        nonlocal records
        records += 1
        if records == 2 and phase == "before writing":
            die()
        if records == 2 and phase == "half written":
            os.write(descriptor, data[: len(data) // 2])
            die()
        return os.write(descriptor, data)

    def fsync(descriptor: int) -> None:
        os.fsync(descriptor)
        if records == 2 and phase == "synchronised":
            die()

    return SimpleNamespace(**{**vars(os), "write": write, "fsync": fsync})


def killed_once(
    path: Path, phase: str, protocol: MeasuringProtocol, cycles: int
) -> tuple[int, list[int]]:
    """One run in a process of its own, killed in its second step.

    Returns:
        Its exit code (negative for a signal), and the steps that were acknowledged on the screen.
    """
    listen, tell = os.pipe()

    def run() -> None:
        gauge, first = simulated(protocol, cycles)
        if not path.exists():
            Journal.create(path, first)
        journal_module.os = deadly(phase)  # type: ignore[attr-defined]
        steps: list[int] = []

        def shown(text: str, style: Style = Style.PLAIN, end: str = "\n") -> None:
            if text.startswith("   saved"):
                steps.append(dialogue.so_far.steps[-1].number)
                os.write(tell, bytes(steps[-1:]))
                if len(steps) == 2 and phase == "acknowledged":
                    die()

        dialogue, _, stack = a_dialogue(path, repeat(""), gauge=gauge, show=shown)
        with stack:
            dialogue.run()

    process = get_context("fork").Process(target=run)
    process.start()
    process.join()
    os.close(tell)
    with os.fdopen(listen, "rb") as pipe:
        return process.exitcode, list(pipe.read())


def killed_all_along(path: Path, phase: str, protocol: MeasuringProtocol, cycles: int) -> int:
    """Run after run, each killed, until the session is complete; how many there were."""
    acknowledged: set[int] = set()
    for count in range(1, 200):
        status, said = killed_once(path, phase, protocol, cycles)
        acknowledged |= set(said)
        state = replay(Journal.decode(path.read_bytes(), str(path)).events)
        assert acknowledged <= set(state.accepted)
        if status == 0:
            return count
        assert status == -signal.SIGKILL
    raise AssertionError("the session never ends")


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize(
    ("protocol", "cycles"),
    [
        (SINGLE, 1),
        *(pytest.param(protocol, 3, marks=pytest.mark.slow) for protocol in (SINGLE, DOUBLE)),
    ],
)
def test_killed_at_every_step(
    tmp_path: Path, phase: str, protocol: MeasuringProtocol, cycles: int
) -> None:
    expected = result(uninterrupted(tmp_path / "whole.journal", protocol, cycles))
    path = tmp_path / "killed.journal"
    runs = killed_all_along(path, phase, protocol, cycles)
    steps = len(steps_of(protocol, cycles))
    assert runs >= steps // 2
    gauge, _ = simulated(protocol, cycles)
    dialogue, _, stack = a_dialogue(path, [], gauge=gauge)
    stack.close()
    assert dialogue.state.ended is not None
    assert len(dialogue.state.accepted) == steps
    assert result(dialogue) == expected
