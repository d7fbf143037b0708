"""Wrong input gives one plain message, in JSON where that is asked for."""

import os
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from orthoglide_cal.cli.app import app
from orthoglide_cal.errors import InputError
from orthoglide_cal.files.machine_file import shipped_folder
from orthoglide_cal.files.text import write_text
from orthoglide_cal.session.gauges import SerialGauge, SerialPort
from tests.session.terminal import Terminal, run_program
from tests.session.virtual import answered, readings_of, steps_of, typed

from .program import DOUBLE, SIX, answer, done, refused, run

PROTOTYPE = (shipped_folder() / "orthoglide_prototype.yaml").read_text(encoding="utf-8")


def test_apply_says_nothing_is_entered_before_it_asks(tmp_path: Path) -> None:
    Path("machine.yaml").write_text(PROTOTYPE, encoding="utf-8")
    assert "Do not use these offsets." in refused(4, "apply", SIX, "--yes")
    before = Path("machine.yaml").read_bytes()
    for options, answers in (((DOUBLE,), "n"), ((DOUBLE,), "y"), (("--undo",), "n")):
        with Terminal(tmp_path, *options, command=("apply",), agreed=False) as terminal:
            terminal.expect(r"y/n > ")
            assert "Entered" not in terminal.seen
            assert "Taken back" not in terminal.seen
            unasked = Path("machine.yaml").read_bytes()
            assert (unasked == before) == (options == (DOUBLE,))
            terminal.type(answers)
            assert terminal.finish() == 0
        assert (Path("machine.yaml").read_bytes() == unasked) == (answers == "n")


def test_a_folder_that_is_read_only_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, *_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "open", refuse)
    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(InputError, match="Read-only file system"):
        write_text(tmp_path / "a", "text")


def test_what_killed_writes_left_is_removed_after_an_hour(tmp_path: Path) -> None:
    names = (".a.yaml.0123456789ab.tmp", ".b.0123456789ab.tmp", ".mine.tmp", "c.0123456789ab.tmp")
    for name in names:
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (time.time() - 3700.0,) * 2)
    os.utime(tmp_path / names[1])
    write_text(tmp_path / "d", "text")
    assert {path.name for path in tmp_path.iterdir()} == {*names[1:], "d"}


