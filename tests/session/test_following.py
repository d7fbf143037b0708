"""Going on from readings: recommended, guided, written with the first ones; killed; refused."""

import contextlib
import json
import re
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.machine_file import default_machine, read_machine_file
from orthoglide_cal.files.text import read_document
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.planning.next_measurement import rank_measurements
from orthoglide_cal.planning.steps import GIVES_UP
from orthoglide_cal.report.sentences import sentence
from orthoglide_cal.session import dialogue as opening
from orthoglide_cal.session.asking import Asker
from orthoglide_cal.session.dialogue import Request, open_session, planned_next
from orthoglide_cal.session.events import RECORD, Taken, replay
from orthoglide_cal.session.readings import PriorReadings
from tests.cli.program import done, refusals, refuses
from tests.machines import ROOT, SAMPLES
from tests.printer_files import OFF, printer_cfg
from tests.truth.delta import V400

from .going_on import SIMULATED, choice, content, events_of, is_step, is_turn, is_usual, read
from .terminal import Terminal, finished, refused, run_program
from .virtual import Screen, Script, without_times


def test_the_best_recommendation_is_shown_guided_and_joined(first: Path, tmp_path: Path) -> None:
    before = first.read_bytes()
    given = read_input(str(first))
    best = rank_measurements(diagnose(given.measured, given.model))[0]
    shown = finished(tmp_path, "b.yaml", "--then", str(first), "--yes")
    words = " ".join(shown.split())
    assert f"Next, about {best.minutes:.0f} min: {sentence(best.what)}" in words
    assert f"about {best.minutes:.0f} min. ? is help." in words
    assert first.read_bytes() == before
    old, new = read(first), read(tmp_path / "b.yaml")
    n = len(old)
    assert len(new) == n + len(best.plan)
    assert new.value[:n].tolist() == old.value.tolist()
    assert new.value[n : n + 2].tolist() != old.value[:2].tolist()  # other noise, other zeros
    assert "Offsets so far" not in shown  # they wait for the end
    assert "More: orthocal solve b.yaml --details" in shown
    assert new.plan.hours[:n] == pytest.approx(old.plan.hours, abs=1e-7)
    for name in ("leg", "direction", "displacement", "gauge_at", "part", "turned", "entered"):
        wanted = getattr(best.plan, name)[best.plan.in_time]
        assert getattr(new.plan, name)[n:].tolist() == wanted.tolist()
    assert np.all(np.diff(new.plan.hours[new.plan.in_time]) >= 0.0)
    assert new.plan.order.tolist() == list(range(len(new)))
    # The zeros are new ones, and all that is known of the first readings is still there.
    assert not set(new.plan.setup[:n]) & set(new.plan.setup[n:])
    rows = [{**row, "simulated": "yes"} for row in content(first)["readings"]]
    assert content(tmp_path / "b.yaml")["readings"][:n] == rows


