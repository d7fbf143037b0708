"""What the screen shows when it is narrow, resized or pushed away, and after Ctrl-Z."""

import os
import re
import shlex
import sys
from pathlib import Path

import pexpect
import pytest

from orthoglide_cal.session.wording import value_text
from orthoglide_cal.words import Unit

from .terminal import AT_ONCE, PATIENCE_S, PROMPT
from .virtual import answered, readings_of, steps_of, typed

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


def test_what_is_typed_after_the_end_does_not_reach_the_shell(tmp_path: Path) -> None:
    shell = pexpect.spawn(
        "sh", ["-c", f'{PYTHON} -c "{AT_ONCE}" measure s.yaml --yes; read x; echo "[$x]"'],
        cwd=str(tmp_path), encoding="utf-8", timeout=PATIENCE_S,
    )  # fmt: skip
    shell.expect(PROMPT)
    shell.send("q\rrm -rf everything\r")
    shell.expect("--resume")
    shell.send("\r")
    assert shell.expect([r"\[\]", r"\[rm"]) == 0
    shell.close(force=True)
