"""`orthocal apply --to`: three values in the controller's file, and the way back."""

import os
import re
import signal
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import yaml

from orthoglide_cal.files.controller_file import ControllerFile, replace_file
from tests import truth
from tests.files.test_controller_file import CFG, INI
from tests.linuxcnc import HOME, LinuxCnc, missing
from tests.printer_files import OFF, printer_cfg
from tests.truth.delta import Delta
from tests.truth.forward import Disturbance
from tests.truth.plan import standard_plan

from .program import FIRST, answer, done, refused, run, words
from .test_apply import history, to_practise

TRUE = np.array([0.21, -0.34, 0.12])  # true joint offsets of a machine with a real controller [mm]


@pytest.fixture(autouse=True)
def controller(to_apply: None) -> None:
    Path("mill.ini").write_text(INI, encoding="utf-8")


def offsets() -> list[float]:
    joints, _ = Path("mill.ini").read_text(encoding="utf-8").split("[SPINDLE_0]")
    return [float(text) for text in re.findall(r"^ *HOME_OFFSET ?= ?(\S+)", joints, re.MULTILINE)]


def to_enter() -> list[float]:
    return [parameter["enter"] for parameter in answer("solve", "before.csv")["parameters"]]


def test_what_is_found_is_added_and_recorded_and_comes_back() -> None:
    machine = Path("machine.yaml").read_text(encoding="utf-8")
    found = to_enter()
    by = "--machine", "machine.yaml"
    said = " ".join(done("apply", "before.csv", "--to", "mill.ini", "--yes", *by).split())
    assert "first time" in said
    assert "x [JOINT_0] HOME_OFFSET" in said
    assert all(f"{typed} --machine machine.yaml" in said for typed in ("measure", "csv AFTER"))
    expected = [a + b for a, b in zip((0.5, -12.25, 0.0), found, strict=True)]
    assert offsets() == pytest.approx(expected, abs=1e-9)
    (entry,) = history()
    assert entry["written"]["target"] == str(Path("mill.ini").resolve())
    assert [float(value["after"]) for value in entry["written"]["values"]] == offsets()
    assert "--to" in refused(2, "apply", "--undo", "--yes")
    assert "Restart LinuxCNC" in done("apply", "--undo", "--to", "mill.ini", "--yes")
    assert Path("mill.ini").read_text(encoding="utf-8") == INI
    assert not history()
    assert machine.splitlines()[0] in Path("machine.yaml").read_text(encoding="utf-8")


def test_nothing_is_written_without_consent() -> None:
    before = {path.name: path.read_bytes() for path in Path().iterdir()}
    assert "--yes" in refused(2, "apply", "before.csv", "--to", "mill.ini")
    for path in map(Path, ("mill.ini", "machine.yaml")):  # nor shown, where it cannot be
        path.chmod(0o444)
        said = refused(3, "apply", "before.csv", "--to", "mill.ini", "--yes")
        assert f"{path}: The file is read-only. Make it writable" in said
        path.chmod(0o644)
    assert {path.name: path.read_bytes() for path in Path().iterdir()} == before


def test_what_somebody_changed_since_is_not_written_over() -> None:
    done("apply", "before.csv", "--to", "mill.ini", "--yes")
    after = truth.second_session(FIRST, 7)
    truth.write_readings(after, Path("after.csv"))
    written = Path("mill.ini").read_bytes()
    text = written.decode().replace("-12", "-13").replace("-11", "-13")
    Path("mill.ini").write_text(text, encoding="utf-8")
    assert "Somebody changed it" in refused(2, "apply", "after.csv", "--to", "mill.ini", "--yes")
    assert "changed since" in refused(2, "apply", "--undo", "--to", "mill.ini", "--yes")
    assert Path("mill.ini").read_text(encoding="utf-8") == text
    # Nor is the INI of another machine; one that was moved holds what was written.
    Path("other.ini").write_text(INI, encoding="utf-8")
    assert "written to" in refused(2, "apply", "after.csv", "--to", "other.ini", "--yes")
    assert Path("other.ini").read_text(encoding="utf-8") == INI
    assert len(history()) == 1
    Path("other.ini").write_bytes(written)
    assert "first time" not in done("apply", "after.csv", "--to", "other.ini", "--yes")


