"""What `measure` refuses, and that it names the reason: files, other sessions, full disks."""

import resource
from pathlib import Path

import pytest

from orthoglide_cal.errors import UsageError
from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.machine_file import machine_text, stored_machine
from orthoglide_cal.session.dialogue import MOST_CYCLES, session_file, session_path
from orthoglide_cal.session.events import encode
from tests.cli.program import refusals, refuses
from tests.machines import NOMINAL

from .going_on import events_of
from .terminal import Terminal, begun, finished, refused, run_program
from .virtual import opened


def machine_file(folder: Path, old: str, new: str, name: str = "machine.yaml") -> str:
    text = machine_text(NOMINAL)
    assert old in text
    path = folder / name
    path.write_text(text.replace(old, new))
    return str(path)


def test_a_second_session_on_the_same_file_is_refused(tmp_path: Path) -> None:
    with Terminal(tmp_path, "s.yaml") as first:
        assert first.step() == 1
        done = run_program(tmp_path, "s.yaml", "--resume")
        assert done.returncode == 2
        assert "s.journal is in use by another session" in done.stderr
        assert "fg, if it was stopped with Ctrl-Z" in done.stderr
        first.type("-0.64")
        assert first.step() == 2


def test_control_characters_in_names_are_shown_and_never_obeyed(tmp_path: Path) -> None:
    """In the first lines, at an interruption, in what to run after the last reading; and they make
    a session that can be read."""
    name, shown = "a \x1b[31m b.yaml", "a ⟨U+001B⟩[31m b.yaml"
    machine = machine_file(tmp_path, "name: Orthoglide prototype", 'name: "m\\u202e\\nFile none"')
    options = ("--gauge", "simulated", "--seed", "1", "--protocol", "single", "--cycles", "1")
    given = ("--operator", "a\x07", "--gauge-id", "a\u202eb", "--certificate", name)
    left = run_program(tmp_path, name, "--machine", machine)
    done = run_program(tmp_path, f"2 {name}", *options, "--machine", machine, *given)
    assert (left.returncode, done.returncode) == (130, 0)
    assert "\x1b" not in left.stdout + left.stderr + done.stdout + done.stderr
    assert f"File     {shown}\n" in left.stdout
    assert f"orthocal measure '{shown}' --resume" in left.stderr
    assert "Machine  m⟨U+202E⟩ File none\n" in done.stdout
    assert f"Written to 2 {shown}\n" in done.stdout
    assert f"More: orthocal solve '2 {shown}' --details" in done.stdout
    said = read_input(str(tmp_path / f"2 {name}")).conditions
    gauge = said.gauges[0]
    assert (said.operator, gauge.id) == ("a⟨U+0007⟩", "a⟨U+202E⟩b")
    assert gauge.certificate == shown


@pytest.mark.parametrize("line", refusals(Path(__file__).with_name("refused_resume.txt")))
def test_resuming_another_session_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    """By an option, or by a machine file that says something else."""
    monkeypatch.chdir(tmp_path)
    machine_file(tmp_path, "leg_length_mm: 310.25", "leg_length_mm: 310.5", "long.yaml")
    machine_file(tmp_path, "resolution_mm: 0.01", "resolution_mm: 0.001", "fine.yaml")
    machine_file(tmp_path, "name: Orthoglide", "name: Other", "other.yaml")
    before = begun(tmp_path)
    refuses(line, "measure", "s.yaml", "--resume")
    assert (tmp_path / "s.journal").read_bytes() == before


def test_resume_finds_the_only_unfinished_session_which_is_not_begun_anew(tmp_path: Path) -> None:
    before = begun(tmp_path)
    assert "orthocal measure s.yaml --resume" in refused(2, tmp_path, "s.yaml")
    assert (tmp_path / "s.journal").read_bytes() == before
    (tmp_path / "s.journal").write_bytes(before[:-10])
    done = run_program(tmp_path, "--resume", stdin="0.42\n")
    assert "cut off the last entry" in done.stdout
    assert "Resumed: 1 reading " in done.stdout
    assert "saved +0.420" in done.stdout
    (tmp_path / "t.journal").write_bytes(before)
    assert "s.journal, t.journal" in refused(2, tmp_path, "--resume")


@pytest.mark.parametrize(
    "wrong", [{"cycles": MOST_CYCLES + 1}, {"cycles": 0}, {"stands": 3}, {"version": 3}]
)
def test_a_session_that_cannot_be_is_refused(tmp_path: Path, wrong: dict[str, int]) -> None:
    """Its checksum is right: another program wrote it. No time is spent on its many steps."""
    line, _ = encode(opened().model_copy(update=wrong))
    (tmp_path / "s.journal").write_bytes(line)
    said = refused(3, tmp_path, "s.yaml", "--resume")
    assert f"s.journal, line 1: The journal is damaged here: opened.{next(iter(wrong))}" in said
    assert "Use the orthocal that wrote it" in said


def test_what_cannot_be_used_leaves_no_file(tmp_path: Path) -> None:
    machine_file(tmp_path, "identified: []", "identified: [{cause: nonsense}]")
    (folder := tmp_path / "empty").mkdir()
    assert "not a cause id" in refused(3, folder, "s.yaml", "--machine", "../machine.yaml")
    assert "No such file or directory" in refused(3, folder, "missing/s.yaml")
    assert list(folder.iterdir()) == []


