"""The program as a whole: start, help, exit codes, streams, interruptions."""

import json
import os
import re
import resource
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from orthoglide_cal import __version__
from orthoglide_cal.cli.app import app
from tests.cli.program import (
    DOUBLE,
    ROOT,
    SIX,
    UNDETERMINED,
    done,
    lines,
    refusals,
    refuses,
    run,
    tells,
    worded,
    words,
)  # fmt: skip
from tests.session.terminal import PROGRAM, Terminal

COMMANDS = tuple(get_command(app).commands)  # type: ignore[attr-defined]


def started(*arguments: str, program: str = PROGRAM, **more: Any) -> subprocess.Popen[str]:
    """The program as a process of its own."""
    pipes: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.Popen(command, cwd=ROOT, text=True, encoding="utf-8", **{**pipes, **more})


def test_every_command_has_help() -> None:
    """Which calls nothing by a type of the language."""
    assert "--install-completion" in done("--help")
    for command in (*COMMANDS, "machine new", "machine show"):
        shown = done(*command.split(), "--help")
        assert shown.startswith("Usage: ")
        assert not re.search(r"<[a-z]", shown), command
        assert shown == done(*command.split(), "-h")


LOADING = """
import json, sys
from orthoglide_cal.cli import main
for words in json.loads(sys.stdin.read()):
    sys.argv = ["orthocal", *words]
    try:
        main()
    except SystemExit as end:
        assert not end.code, (words, end.code)
    print(*sys.modules, file=sys.stderr)
"""


PRESSED = """
import signal, sys
class Loader:
    def find_spec(name, *_):
        if name == "typer":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Loader)
from orthoglide_cal.cli import main
main()
"""


def test_ctrl_c_while_the_program_is_loaded_ends_it_in_silence() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PRESSED], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (130, "")


def test_no_command_loads_what_it_does_not_need() -> None:
    """Those that need least come first: one process runs all of them."""
    rows = [line.split("|") for line in refusals(Path(__file__).with_name("needless.txt"))]
    program = started(program=LOADING)
    _, said = program.communicate(json.dumps([worded(command) for command, _ in rows]))
    assert program.returncode == 0, said
    for (command, needless), shown in zip(rows, said.splitlines(), strict=True):
        loaded = set(shown.split())
        assert "orthoglide_cal.cli.app" in loaded
        assert not set(needless.split()) & loaded, command


def test_version_is_one_line_and_quick() -> None:
    """Best of three at most under a second of processor time, where about 0.15 s are usual."""
    times = [2.0]
    while min(times) >= 1.0 and len(times) < 4:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        program = started("--version")
        shown, _ = program.communicate()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        assert (shown, program.returncode) == (f"orthocal {__version__}\n", 0)
    assert min(times) < 1.0


@pytest.mark.parametrize("line", refusals(Path(__file__).with_name("refused.txt")))
def test_what_is_refused_says_why_and_leaves_no_file(line: str, folder: Path) -> None:
    refuses(line)
    assert not list(folder.iterdir())


@pytest.mark.parametrize("line", refusals(Path(__file__).with_name("said.txt")))
def test_what_a_screen_says(line: str) -> None:
    tells(line)


@pytest.mark.parametrize("typed", ["0,1 -0,254 0", "0.1mm -0.01in 0", "100um \u22120.254 0.0cm"])
def test_options_take_commas_and_units_as_a_session_does(typed: str) -> None:
    plain, told = (
        run("simulate", "--seed", "1", "--offsets", *offsets.split())
        for offsets in ("0.1 -0.254 0", typed)
    )
    assert (told.exit_code, told.stdout) == (0, plain.stdout)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_behind_standard_output_is_said_in_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        program = started("template", "machine", stdout=full)
        _, said = program.communicate()
    assert program.returncode == 3
    assert said.startswith("Standard output cannot be written:")
    assert said.count("\n") == 1


def test_long_messages_break_between_words_in_a_terminal(tmp_path: Path) -> None:
    """And a command that a message names stays on one line, to be copied."""
    with Terminal(tmp_path, "--undo", command=("apply",)) as terminal:
        assert terminal.finish() == 2
    shown = terminal.seen.replace("\r\n", "\n").rstrip("\n").split("\n")
    assert len(shown) > 2
    assert max(map(len, shown)) <= 80
    assert shown[-1] == "  orthocal machine new"
    assert " ".join(shown).split() == run("apply", "--undo", "--yes").stderr.split()


@pytest.mark.parametrize("form", [(), ("--json",)])
def test_faults_of_standard_input_name_it_in_words(form: tuple[str, ...]) -> None:
    shown = run("solve", "-", *form, text="leg,posture\nx,max\n")
    assert shown.exit_code == 3
    said = (lines(shown)[0]["error"] if form else shown.stderr).splitlines()
    assert said
    assert all(line.startswith("standard input, line 1, column ") for line in said)