@pytest.mark.parametrize(
    ("content", "said"),
    [("# nothing\n", "known controller"),
     (CFG, "Name the file of its own controller"),
     ("[printer]\nkinematics: delta\n", "SAVE_CONFIG")],
)  # fmt: skip
def test_a_file_that_cannot_be_written_leaves_everything(content: str, said: str) -> None:
    Path("mill.ini").write_text(content, encoding="utf-8")
    result = run("apply", "before.csv", "--to", "mill.ini", "--yes")
    assert result.exit_code in (2, 3)
    assert said in words(result.stderr)
    assert Path("mill.ini").read_text(encoding="utf-8") == content
    assert history() == []


@pytest.mark.parametrize("on", ["again", "undo", "changed by hand"])
def test_killed_between_the_two_files_it_goes_on(on: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def killed(target: str, before: str, data: bytes) -> None:
        if target.endswith(".ini"):
            raise KeyboardInterrupt
        replace_file(target, before, data)

    with monkeypatch.context() as patch:
        patch.setattr("orthoglide_cal.results.application.replace_file", killed)
        run("apply", "before.csv", "--to", "mill.ini", "--yes")
    assert Path("mill.ini").read_text(encoding="utf-8") == INI
    assert len(history()) == 1
    assert "was not written" in " ".join(done().split())
    if on == "changed by hand":
        # What is active is neither what was entered nor what was before: nobody knows more.
        record, (entry,) = Path("machine.yaml"), history()
        entered = f"offsets_mm: {{x: {entry['after']['x']}"
        text = record.read_text(encoding="utf-8")
        assert entered in text
        changed = text.replace(entered, "offsets_mm: {x: 0.111")
        record.write_text(changed, encoding="utf-8")
        said = refused(2, "apply", "before.csv", "--to", "mill.ini", "--yes")
        assert "changed by hand" in said
        assert record.read_text(encoding="utf-8") == changed
        return
    if on == "again":
        told: list[str] = []

        def live(ini: ControllerFile, *, anew: bool = False) -> bool:
            """A LinuxCNC with these offsets runs here."""
            told.extend(value.before for value in ini.settings.values() if anew)
            return True

        with monkeypatch.context() as patch:
            patch.setattr("orthoglide_cal.files.controller_file.LinuxCnc.is_live", live)
            said = done("apply", "before.csv", "--to", "mill.ini", "--yes")
        assert "Restart" not in said  # homing is enough
        assert [float(text) for text in told] == offsets() != [0.5, -12.25, 0.0]
        assert len(history()) == 1
        assert "was not written" not in " ".join(done().split())
        done("apply", "--undo", "--to", "mill.ini", "--yes")
    else:
        done("apply", "--undo", "--to", "mill.ini", "--yes")
    assert Path("mill.ini").read_text(encoding="utf-8") == INI
    assert history() == []


def killed(change: int, *arguments: str) -> bool:
    """Whether a command was killed right before its n-th change of a file; else it came to an end.

    A copy of this process runs it and kills itself.
    """
    if child := os.fork():
        return os.WIFSIGNALED(os.waitpid(child, 0)[1])
    changes = count(1)

    def kill(event: str, given: tuple[object, ...]) -> None:
        writes = event == "open" and isinstance(given[2], int) and given[2] & os.O_ACCMODE
        if (writes or event in ("os.rename", "os.link", "os.remove")) and next(changes) == change:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(kill)
    try:
        run(*arguments)
    finally:
        os._exit(0)


@pytest.mark.slow
@pytest.mark.parametrize("target", ["mill.ini", "printer.cfg"])
def test_killed_at_any_change_of_a_file_it_loses_nothing(target: str) -> None:
    """Each file is whole, the record says more than the controller, and the way on is open."""
    measured, record = target, Path("printer.yaml")
    if target == "mill.ini":
        measured, record = "before.csv", accepted_scale()
        limits = "MIN_LIMIT = -400\nMAX_LIMIT = 400\nHOME_OFFSET ="
        Path(target).write_text(re.sub(r"(?m)^ *HOME_OFFSET ?=", limits, INI), encoding="utf-8")
    else:
        Path(target).write_text(printer_cfg(Delta(), OFF), encoding="utf-8")
    entering = "apply", measured, "--to", target, "--yes"
    undoing = "apply", "--undo", "--to", target, "--yes"
    original = Path(target).read_bytes()
    done(*entering)
    written = Path(target).read_bytes()
    tables = {path: path.read_bytes() for path in Path().glob("*.comp")}
    assert len(tables) == 2 * (target == "mill.ini")
    kills = 0
    for command, other, end in ((entering, undoing, written), (undoing, entering, original)):
        for change in count(1):
            run(*other)
            assert Path(target).read_bytes() == (written if end == original else original)
            if not killed(change, *command):
                break
            kills += 1
            held, content = Path(target).read_bytes(), yaml.safe_load(record.read_text("utf-8"))
            assert held in (original, written)
            assert len(content.get("history") or []) in ((1,) if held == written else (0, 1))
            # A missing table makes LinuxCNC unusable.
            assert held == original or all(path.read_bytes() == tables[path] for path in tables)
            # Once more, if it was not done already.
            run(*command)
            assert Path(target).read_bytes() == end
    assert kills > 10
    assert all(path.name.startswith(".") for path in Path().iterdir() if path.suffix == ".tmp")


def accepted_scale() -> Path:
    """The machine file, in which the scales of x and y are known, of gauge blocks."""
    scale = {axis: {"value": 0.3 * (axis != "z"), "std": 0.01, "unit": "1e-3"} for axis in "xyz"}
    entry = {"cause": "encoder_scale", "date": "2026-01-01", "data_sha256": 64 * "0"}
    with (path := Path("machine.yaml")).open("a", encoding="utf-8") as file:
        file.write(yaml.safe_dump({"identified": [{**entry, "parameters": scale}]}))
    return path


@pytest.mark.skipif(missing() is not None, reason=str(missing()))
def test_a_real_linuxcnc_moves_by_what_was_promised() -> None:
    with LinuxCnc() as machine:
        original, before = machine.ini.read_bytes(), machine.homed_by
        found = to_enter()
        done("apply", "before.csv", "--to", str(machine.ini), "--yes")
        # Told to the running controller: it homes by as much more as was promised.
        left = np.subtract(before, found)
        assert machine.home() == pytest.approx(left, abs=2e-5)
        machine.stop()
        machine.start()
        assert machine.homed_by == pytest.approx(left, abs=2e-5)
        done("apply", "--undo", "--to", str(machine.ini), "--yes")
        assert machine.home() == pytest.approx(before, abs=2e-5)
        assert machine.ini.read_bytes() == original
        # Of another file, or of a file that was changed since it started, it is told nothing.
        other = Path("mill.ini")
        unlike = (other, f"settings, {machine.ini}"), (machine.ini, "other home offsets")
        for path, said in unlike:
            path.write_bytes(original.replace(b"= 0.5", b"= 0.75"))
            told = run("apply", "before.csv", "--to", str(path), "--yes")
            assert told.exit_code == 0
            assert said in words(told.stderr)
            assert "homing" not in told.stdout + told.stderr
            done("apply", "--undo", "--to", str(path), "--yes")
            assert machine.home() == pytest.approx(before, abs=2e-5)


@pytest.mark.parametrize("form", ["csv", "yaml"])
def test_what_was_simulated_reaches_no_machine(form: str) -> None:
    """Nor does a file of which one row was, with whatever option; a file for practice takes it."""
    name, before = f"s.{form}", Path("machine.yaml").read_bytes()
    done("simulate", "--offsets", "1", "-0.8", "0.6", "--seed", "3", "-o", name)
    rows = Path(name).read_text(encoding="utf-8")
    one_only = rows.replace("yes", "", rows.count("yes") - 1)
    if form == "yaml":
        one_only = rows.replace("simulated, seed", "seed").replace(", simulated: 'yes'", "", 59)
    assert "yes" in one_only
    Path("mixed.csv").write_text(one_only, encoding="utf-8")
    Path("mill.ini").write_text(INI, encoding="utf-8")
    for file in (name, "mixed.csv"):
        solved = run("solve", file).stdout
        assert solved.startswith("SIMULATED: no machine was measured.\n✔ The offsets may be")
        assert "orthocal apply" not in solved
        assert answer("solve", file)["simulated"] is True
        for more in ((), ("--force",), ("--format", "table", "--force")):
            assert "are simulated" in refused(4, "export", file, *more)
        assert "are simulated" in refused(4, "apply", file, "--yes")
        assert "are simulated" in refused(4, "apply", file, "--yes", "--to", "mill.ini")
    assert Path("machine.yaml").read_bytes() == before
    to_practise()
    assert "are simulated" in refused(4, "apply", name, "--yes", "--to", "mill.ini")
    assert Path("mill.ini").read_text(encoding="utf-8") == INI
    assert done("apply", name, "--yes").startswith("SIMULATED")
    assert len(history()) == 1


def test_a_machine_file_for_practice_reaches_no_controller() -> None:
    """Real readings are recorded in it; a controller takes what a real machine's file judges."""
    Path("machine.yaml").rename("mill.yaml")
    real = Path("mill.yaml").read_bytes()
    Path("machine.yaml").write_bytes(real + b"practice: true\n")
    by = "--machine", "machine.yaml"
    assert "orthocal export" in done("solve", "before.csv", "--machine", "mill.yaml", "--details")
    assert "orthocal export" not in done("solve", "before.csv", *by, "--details")
    for command in (["export"], ["apply", "--to", "mill.ini", "--yes"]):
        assert "made for practice" in refused(4, *command, "before.csv", *by)
    assert Path("mill.ini").read_text(encoding="utf-8") == INI
    done("apply", "before.csv", *by, "--yes")
    assert len(history()) == 1
    done("apply", "before.csv", "--to", "mill.ini", "--yes", "--machine", "mill.yaml")
    assert Path("mill.ini").read_text(encoding="utf-8") != INI


def measured_at(machine: LinuxCnc, name: str, seed: int) -> None:
    """Gauges read by the independent truth where a controller's carriages really stand.

    The machine of `truth.LARGE` with offsets TRUE; at first the controller homed by HOME.
    """
    rng = np.random.default_rng(seed)
    plan = standard_plan(truth.LARGE, rng, cycles=2)
    stands = list[list[float]]()
    for row, joints in enumerate(plan.indicated - truth.LARGE.leg):
        if not row or np.any(plan.indicated[row] != plan.indicated[row - 1]):
            machine.drive(*joints.round(6).tolist())
        stands.append(machine.carriages_mm())
    motion = np.array(stands) + HOME - (plan.indicated - truth.LARGE.leg)
    session = truth.measure(truth.LARGE, truth.MICRON, plan, TRUE, (), rng)
    session = replace(session, disturbance=Disturbance.of(plan, motion=motion))
    truth.write_readings(replace(session, readings=session.gauges_show(plan, rng)[1]), Path(name))


@pytest.mark.skipif(missing() is not None, reason=str(missing()))
def test_a_real_linuxcnc_corrects_lost_motion_and_scale() -> None:
    """Gauges hardly show a scale of 0.3e-3: gauge blocks have, and it was accepted."""
    accepted_scale()
    with LinuxCnc(lost_mm=(0.05, 0.05, 0.0), excess=(3e-4, 3e-4, 0.0)) as machine:
        noise = truth.MICRON.sigma
        measured_at(machine, "before.csv", 1)
        assert answer("solve", "before.csv")["rms"]["after_mm"] < 1.2 * noise
        assert [one["id"] for one in answer("diagnose", "before.csv")["causes"]] == ["backlash"]
        machine.stop()
        said = answer("apply", "before.csv", "--to", str(machine.ini), "--yes")
        assert "no_origin" in [one["left"] for one in said["corrections"]]
        done("apply", "--undo", "--to", str(machine.ini), "--yes")
        # The isotropic posture is at 420 or at 0: only these limits tell. It has a table already.
        narrow = re.sub(rb"(M\w\w_LIMIT = -?)500", rb"\g<1>400", machine.ini.read_bytes())
        narrow = narrow.replace(b"HOME = 0.0\n", b"HOME = 0.0\nCOMP_FILE = old.comp\n", 1)
        machine.ini.write_bytes(narrow)
        table = machine.folder / "old.comp"
        table.write_text("-400 -400 -400\n400 400 400\n")
        said = answer("apply", "before.csv", "--to", str(machine.ini), "--yes")
        made = [(one["id"], one["name"]) for one in said["corrections"] if not one["left"]]
        assert made == [(id, axis) for id in ("encoder_scale", "backlash") for axis in "xy"]
        machine.start()
        measured_at(machine, "after.csv", 2)
        after = answer("solve", "after.csv")
        # With the standard deviation of an r.m.s. of 36 residuals, doubled for 95 %.
        assert after["rms"]["before_mm"] == pytest.approx(noise, rel=2.0 / np.sqrt(2.0 * 36.0))
        assert not after["release"]["needed"]
        assert answer("verify", "before.csv", "after.csv")["kept"]
        machine.stop()
        done("apply", "--undo", "--to", str(machine.ini), "--yes")
        assert machine.ini.read_bytes() == narrow
        assert list(machine.folder.glob("*.comp")) == [table]
        assert table.read_text() == "-400 -400 -400\n400 400 400\n"
        machine.start()