def test_no_reading_at_all_ends_without_a_number(tmp_path: Path) -> None:
    done = run_program(tmp_path, "s.yaml", stdin="s all power cut\n")
    assert done.returncode in (3, 4)
    assert (tmp_path / "s.yaml").exists()
    assert "Traceback" not in done.stderr


# ---- the machine and its offsets


def held(folder: Path) -> tuple[float, ...]:
    first = events_of(folder / "s.journal")[0]
    return stored_machine(first.machine, "s.journal").model.machine.offsets_mm


def test_the_machine_is_named_and_confirmed_before_anything_is_written(tmp_path: Path) -> None:
    machine = machine_file(tmp_path, "leg_length_mm: 310.25", "leg_length_mm: 400.0")
    options = ("s.yaml", "--machine", machine)
    with Terminal(tmp_path, *options, agreed=False) as terminal:
        terminal.expect("Machine  Orthoglide prototype\r\n")
        terminal.expect(r"leg 400 mm, travel -100 to \+60 mm")
        terminal.expect(r"Gauge    0\.01 mm divisions, 10 mm travel")
        terminal.expect(r"Offsets  X \+0  Y \+0  Z \+0 mm are in the controller now")
        terminal.expect("three offsets > ")
        assert not (tmp_path / "s.journal").exists()
        terminal.type("help")
        terminal.expect("Is it this machine")
        terminal.type("0.4 -0.3")
        terminal.expect("not three joint offsets")
        terminal.type("0,412 -0.3 x")
        terminal.expect("not a number")
        terminal.type("0,412 -0.3 0.861")
        terminal.expect(r"Offsets  X \+0\.412  Y -0\.3  Z \+0\.861 mm")
        terminal.expect("three offsets > ")
        terminal.type("")
        assert terminal.step() == 1
        assert "paper's prototype" not in terminal.seen
    assert held(tmp_path) == (0.412, -0.3, 0.861)


@pytest.mark.parametrize(("answer", "code"), [("n", 2), ("\x04", 130), ("\x03", 130)])
def test_another_machine_begins_no_session(tmp_path: Path, answer: str, code: int) -> None:
    with Terminal(tmp_path, "s.yaml", agreed=False) as terminal:
        terminal.expect(r"paper's\s+prototype")
        terminal.expect("three offsets > ")
        terminal.type(answer)
        assert terminal.finish() == code
        assert "Traceback" not in terminal.seen
    assert list(tmp_path.iterdir()) == []


def test_the_offsets_of_the_file_or_of_the_option_are_the_session_s(tmp_path: Path) -> None:
    machine = machine_file(tmp_path, "offsets_mm: {x: 0.0,", "offsets_mm: {x: 0.25,")
    done = run_program(tmp_path, "s.yaml", "--machine", machine, stdin="-0.64\n")
    assert held(tmp_path) == (0.25, 0.0, 0.0)
    assert "Offsets  X +0.25  Y +0  Z +0 mm" in done.stdout
    (tmp_path / "s.journal").unlink()
    option = ("--offsets-active", "0.4", "-0.3", "0.9")
    run_program(tmp_path, "s.yaml", "--machine", machine, *option)
    assert held(tmp_path) == (0.4, -0.3, 0.9)
    # The file still says something else: the session was asked.
    same = ("--machine", machine, "--protocol", "double", "--cycles", "3", "--order", "paper")
    again = run_program(tmp_path, "s.yaml", "--resume", *same)
    assert (again.returncode, "X +0.4  Y -0.3  Z +0.9" in again.stdout) == (130, True)
    other = ("--offsets-active", "0.4", "-0.3", "0")
    assert "machine, offsets_mm: " in refused(2, tmp_path, "s.yaml", "--resume", *other)


def test_names(tmp_path: Path) -> None:
    assert session_path(Path("a")) == Path("a.yaml")
    assert session_path(Path("a.yml")) == Path("a.yml")
    assert session_path(Path("2025.03.01")) == Path("2025.03.01.yaml")
    assert session_file(None, tmp_path, resume=False) == tmp_path / "session.yaml"
    (tmp_path / "session.yaml").touch()
    assert session_file(None, tmp_path, resume=False) == tmp_path / "session-2.yaml"
    (tmp_path / "session-2.journal").touch()
    with pytest.raises(UsageError, match=r"session-2\.journal"):
        session_file(None, tmp_path, resume=False)
    assert session_file(None, tmp_path, resume=True) == tmp_path / "session-2.yaml"
    assert "never overwritten" in refused(2, tmp_path, "session.yaml")
    assert not (tmp_path / "session.yaml").read_text()


# ---- full disks


def test_a_disk_that_is_full_from_the_beginning(tmp_path: Path) -> None:
    done = run_program(tmp_path, "s.yaml", before=lambda: limit_files(100))
    assert done.returncode == 3
    assert "cannot be written" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_is_full_at_the_end(tmp_path: Path) -> None:
    """Not even the session file fits: the journal stays, and --resume ends the session."""
    options = ("--gauge", "simulated", "--seed", "1", "--protocol", "single", "--cycles", "1")
    finished(tmp_path, "s.yaml", *options)
    (tmp_path / "s.yaml").unlink()
    done = run_program(tmp_path, "s.yaml", "--resume", before=lambda: limit_files(1000))
    assert done.returncode == 3
    assert not (tmp_path / "s.yaml").exists()
    finished(tmp_path, "s.yaml", "--resume")
    assert (tmp_path / "s.yaml").exists()


def limit_files(size: int) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