def test_what_is_agreed_to_is_what_is_recorded(
    first: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is planned once: nothing else can be recorded than what was shown."""
    planned: list[Any] = []

    def plan(*given: Any) -> Any:
        planned.append(made := planned_next(*given))
        return made

    monkeypatch.setattr(opening, "planned_next", plan)
    request = Request(tmp_path / "n.yaml", agreed=True, following=str(first))
    with contextlib.ExitStack() as opened:
        open_session(request, Asker(Script([]), Screen()), opened)
    ((_, following, _),) = planned
    recorded = events_of(tmp_path / "n.journal")[1]
    assert recorded.following == following


def test_a_known_step_is_commanded_and_seen(first: Path, tmp_path: Path) -> None:
    """At the isotropic posture the legs are at right angles: a carriage x that is commanded short
    moves the tool by as much along x, and a gauge half-way along leg z sees half of it.

    The true joint is the commanded one and the offset: nothing is entered, nothing put back.
    """
    shown = finished(tmp_path, "s.yaml", *choice(first, is_step))
    words = " ".join(shown.split())
    assert "drive as before but with carriage x 0.3 mm short, as the screen shows" in words
    assert "leg Z, ISO, carriage X 0.3 mm short, cycle 1 of 1." in words
    # At the isotropic posture, and at the highest one, of the prototype.
    assert "joints X 309.950 Y 310.250 Z 310.250 mm tool X -0.300 Y 0.000 Z 0.000 mm" in words
    assert "joints X 304.093 Y 304.393 Z 370.250 mm tool" in words
    guided = shown.partition("Session complete")[0]
    assert "Enter" not in guided
    assert "Put the old offset back" not in shown
    assert "block N" not in shown.lower()
    assert "Do not touch the stands: they must be where they were" in shown
    new = read(tmp_path / "s.yaml")
    assert new.plan.parts == 1
    assert new.plan.entered[24:].tolist() == [[0.3, 0.0, 0.0]] * (len(new) - 24)
    assert new.plan.setups == 6
    # The stands stay where they are, and so do the gauges on them, though nobody names them again.
    directions = zip(new.plan.leg.tolist(), new.plan.direction.tolist(), strict=True)
    stand_b = [direction > min({0, 1, 2} - {leg}) for leg, direction in directions]
    assert list(new.gauge) == ["AB"[second] for second in stand_b]
    iso = (new.plan.leg == 2) & (new.plan.direction == 0) & (new.plan.displacement == 0.0)
    stepped = new.plan.entered[:, 0] > 0.0
    seen = new.value[iso & stepped].mean() - new.value[iso & ~stepped].mean()
    assert seen == pytest.approx(-0.15, abs=0.03)
    places = re.findall(r"Drive to  joints(.*)\n +tool (.*)", shown)
    assert len(places) >= 4
    for joints, tool in places:  # by the spheres of the independent truth
        j, t = (np.array(re.findall(r"-?[0-9.]+", text), float) for text in (joints, tool))
        assert np.linalg.norm(np.diag(j) - t, axis=1) == pytest.approx([310.25] * 3, abs=2e-3)
    # The repeats go on counting.
    assert new.cycle[iso].tolist() == [1, 2, 1, 2]


def test_a_joined_session_is_gone_on_with_as_part_three(first: Path, tmp_path: Path) -> None:
    """A bar turned in part 2 is turned back for part 3; every command takes all three parts."""
    turned = finished(tmp_path, "b.yaml", *choice(first, is_turn))
    words = " ".join(turned.split())
    assert "Turn the bar of leg Y, unless it is turned already: loosen both ends" in words
    assert "(what faced +X and +Z then faces away)" in words
    assert "Before the next session, turn the bar of leg Y back." in turned
    assert max(map(len, turned.split("\n"))) <= 80
    shown = finished(tmp_path, "c.yaml", *choice(tmp_path / "b.yaml", is_usual))
    assert "0. Turn the bar of leg Y back" in shown
    b, c = read(tmp_path / "b.yaml"), read(tmp_path / "c.yaml")
    assert c.plan.part.tolist() == [0] * 24 + [1] * (len(b) - 24) + [2] * (len(c) - len(b))
    assert b.plan.turned.tolist() == (b.plan.part == 1).tolist()
    assert c.value[: len(b)].tolist() == b.value.tolist()
    assert c.plan.order.tolist() == list(range(len(c)))
    assert np.all(np.diff(c.plan.hours) >= 0.0)
    origins = str(content(tmp_path / "c.yaml")["environment"])
    assert all(f"{name}.yaml (" in origins for name in "ab")
    entered = [f"{offset:.3f}" for offset in solve(c, default_machine()).offsets_mm]
    left = ("after.yaml", "--cycles", "1", *SIMULATED, "--offsets-active", *entered)
    finished(tmp_path, *left)
    ways = [(name, "c.yaml") for name in ("solve", "diagnose", "report", "validate")]
    with contextlib.chdir(tmp_path):
        for command in (*ways, ("verify", "c.yaml", "after.yaml")):
            done(*command)


def test_a_table_is_gone_on_with(tmp_path: Path) -> None:
    """Typed readings of another part behind those of a CSV without times get none either."""
    sample = (SAMPLES / "double_posture_session.csv").read_text()
    sample = re.sub("(?m),[^,]*$", ",yes", sample).replace("yes", "simulated", 1)
    (tmp_path / "a.csv").write_text(sample)
    shown = finished(
        tmp_path,
        "b.yaml",
        *choice(tmp_path / "a.csv", is_turn),
        stdin="0.1\nk\n0.2\nk\ns all enough\n",
    )
    assert shown.startswith("SIMULATED: ")
    old, new = read(tmp_path / "a.csv"), read(tmp_path / "b.yaml")
    n = len(old)
    assert new.value.tolist() == [*old.value.tolist(), 0.1, 0.2]
    assert new.plan.setup[:n].tolist() == old.plan.setup.tolist()
    assert (old.timed, new.timed) == (False, False)
    assert new.plan.part[n:].tolist() == [1, 1]


@pytest.mark.parametrize(
    ("finished", "began", "wanted"),
    [
        ("2025-03-01T09:00:00+01:00", "2025-03-01T09:30:00+01:00", 30.0),
        ("2025-03-01T08:00:00+00:00", "2025-03-01T09:30:00+01:00", 30.0),
        ("2025-03-01T09:00:00", "2025-03-01T09:30:00+01:00", 30.0),
        ("2025-03-01T09:00:00+01:00", "2025-03-01T08:30:00+01:00", 0.0),  # a clock set back
        ("2025-02-28T09:00:00+01:00", "2025-03-01T09:30:00+01:00", 0.0),  # another day
        (None, "2025-03-01T09:30:00+01:00", 0.0),
    ],
)
def test_the_clock_runs_on_the_same_day(
    first: Path, tmp_path: Path, finished: str | None, began: str, wanted: float
) -> None:
    line = f"finished: {finished!r}" if finished else "finished: null"
    path = tmp_path / "a.yaml"
    path.write_text(re.sub("(?m)^finished: .*$", line, first.read_text()))
    file = read_document(str(path))
    joined = PriorReadings(file, read_input(file, default_machine()))
    last = float(joined.readings.plan.hours.max()) * 60.0
    assert joined.minutes(began, 1.5) == pytest.approx(last + wanted + 1.5, abs=2e-4)
    least = joined.minutes(began, 0.0)
    assert least >= last


def test_the_best_design_says_what_it_gives_up_and_keeps_its_steps(tmp_path: Path) -> None:
    shown = finished(tmp_path, "b.yaml", "--design", "best", "--cycles", "2", *SIMULATED)
    assert GIVES_UP in " ".join(shown.split())
    new = read(tmp_path / "b.yaml")
    assert content(tmp_path / "b.yaml")["protocol"] == "best-design"
    at = set(new.plan.gauge_at.tolist())
    assert len(at) == 1
    place = at.pop() * 310.25
    assert f"{place:.0f} mm from the carriage" in shown
    _, planned, *taken = events_of(tmp_path / "b.journal")
    assert planned.following is None
    assert len(planned.readings) == sum(isinstance(event, Taken) for event in taken)


def test_the_machine_file_says_what_was_applied_meanwhile(tmp_path: Path) -> None:
    """And, once that is taken back, the other way round."""
    machine = (ROOT / "configs/orthoglide_prototype.yaml").read_text()
    (tmp_path / "machine.yaml").write_text(f"{machine}practice: true\n")
    finished(tmp_path, "a.yaml", "--cycles", "1", *SIMULATED)
    with contextlib.chdir(tmp_path):
        done("apply", "a.yaml", "--yes")
        entered = read_machine_file(str(tmp_path / "machine.yaml")).model.machine.offsets_mm
        assert any(entered)
    assert "Since" in finished(tmp_path, "b.yaml", *choice(tmp_path / "a.yaml", is_usual))
    assert read(tmp_path / "b.yaml").plan.entered[-1] == pytest.approx(entered)
    with contextlib.chdir(tmp_path):
        done("apply", "--undo", "--yes")
    shown = finished(tmp_path, "c.yaml", *choice(tmp_path / "b.yaml", is_usual))
    assert "changed by" in " ".join(shown.split())
    new = read(tmp_path / "c.yaml")
    assert new.plan.entered[-1].tolist() == [0.0, 0.0, 0.0]
    found = solve(new, default_machine())
    hidden = np.random.default_rng([7, 0]).uniform(-1.5, 1.5, 3)
    assert np.all(np.abs(found.offsets_mm - hidden) < 5.0 * found.budget.std_mm)


HERE = Path(__file__).parent


def test_a_killed_session_needs_nothing_but_its_journal(first: Path, tmp_path: Path) -> None:
    """Killed in the program before any reading, and after several; FILE is gone meanwhile.

    What is measured is said once at the beginning, and again where it is gone on with.
    """
    copy = tmp_path / "a.yaml"
    copy.write_bytes(first.read_bytes())
    arguments = choice(copy, is_step)
    whole = run_program(tmp_path, "whole.yaml", *arguments)
    assert whole.returncode == 0
    options: tuple[str, ...] = arguments[:-1]
    for kill_at in (1, 2, 4, 7):
        with Terminal(tmp_path, "k.yaml", *options) as terminal:
            while terminal.step() != kill_at:
                terminal.type("")
            terminal.child.kill(signal.SIGKILL)
        copy.unlink(missing_ok=True)
        options = ("--resume",)
    shown = finished(tmp_path, "k.yaml", "--resume")
    for text in (whole.stdout, shown):
        assert " ".join(text.split()).count("Without touching the stands") == 1, text
    expected = without_times((tmp_path / "whole.yaml").read_text())
    assert without_times((tmp_path / "k.yaml").read_text()) == expected


def test_what_is_read_comes_back_as_it_was_written(first: Path, tmp_path: Path) -> None:
    finished(tmp_path, "s.yaml", *choice(first, is_step))
    begun, planned, *_ = events_of(tmp_path / "s.journal")
    assert begun.version == 2
    assert RECORD.validate_json(json.dumps(planned.model_dump())) == planned
    assert planned.following.data.text == first.read_text()
    assert {reading.entered for reading in planned.readings} == {(0.3, 0.0, 0.0)}
    record = planned.model_dump()
    for spoilt in ({"leg": "x"}, {"contact": 9}, {"entered": [0.3, 0.0]}, {"turned": 1}):
        readings = [{**record["readings"][0], **spoilt}]
        with pytest.raises(ValueError, match=r"\w"):
            RECORD.validate_json(json.dumps({**record, "readings": readings}))
    # Without it nothing is read.
    alone, *_ = (tmp_path / "s.journal").read_bytes().splitlines(keepends=True)
    (tmp_path / "1.journal").write_bytes(alone)
    assert "or another reading for it" in refused(3, tmp_path, "1.yaml", "--resume")


@pytest.mark.parametrize("cut", [1, 2, 12, 25, 26])
def test_journals_of_version_1_go_on_to_the_session_that_their_program_wrote(
    tmp_path: Path, cut: int
) -> None:
    """Written, whole, by the last program that knew version 1 only; its simulated gauge, too."""
    lines = (HERE / "whole_version_1.journal").read_bytes().splitlines(keepends=True)
    (tmp_path / "s.journal").write_bytes(b"".join(lines[:cut]))
    finished(tmp_path, "s.yaml", "--resume")
    expected = without_times((HERE / "whole_version_1.yaml").read_text())
    assert without_times((tmp_path / "s.yaml").read_text()) == expected
    first = events_of(tmp_path / "s.journal")[0]
    assert replay([first]).planned is None


@pytest.mark.parametrize("line", refusals(HERE / "refused_then.txt"))
def test_what_cannot_be_gone_on_with_is_refused(
    first: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("printer.cfg").write_text(printer_cfg(V400, OFF), encoding="utf-8")
    refuses(line, "measure", "n.yaml", "--yes", "--then", str(first))
    assert [path.name for path in tmp_path.iterdir()] == ["printer.cfg"]


def test_the_first_file_is_never_the_new_one(first: Path) -> None:
    before = first.read_bytes()
    for name in ("a.yaml", "a"):
        assert "never changed" in refused(2, first.parent, name, "--then", "a.yaml", "--yes")
    assert first.read_bytes() == before


def test_stands_that_were_pushed_are_not_gone_on_with(first: Path, tmp_path: Path) -> None:
    """New offsets act once the machine was homed."""
    given = (*choice(first, is_step), "--offsets-active", "0.5", "0", "0")
    assert "changed since the last reading" in refused(2, tmp_path, "n.yaml", *given)
    assert not list(tmp_path.iterdir())
