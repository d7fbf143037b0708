"""`orthocal machine` and `template`: files that the program itself reads; the folder's machine."""

import contextlib
import re
import time
from pathlib import Path

import pytest

from orthoglide_cal.files.machine_file import default_machine, new_machine, read_machine_file
from orthoglide_cal.session.dialogue import session_file
from orthoglide_cal.session.events import Journal
from tests.printers import CONFIG
from tests.session.terminal import Terminal
from tests.session.virtual import opened, taken

from .program import SESSION, SIX, answer, done, refused, run

ANSWERS = (
    "--name", "Mill 3", "--leg-length", "400", "--width", "90", "--tool-offset", "25.5",
    "--limits", "-120", "80", "--workspace", "250", "--resolution", "0.001", "--range", "12.5",
    "--revolution", "0", "--repeatability", "0.002",
)  # fmt: skip


def test_options_make_the_machine() -> None:
    made = done("machine", "new", *ANSWERS, "--yes", "--output", "mine.yaml")
    machine = read_machine_file("mine.yaml").model.machine
    assert (machine.name, machine.leg_length_mm, machine.parallelogram_width_mm) == (
        "Mill 3", 400.0, 90.0,
    )  # fmt: skip
    assert (machine.tool_offset_mm, machine.joint_limits_mm) == (25.5, (-120.0, 80.0))
    assert (machine.workspace_mm, machine.gauge.revolution_mm) == (250.0, None)
    assert (machine.gauge.resolution_mm, machine.gauge.range_mm) == (0.001, 12.5)
    assert machine.gauge.repeatability_mm == 0.002
    assert dict(machine.tolerances) == dict(default_machine().machine.tolerances)
    text = Path("mine.yaml").read_text(encoding="utf-8")
    assert "# L, the parallelograms' length" in text
    assert "Pashkevich" not in text
    assert done("machine", "show", "mine.yaml") == made
    assert "\nleg_length_mm: 400.0\n" in made
    assert max(map(len, made.splitlines())) <= 80


def test_tolerances_are_options_too() -> None:
    given = ("--tolerance", "axis_gap=0.3", "--tolerance", "wrong_unit=0", "--yes")
    done("machine", "new", *given)
    known = dict(default_machine().machine.tolerances)
    tolerances = dict(read_machine_file("machine.yaml").model.machine.tolerances)
    assert tolerances == {**known, "axis_gap": 0.3, "wrong_unit": 0.0}
    # Every other line is as in the file that it was made from.
    text = Path("machine.yaml").read_text(encoding="utf-8")
    assert re.search(r"^  axis_gap: 0\.3 +# mm; usual assembly leaves", text, re.MULTILINE)


def test_an_existing_file_is_kept() -> None:
    Path("machine.yaml").write_text("mine")
    refused(2, "machine", "new", "--yes")
    assert Path("machine.yaml").read_text() == "mine"
    assert "not a machine file" in refused(3, "solve", SIX), "nor passed over for the prototype"


def test_a_folder_remembers_its_machine() -> None:
    run("machine", "new", "--name", "Mill 3", "--leg-length", "400", "--yes")
    assert answer("solve", SIX)["machine"]["name"] == "Mill 3"
    assert "machine.yaml" in run("solve", SIX).stderr
    assert answer("solve", SESSION)["machine"]["name"] == "Orthoglide prototype"
    run("machine", "new", "--name", "Mill 4", "--yes", "--output", "other.yaml")
    assert "machine.yaml, other.yaml" in refused(2, "solve", SIX)
    assert answer("solve", SIX, "--machine", "other.yaml")["machine"]["name"] == "Mill 4"
    assert run("solve", SESSION).exit_code in (0, 4)


@pytest.mark.parametrize("kind", ["readings", "differences", "touches", "machine"])
def test_a_template_is_a_file_that_the_program_takes(kind: str) -> None:
    shown = done("template", kind)
    assert shown.startswith("#")
    Path("template").write_text(shown, encoding="utf-8")
    machine = {"touches": ("--machine", str(CONFIG)), "machine": ("--machine", "template")}
    known = machine.get(kind, ())
    assert "note:" not in done("validate", "template", *known)
    data = SIX if kind == "machine" else "template"
    assert run("solve", data, *known).exit_code in (0, 4)
    # The one that is shipped is the one that would be made.
    assert kind != "machine" or shown == new_machine({"name": "my machine"}, "-").document.text