def test_the_worst_exit_code_wins_and_every_file_has_its_place(tmp_path: Path) -> None:
    bad = tmp_path / "undetermined.csv"
    bad.write_text(UNDETERMINED, encoding="utf-8")
    files = (SIX, "nowhere.csv", str(bad), DOUBLE)
    shown = run("solve", "--json", *files)
    assert shown.exit_code == 4
    found = lines(shown)
    assert [entry["input"]["path"] for entry in found] == list(files)
    assert ["error" in entry for entry in found] == [False, True, False, False]
    assert set(found[1]) == {"input", "error"}
    assert "no such file" in found[1]["error"]
    assert shown.stderr == ""
    plain = run("solve", *files)
    assert plain.exit_code == 4
    assert plain.stdout.count("these offsets") + plain.stdout.count("may be entered") == 2
    assert plain.stderr.startswith("nowhere.csv: There is no such file.")
    assert "There is no result" in plain.stdout
    assert "These readings do not" in plain.stdout


@pytest.mark.parametrize(("failure", "code"), [(ZeroDivisionError, 1), (KeyboardInterrupt, 130)])
def test_an_unexpected_failure_is_not_success(
    failure: type[BaseException], code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*given: object) -> None:
        raise failure

    monkeypatch.setattr("orthoglide_cal.cli.common.read_input", fail)
    shown = run("solve", SIX)
    assert shown.exit_code == code
    assert isinstance(shown.exception, failure if code == 1 else SystemExit)


COMPUTING = """
from orthoglide_cal.cli import main
from orthoglide_cal.paper import tables
def begun(*given, cell=tables.monte_carlo):
    print("begun", flush=True)
    return cell(*given)
tables.monte_carlo = begun
main()
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads the time used, of Linux")
def test_ctrl_c_during_a_long_run() -> None:
    """It ends within a second of its own time, however busy the computer is."""
    earlier = resource.getrusage(resource.RUSAGE_CHILDREN)
    program = started("paper", "--table", "3", program=COMPUTING)
    for _ in range(2):  # in the second cell everything is loaded
        assert program.stdout.readline() == "begun\n"
    ticks = Path(f"/proc/{program.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    program.send_signal(signal.SIGINT)
    shown, said = program.communicate(timeout=60)
    assert (program.returncode, said) == (130, "")
    assert "Table" not in shown
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = ended.ru_utime + ended.ru_stime - earlier.ru_utime - earlier.ru_stime
    assert used - sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK") < 1.0


@pytest.mark.parametrize("enough", [True, False])
def test_a_reader_that_stops_reading_is_no_failure(enough: bool) -> None:
    """As `orthocal … | head -1`, with little output (buffered to the end) and with much."""
    files = (DOUBLE,) if enough else (DOUBLE,) * 12
    with started("solve", *files) as program:
        program.stdout.close()
        said = program.stderr.read()
    assert program.returncode == 0
    assert said == ""


@pytest.mark.parametrize(("words", "code"), [("--version >&-", 0), ("solve none.csv 2>&-", 3)])
def test_a_stream_that_the_shell_closed_is_no_failure(words: str, code: int) -> None:
    command = f"{shlex.quote(sys.executable)} -P -m orthoglide_cal {words}"
    done = subprocess.run(["sh", "-c", command], capture_output=True, cwd=ROOT, check=False)
    assert done.returncode == code


@pytest.mark.parametrize("command", ["solve", "validate", "diagnose", "report", "export", "guide"])
def test_a_file_name_is_shown_and_never_obeyed(command: str, tmp_path: Path) -> None:
    """Neither in the answer nor in an error."""
    path = tmp_path / "\x1b[31mred\u202e.csv"
    path.write_bytes(Path(DOUBLE).read_bytes())
    broken = tmp_path / "\x1b]0;title\x07.csv"
    broken.write_text("leg,posture,direction,reading_mm\nq\x1b[2J,iso,y,0.1\n", encoding="utf-8")
    for given in (path, broken, tmp_path / "no \x1b[7mfile"):
        shown = run(command, str(given))
        said = shown.stdout + shown.stderr
        assert said.strip()
        assert not set(said) & set("\x1b\x07\u202e")
    assert "⟨U+001B⟩[31mred⟨U+202E⟩.csv" in run("validate", str(path)).stdout


def test_a_file_that_is_worked_on_is_shown_by_its_name(tmp_path: Path) -> None:
    """The name holds what would be markup."""
    (tmp_path / "a[").mkdir()
    (tmp_path / "a[/b].csv").write_bytes(Path(DOUBLE).read_bytes())
    program = f"from orthoglide_cal.cli import common; common.SLOW_S = 0.0; {PROGRAM}"
    command = ("solve", "a[/b].csv")
    with Terminal(tmp_path, command=command, agreed=False, program=program) as terminal:
        assert terminal.finish() == 0, terminal.seen
    assert "Calculating: a[/b].csv …" in terminal.seen


@pytest.mark.parametrize("how", ["option", "before the command", "environment"])
def test_no_colour_means_no_escape_codes(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ["solve", SIX]
    if how != "environment":
        arguments.insert(2 if how == "option" else 0, "--no-color")
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b" in run("solve", SIX).stdout
    if how == "environment":
        monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in run(*arguments).stdout


def test_a_terminal_without_such_letters_keeps_every_sign() -> None:
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    program = started("solve", DOUBLE, env=ascii_only)
    shown, _ = program.communicate()
    assert program.returncode == 0
    assert shown.startswith("+ The offsets may be entered")
    assert re.search(r"^  y +0.000 +-0.296 +0.024 +-0.296$", shown, re.MULTILINE)
    assert "must move by -0.001 +/- 0.023 mm" in words(shown)
