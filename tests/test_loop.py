"""The whole round, typing only what the screens suggest, in a real terminal where they ask.

machine new → measure → solve → apply → measure again → verify → report as left.
"""

import re
import shlex
from contextlib import chdir
from pathlib import Path

import numpy as np
import yaml

from orthoglide_cal.session.gauges import OFFSETS_MM
from tests.cli.program import run
from tests.session.terminal import Terminal

SEED = 5
PRACTICE = {"--gauge": "simulated", "--seed": str(SEED), "--cycles": "2"}
# What the machine hides: drawn here as the simulated gauge draws it, from the seed alone.
HIDDEN = np.random.default_rng([SEED, 0]).uniform(-OFFSETS_MM, OFFSETS_MM, 3)


def typed(folder: Path, line: str, *answers: str) -> str:
    """Type a command and answer its questions, one for each; what the screen showed.

    What asks nothing needs no terminal of its own.
    """
    program, *command = shlex.split(line)
    assert program == "orthocal"
    if not answers:
        with chdir(folder):
            done = run(*command)
        assert done.exit_code == 0, done.output
        return done.stdout
    with Terminal(folder, command=tuple(command), agreed=False) as terminal:
        for answer in answers:
            terminal.expect(r"(\]:|y/n >) $")
            terminal.type(answer)
        assert terminal.finish() == 0, terminal.seen
    return terminal.seen.replace("\r\n", "\n")


def measured(folder: Path, line: str) -> str:
    """Measure with the simulated gauge: Return at every prompt, also at that for the machine."""
    _, *command = shlex.split(line)
    # The screen itself names the simulated machine, measured again also its seed.
    practice = [word for pair in PRACTICE.items() if pair[0] not in command for word in pair]
    with Terminal(folder, *practice, command=tuple(command), agreed=False) as terminal:
        terminal.expect(r"offsets > $")
        terminal.type("")
        terminal.step()
        announced = re.search(r"(\d+) readings with", terminal.seen)
        assert announced
        for number in range(2, int(announced[1]) + 1):
            terminal.type("")
            assert terminal.step() == number
        terminal.type("")
        assert terminal.finish() == 0, terminal.seen
    return terminal.seen.replace("\r\n", "\n")


def suggested(screen: str, verb: str) -> str:
    found = re.search(rf"orthocal {verb}\b[^\n]*", screen)
    assert found, screen
    return found[0].strip()


def test_the_round_closes(tmp_path: Path) -> None:
    new = suggested(typed(tmp_path, "orthocal"), "machine new --practice")
    made = typed(tmp_path, new, "Mill 3", "400", *[""] * 8)
    assert "Mill 3" in made

    assert "Mill 3" in measured(tmp_path, suggested(made, "measure"))
    solved = typed(tmp_path, suggested(typed(tmp_path, "orthocal"), "solve"))
    applied = typed(tmp_path, suggested(solved, "apply"), "y")
    assert "Recorded in machine.yaml" in applied
    entered = yaml.safe_load((tmp_path / "machine.yaml").read_text())["offsets_mm"]
    np.testing.assert_allclose(list(entered.values()), HIDDEN, atol=0.04)

    assert "Mill 3" in measured(tmp_path, suggested(applied, "measure"))
    page = typed(tmp_path, "orthocal")
    verified = typed(tmp_path, suggested(page, "verify"))
    assert "The correction worked as predicted" in verified
    report = suggested(page, "report")
    left = typed(tmp_path, report.partition(" --html")[0])
    for axis, value in entered.items():
        row = re.search(rf"^ +{axis} +\S+ ± \S+ +(\S+) +(\S+) +(\S+) +(\S+) ± ", left, re.MULTILINE)
        assert row, left
        before, change, now, remains = (float(cell.replace("−", "-")) for cell in row.groups())
        assert (before, change, now) == (0.0, value, value)
        # What the machine still hides is gone, to within the noise of readings.
        assert abs(remains) < 0.04

    # The report is written, and nothing more is asked for.
    typed(tmp_path, report)
    end = typed(tmp_path, "orthocal")
    assert "Nothing more to do" in end
    assert "orthocal " not in end.replace("orthocal history .", "")