def test_the_start_page_follows_the_round(tmp_path: Path) -> None:
    assert "orthocal machine new" in done()
    run("machine", "new", "--name", "Mill 3", "--yes", "--practice")
    plain = Path("machine.yaml").read_text().replace("practice: true\n", "")
    assert "Mill 3" in done()
    assert "orthocal machine new" not in done()
    assert "orthocal measure --gauge simulated" in done()
    Path("begun.journal").write_text("")
    Path("later.journal").write_text("")
    assert re.search("measure begun.yaml --resume.*measure later.yaml --resume", done(), re.DOTALL)
    Path("begun.journal").unlink()
    Path("later.journal").unlink()
    run("simulate", "--offsets", "0.4", "0", "0", "--seed", "1", "--output", "one.yaml")
    assert "orthocal apply one.yaml" in done()
    done("apply", "one.yaml", "--yes")
    assert "orthocal measure\n" in done()
    assert "orthocal apply" not in done()
    # What is practised does not hold up what was measured.
    real = Path("one.yaml").read_text().replace("simulated, seed", "bench")
    real = real.replace(", simulated: 'yes'", "")
    Path("real").mkdir()
    with contextlib.chdir("real"):
        Path("one.yaml").write_text(real)
        Path("machine.yaml").write_text(plain)
        done("apply", "one.yaml", "--yes")
        begun = opened(source=("simulated",), seed=1)
        Journal.create(Path("practice.journal"), begun, taken(1, 0.1))
        first, second, third = re.findall("orthocal .*(?=\n)", done().partition("Next")[2])
        assert first == "orthocal measure"
        assert session_file(None, Path(), resume=False) == Path("session.yaml")
        assert second == "orthocal measure practice.yaml --resume"
        assert third == "orthocal measure practice.yaml --discard"
        Path("one.yaml").unlink()
        Path("one.csv").write_text("leg,posture,direction,reading_mm\nx,iso,y,0.1\n")
        assert re.search("orthocal .*", done().partition("Next")[2])[0].endswith(" one.csv")
        assert "asks before" in refused(2, *third.split()[1:])
        assert run(*third.split()[1:], "--yes").stderr == "Given up; kept as practice.discarded.\n"
        assert len(Journal.decode(Path("practice.discarded").read_bytes(), "j").events) == 2
        assert "no unfinished session" in refused(2, *third.split()[1:], "--yes")
    run("simulate", "--seed", "2", "--output", "two.yaml")
    assert "orthocal verify one.yaml two.yaml" in done()
    Path("second.yaml").write_text(Path("machine.yaml").read_text())
    assert "2 machine files" in done()


def test_a_wrong_answer_is_asked_again(tmp_path: Path) -> None:
    wrong = ("Mill 2", "<", "Mill 3", "abc", "-5", "620,5 mm")
    answers = (*wrong, "", "", "-100", "-700 20", "-150 90", *[""] * 4, "6", "0.006")
    with Terminal(tmp_path, command=("machine", "new"), agreed=False) as terminal:
        for answer in answers:
            terminal.expect(r"\]: $")
            terminal.type(answer)
        assert terminal.finish() == 0, terminal.seen
    machine = read_machine_file(tmp_path / "machine.yaml").model.machine
    assert (machine.name, machine.leg_length_mm) == ("Mill 3", 620.5)
    assert (machine.joint_limits_mm, machine.workspace_mm) == ((-150.0, 90.0), 400.0)
    assert "[-200 120]" in terminal.seen  # offered, as they follow from the leg, too
    for words in (
        "This is not a number.",
        "greater than zero",
        "beyond the leg's length",
        "repeatability of 6 mm",
    ):
        assert words in " ".join(terminal.seen.split())
    assert machine.gauge.repeatability_mm == 0.006
    assert terminal.seen.count("L, length of a leg") == 4
    assert "workspace_mm" not in terminal.seen.partition("Machine: ")[0]


def test_an_interrupted_question_leaves_nothing(tmp_path: Path) -> None:
    with Terminal(tmp_path, command=("machine", "new"), agreed=False) as terminal:
        terminal.expect(r"\]: $")
        # Between showing the prompt and waiting for a key Python's readline loses a signal.
        time.sleep(0.3)
        terminal.child.sendintr()
        assert terminal.finish() == 130
    assert not (tmp_path / "machine.yaml").exists()


def test_alone_it_shows_first_how_to_correct_the_machine_file() -> None:
    Path("machine.yaml").write_text("kind: orthoglide\nleg_lenght_mm: 310\n", encoding="utf-8")
    shown = done()
    assert "machine.yaml cannot be used" in shown
    assert re.findall("orthocal [a-z].*", shown) == ["orthocal validate machine.yaml"]