@pytest.mark.parametrize("name", ["plain", "sylvac"])
def test_a_number_cut_off_on_its_way_is_no_reading(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    sent = iter(["+0.123", "+0.12", "+0.124", "+1.123"])
    read = lambda port, _: port.tokens(f"{next(sent)}\r".encode(), 0.0)  # noqa: E731
    monkeypatch.setattr(SerialPort, "read", read)
    gauge, step = SerialGauge([f"{name}:/dev/ttyUSB0"]), steps_of()[0]
    told = []
    for _ in range(4):
        gauge.begin(step, 0)
        told += [item.elsewhere for item in gauge.poll(asked=False)]
    assert [bool(text) for text in told] == [False, True, False, False]
    assert "3 decimals before" in (told[1] or "")


def test_pasted_lines_are_not_lost_in_silence(tmp_path: Path) -> None:
    with Terminal(tmp_path, "s.yaml", "--gauge", "simulated", "--seed", "1") as terminal:
        terminal.step()
        terminal.type("0.1\r0.2\r0.3")
        terminal.expect(r"ignored: [123] lines? typed before")
        terminal.expect("Drive to")
        terminal.step()


def test_topics_of_the_guide_complete() -> None:
    words = {"COMP_WORDS": "orthocal guide axis_", "COMP_CWORD": "2"}
    asked = {"_ORTHOCAL_COMPLETE": "complete_bash", **words}
    said = CliRunner().invoke(app, [], env=asked, prog_name="orthocal").stdout
    assert said.split() == ["axis_gap", "axis_squareness"]


@pytest.fixture(scope="module")
def doubtful(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A session with two wrong readings, each questioned and kept; and what the screen showed."""
    path = tmp_path_factory.mktemp("doubtful") / "s.journal"
    right = readings_of(steps_of(), 1)
    wrong = {9: 0.5, 19: -0.3}
    lines = []
    for step, value in enumerate(right, start=1):
        lines += [f"{value + wrong.get(step, 0.0):.2f}", *(["k"] if step in wrong else [])]
    dialogue, screen = answered(path, lines)
    dialogue.publish()
    return dialogue.path, screen.text


def test_the_verdict_remembers_what_was_questioned_and_kept(doubtful: tuple[Path, str]) -> None:
    path, shown = doubtful
    assert "Or was step 3 wrong? r 3 reads both again." in shown
    found = answer("solve", str(path))
    assert found["verdict"] in ("unexplained", "ambiguous", "named")
    first = found["release"]["remedies"][0]
    assert (first["verb"], first["options"]) == ("measure", "--resume")
    assert "r 9 (0.490 mm from the last cycle), r 19 (" in first["sentence"]
    said = " ".join(run("solve", str(path)).stdout.split())
    assert "r 9 (0.490 mm" in said
    assert f"orthocal measure {path} --resume" in said


def test_a_kept_reading_is_retaken_after_the_end(
    doubtful: tuple[Path, str], tmp_path: Path
) -> None:
    """Its stands were moved since, and so were those of the last leg: all of both again."""
    for suffix in (".yaml", ".journal"):
        copy = doubtful[0].with_suffix(suffix)
        (tmp_path / copy.name).write_bytes(copy.read_bytes())
    with Terminal(tmp_path, "s.yaml", "--resume", agreed=False) as terminal:
        terminal.expect("Questioned and kept: r 9, r 19")
        terminal.expect("none > ")
        terminal.type("r 9")
        terminal.expect("y/n > ")
        terminal.type("y")
        assert terminal.step() == 1
        terminal.type("q")
        assert terminal.finish() == 130
    with Terminal(tmp_path, "s.yaml", "--resume", agreed=False) as terminal:
        assert terminal.step() == 1


def test_a_contradiction_offers_both_readings(tmp_path: Path) -> None:
    right = typed(readings_of(steps_of(), 1))
    slip = f"{float(right[8]) + 0.5:.2f}"
    lines = [*right[:8], slip, "r 3", right[2], right[8], right[9]]
    dialogue, _ = answered(tmp_path / "s.journal", lines)
    assert list(dialogue.state.accepted) == [1, 2, 4, 5, 6, 7, 8, 3, 9, 10]
    assert [take.step for take, _ in dialogue.state.replaced] == [9, 3]


def test_the_end_of_measure_is_one_screen(tmp_path: Path) -> None:
    """With a machine file, so that all steps of the round are named, and a reading in doubt."""
    (tmp_path / "machine.yaml").write_text(PROTOTYPE, encoding="utf-8")
    stdin = "\n" * 8 + "3.3\nk\n"
    ended = run_program(tmp_path, "s.yaml", "--gauge", "simulated", "--seed", "1", stdin=stdin)
    assert ended.returncode == 4
    shown = ended.stdout[ended.stdout.index("Session complete") :].splitlines()
    assert 10 < len(shown) <= 24
    assert max(map(len, shown)) <= 80


@pytest.mark.parametrize(
    ("words", "code"),
    [("diagnose {} --details", 4), ("report {} --markdown -", 4), ("history {six} {}", 4)],
)  # fmt: skip
def test_where_nothing_is_determined_no_table_is_empty(words: str, code: int) -> None:
    """One number is of another place. Nor does a history follow such a session."""
    wild = ("--cycles", "1", "--seed", "2", "--cause", "misread=-123")
    made = done("simulate", *wild)
    Path("wild.csv").write_text(made.replace("yes", ""), encoding="utf-8")
    result = run(*(word.format("wild.csv", six=SIX) for word in words.split()))
    assert result.exit_code == code, result.output
    told = "wild.csv: The offsets would be" if "history" in words else "There is no result"
    assert told in result.output
    assert "r.m.s." not in result.output


def test_equal_faults_are_one_and_a_screen_holds_all_kinds(tmp_path: Path) -> None:
    table = Path(DOUBLE).read_text(encoding="utf-8").replace("0.", "0:")
    Path("colons.csv").write_text(table, encoding="utf-8")
    cells = [cell for line in table.splitlines()[1:] for cell in line.split(",")]
    count = sum("0:" in cell for cell in cells)
    said = refused(3, "solve", "colons.csv")
    assert said.count("This is not a number.") == 1
    assert said.endswith(f"The first of {count} such faults; also in minutes.")
    # Those that differ in numbers only are one, too.
    rows = Path(DOUBLE).read_text(encoding="utf-8").splitlines()
    Path("twice.csv").write_text("\n".join([*rows, *rows[1:]]), encoding="utf-8")
    assert refused(3, "solve", "twice.csv").endswith("The first of 60 such faults.")

    unknown = "".join(f"{letter}: 1\n" for letter in "abcdefghijklmnopq")
    Path("keys.yaml").write_text(f"schema_version: 7\n{unknown}", encoding="utf-8")
    shown = run("validate", "keys.yaml").stdout.splitlines()
    assert len(shown) <= 20
    assert "other faults" in shown[-1]
