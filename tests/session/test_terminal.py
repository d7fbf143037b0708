"""Whole sessions through a real pseudo-terminal: typed, interrupted, and from serial gauges."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pexpect
import pytest

from orthoglide_cal.files.input import read_input
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.session.gauges import SimulatedGauge
from orthoglide_cal.words import Unit, value_text

from .going_on import content
from .terminal import (
    AT_ONCE,
    PATIENCE_S,
    PROGRAM,
    PROMPT,
    QUESTION,
    SerialLine,
    Terminal,
    run_program,
)
from .virtual import SINGLE, answered, readings_of, setting_of, steps_of, typed

ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def test_colours_only_where_they_are_wanted(tmp_path: Path) -> None:
    with Terminal(tmp_path, "s.yaml", colour=True) as terminal:
        terminal.step()
        assert ESCAPE.search(terminal.seen)
    with Terminal(tmp_path, "t.yaml", "--no-color", colour=True) as terminal:
        terminal.step()
        assert not ESCAPE.search(terminal.seen)


# ---- interruptions


@pytest.mark.parametrize(
    ("how", "when"),
    [
        ("ctrl-c", "prompt"), ("ctrl-d", "prompt"), ("SIGTERM", "prompt"), ("SIGHUP", "prompt"),
        ("q", "prompt"), ("closed", "prompt"), ("ctrl-c", "question"), ("q", "question"),
    ],
)  # fmt: skip
def test_every_interruption_keeps_everything(tmp_path: Path, how: str, when: str) -> None:
    with Terminal(tmp_path, "s.yaml") as terminal:
        for value in ("-0.64", "0.41"):
            terminal.step()
            terminal.type(value)
        assert terminal.step() == 3
        if when == "question":
            terminal.type("12.345")
            terminal.expect(QUESTION)
        child = terminal.child
        if how.startswith("ctrl"):
            child.sendcontrol(how[-1])
        elif how.startswith("SIG"):
            child.kill(getattr(signal, how))
        elif how == "closed":
            child.close(force=False)
        else:
            terminal.type("q")
        if how == "closed":
            assert child.exitstatus in (130, None)
        else:
            assert terminal.finish() == 130
            assert "orthocal measure s.yaml --resume" in terminal.seen
            assert "Traceback" not in terminal.seen
    assert not (tmp_path / "s.yaml").exists()
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        with Terminal(tmp_path, "s.yaml", "--resume") as terminal:
            terminal.child.expect([QUESTION, PROMPT, "in use"])
            if terminal.child.after != "in use":  # a closed terminal takes a moment
                assert "Resumed: 2 readings" in terminal.child.before
                assert terminal.child.match.group(1) == "3"
                return
    pytest.fail("the interrupted session still holds its lock")


# Something is typed when nothing is read any more, before the terminal is given back.
SLOW_TO_LEAVE = (
    "import select; from orthoglide_cal.session.asking import Keyboard; close = Keyboard.close;"
    "Keyboard.close = lambda it: (print('leaving'), select.select([0], [], []), close(it));"
) + AT_ONCE


def test_the_terminal_is_left_as_it_was(tmp_path: Path) -> None:
    """TAB ends a line only while the session runs, and what is typed after it reaches no shell."""
    script = (
        "import sys, subprocess, termios;"
        "before = termios.tcgetattr(0);"
        f"subprocess.run([sys.executable, '-c', {SLOW_TO_LEAVE!r}, 'measure', 's.yaml', '--yes']);"
        "print('same' if termios.tcgetattr(0) == before else 'changed');"
        "print(f'[{input()}]')"
    )
    child = pexpect.spawn(
        sys.executable, ["-c", script], cwd=str(tmp_path), encoding="utf-8",
        timeout=PATIENCE_S,
    )  # fmt: skip
    child.expect(PROMPT)
    child.send("q\r")
    child.expect("leaving")
    child.send("rm -rf everything\r")
    assert child.expect(["same", "changed"]) == 0
    child.send("\r")
    assert child.expect([r"\[\]", r"\[rm"]) == 0
    child.close(force=True)


# ---- without a terminal


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_readings_from_a_pipe(tmp_path: Path, end: str) -> None:
    """The file holds them, and they give the hidden offsets; the screen is plain and narrow."""
    steps = steps_of(SINGLE)
    values = readings_of(steps, 5)
    text = "".join(f"{value:.2f}{end}" for value in values)
    options = ("s.yaml", "--protocol", "single", "--operator", "Ada")
    done = run_program(tmp_path, *options, stdin=text)
    assert (done.returncode, done.stderr) == (0, "")
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert all(c.isprintable() or c == "\n" for c in done.stdout)
    read = read_input(str(tmp_path / "s.yaml"))
    assert read.measured.value.tolist() == values
    hidden = SimulatedGauge(setting_of(steps), 5).offsets_mm
    assert np.abs(solve(read.measured, read.model).offsets_mm - hidden).max() < 0.08
    assert "More: orthocal solve s.yaml --details" in done.stdout
    file = content(tmp_path / "s.yaml")
    assert (file["protocol"], file["operator"]) == (SINGLE, "Ada")
    assert file["finished"] is not None


def test_a_simulated_session_without_anyone_at_the_keys(tmp_path: Path) -> None:
    done = run_program(tmp_path, "s.yaml", "--gauge", "simulated", "--seed", "9", "--json")
    assert done.returncode == 0
    result = json.loads(done.stdout)
    hidden = SimulatedGauge(setting_of(steps_of()), 9).offsets_mm
    found = [parameter["found"] for parameter in result["parameters"]]
    assert np.abs(np.array(found) - hidden).max() < 0.05
    assert "Step 1 of 60" in done.stderr
    assert f"True offsets: x {hidden[0]:+.3f}" in done.stderr
    assert done.stderr.startswith("SIMULATED: no machine was measured.\nMachine")
    assert content(tmp_path / "s.yaml")["environment"] == {
        "readings_from": "simulated",
        "seed": "9",
    }


def test_a_reader_that_goes_away(tmp_path: Path) -> None:
    """As after `| head`: no complaint, and what was shown as saved is saved."""
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "measure", "s.yaml"], cwd=tmp_path,

        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as program:  # fmt: skip
        program.stdin.write(b"-0.64\n")
        program.stdin.flush()
        while b"saved -0.640" not in program.stdout.readline():
            assert program.poll() is None
        program.stdout.close()
        program.stdin.write(b"0.41\n")
        program.stdin.close()
        said = program.stderr.read().decode()
    assert program.returncode == 130
    assert "orthocal measure s.yaml --resume" in said
    assert "Traceback" not in said
    assert "Resumed: 1 reading " in run_program(tmp_path, "s.yaml", "--resume").stdout


def test_a_number_typed_as_a_note_is_asked_about(tmp_path: Path) -> None:
    with Terminal(tmp_path, "s.yaml") as terminal:
        for answer, said in (("n", "Not kept"), ("y", "Noted at step 1")):
            assert terminal.step() == 1
            terminal.type("n")
            for prompt, line in (("Note > ", "-0.64"), (r"as a note\? y/n > ", answer)):
                terminal.expect(prompt)
                terminal.type(line)
            terminal.expect(said)
    assert (tmp_path / "s.journal").read_text().count('"noted"') == 1


def test_a_line_is_corrected_as_in_any_terminal(tmp_path: Path) -> None:
    with Terminal(tmp_path, "s.yaml") as terminal:
        assert terminal.step() == 1
        terminal.type("9.9\x15-0.65\x7f4")
        terminal.expect("saved -0.64")


def test_return_asks_a_gauge_and_an_error_is_no_reading(tmp_path: Path, line: SerialLine) -> None:
    with Terminal(tmp_path, "s.yaml", "--gauge", f"sylvac:{line.path}") as terminal:
        assert terminal.step() == 1
        terminal.type("")
        assert line.received() == b"?\r"
        for error in (b"ERR6\r", b"\xff\xfe\r"):
            line.send(error)
            terminal.expect("nothing is recorded")
            assert terminal.step() == 1
        line.send(b"-0.64\r")
        terminal.expect("saved -0.640")


def test_unplugging_pauses_and_plugging_in_goes_on(tmp_path: Path, line: SerialLine) -> None:
    with Terminal(tmp_path, "s.yaml", "--gauge", f"plain:{line.path}") as terminal:
        assert terminal.step() == 1
        line.send(b"-0.64\r")
        assert terminal.step() == 2
        for value in ("0.41", "-0.95"):
            line.unplug()
            terminal.expect(r"does\s+not\s+answer")
            terminal.expect(r"Plug\s+it\s+in\s+again")
            terminal.step()
            line.plug_in()
            terminal.expect("The gauge is back")
            terminal.step()
            line.send(f"{value}\r".encode())
            terminal.expect(f"saved {float(value):+.3f}".replace("+", r"\+"))
            terminal.step()
        terminal.type("q")
        assert terminal.finish() == 130
        assert "Traceback" not in terminal.seen


def test_two_gauges_on_a_multiplexer(tmp_path: Path, line: SerialLine) -> None:
    with Terminal(tmp_path, "s.yaml", "--gauge", f"mitutoyo:{line.path}#1,2") as terminal:
        assert terminal.step() == 1
        line.send(b"02A+0000.410\r")
        terminal.expect("That was channel 02; channel 1 is next")
        assert terminal.step() == 1
        line.send(b"01A-0000.640\r")
        terminal.expect("saved -0.640")
        assert terminal.step() == 2
        line.send(b"02A+0000.410\r")
        terminal.expect(r"saved \+0\.410")


# As a shell must be given it: a clone may stand at a path with a blank.
PYTHON = shlex.quote(sys.executable)

# The prototype's first posture (sec. 2.5).
ISO = (
    "Drive to  joints   X 310.250   Y 310.250   Z 310.250  mm\n"
    "          tool     X 0.000   Y 0.000   Z 0.000  mm\n"
)


@pytest.mark.parametrize("line", ["t", "?", "n door slammed", "hello", "", "u", "s", "s all\nn"])
def test_where_to_drive_is_shown_again_after_what_pushed_it_away(tmp_path: Path, line: str) -> None:
    _, screen = answered(tmp_path / "s.journal", ["-0.64", *line.split("\n"), ""])
    assert screen.text.count(ISO) >= 2
    # Nothing but the prompt stands between it and the end.
    assert re.fullmatch(r"\d\. Gauge [YZ] \[mm\] > ", screen.text.split(ISO)[-1])


def test_a_narrow_screen_breaks_no_word(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = typed(readings_of(steps_of())[:30])
    _, wide = answered(tmp_path / "w.journal", lines)
    monkeypatch.setattr("tests.session.virtual.Script.columns", 40)
    _, screen = answered(tmp_path / "s.journal", lines)
    assert max(map(len, screen.text.splitlines())) <= 40
    assert {word for word in screen.text.split() if word[0] != "-"} <= {*wide.text.split()}


def test_a_table_has_the_last_readings(tmp_path: Path) -> None:
    lines = typed(readings_of(steps_of()))[:26]
    given = [f"{float(lines[0]) / 25.4:.4f}", *(f"{line} mm" for line in lines[1:]), "t"]
    _, screen = answered(tmp_path / "s.journal", given, unit=Unit.INCH)
    assert f"saved +{given[0]} in ({25.4 * float(given[0]):+.3f} mm)" in screen.text
    assert value_text(-0.00127, Unit.INCH) == "-0.00005 in (-0.001 mm)"
    (text,) = (text for text, _ in screen.shown if text.startswith("The last "))
    shown = text.splitlines()
    assert (len(shown), shown[0]) == (21, "The last 20 readings:")
    assert re.fullmatch(r" +21  leg Y, ISO, cycle 1, gauge X  \S+ in \(\S+ mm\)", shown[15])
    assert float(shown[15].split()[-4]) == pytest.approx(float(lines[20]) / 25.4, abs=6e-5)


def test_after_ctrl_z_and_fg_everything_is_as_before(tmp_path: Path) -> None:
    """In a shell with jobs: it has its own terminal modes, and gives the program's back or not."""
    here = {**os.environ, "PS1": "shell> ", "TERM": "dumb", "HISTFILE": ""}
    shell = pexpect.spawn(
        "bash", ["--norc", "--noediting", "-i"], cwd=str(tmp_path), env=here, encoding="utf-8",
        timeout=PATIENCE_S, dimensions=(24, 80),
    )  # fmt: skip
    try:
        shell.expect("shell> ")
        shell.sendline(f'{PYTHON} -c "{AT_ONCE}" measure s.yaml --yes')
        shell.expect(PROMPT)
        shell.sendcontrol("z")
        shell.expect("shell> ")
        shell.sendline("stty sane; echo still $((40 + 2))")
        shell.expect("still 42")
        shell.expect("shell> ")
        shell.sendline("fg")
        shell.expect("Drive to  joints")
        shell.expect(PROMPT)
        shell.send("-0.64\t")
        shell.expect("saved -0.640")
        shell.expect(PROMPT)
        shell.send("0.41\r")
        shell.expect(r"saved \+0\.410")
    finally:
        shell.close(force=True)
