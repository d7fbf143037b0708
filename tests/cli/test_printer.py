"""Printers from the command line: what is shown of them, refused, and what comes next."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files import read_machine
from orthoglide_cal.model import Model
from orthoglide_cal.model.linear_delta import LinearDelta
from tests.cli.program import SIX, lines, run
from tests.machines import ROOT
from tests.printer_files import OFF, exact, machine_yaml, printer_cfg
from tests.truth.delta import KOSSEL, V400, Layout, Truth, delta_csv, probe_bed

TRUE = {
    "a": V400.endstops[0] + OFF.endstops[0],
    "b": V400.endstops[1] + OFF.endstops[1],
    "c": V400.endstops[2] + OFF.endstops[2],
    "radius": V400.radius + OFF.radius,
    "angle_a": V400.angles[0] + OFF.angles[0],
    "angle_b": V400.angles[1] + OFF.angles[1],
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("v400.yaml").write_text(machine_yaml(V400).replace("  backlash: 0.05\n", ""))


def cfg(name: str = "printer.cfg", truth: Truth = OFF, machine=V400, **more) -> str:
    Path(name).write_text(printer_cfg(machine, truth, **more))
    return name


def touches(count: int, heights: tuple[float, ...] = (0.0,)) -> str:
    Path("t.csv").write_text(exact(V400, OFF, Layout(places=count, heights=heights)))
    return "t.csv"


@pytest.mark.parametrize("data", ["calibration", "mesh"])
def test_solve_tells_the_parameters_themselves(data: str) -> None:
    done = run("solve", cfg(), "--data", data, "--json")
    (found,) = lines(done)
    told = found["parameters"]
    assert list(told) == list(TRUE)
    assert [told[name]["unit"] for name in told] == ["mm"] * 4 + ["deg"] * 2
    for name, true in TRUE.items():
        low, high = told[name]["ci95"]
        assert low < told[name]["value"] < high
        # U covers the arms as well, which are right here: six standard deviations of the noise.
        assert abs(told[name]["value"] - true) < told[name]["expanded"]
    for key in ("offsets_mm", "std_mm", "ci95_mm", "expanded_mm"):
        assert list(found[key]) == ["a", "b", "c"]
    assert found["offsets_mm"]["a"] == told["a"]["value"]
    assert found["rms_after_mm"] < found["rms_before_mm"]
    assert {each["source"] for each in found["budget"]} >= {"noise", "bed_texture", "leg_length"}


def test_the_calibration_is_what_is_taken_where_there_is_one() -> None:
    name = cfg()
    plain, stored = (
        lines(run("solve", name, *more, "--json"))[0] for more in ((), ("--data", "calibration"))
    )
    assert plain["offsets_mm"] == stored["offsets_mm"]
    assert plain["input"]["readings"] == 7 + 3
    assert lines(run("solve", name, "--data", "mesh", "--json"))[0]["input"]["readings"] > 40


def test_data_is_refused_for_other_files() -> None:
    prototype = str(ROOT / "configs" / "orthoglide_prototype.yaml")
    for file, machine in ((SIX, prototype), (touches(13), "v400.yaml")):
        done = run("solve", file, "--data", "mesh", "--machine", machine)
        assert done.exit_code == 2
        assert "--data is for a printer.cfg" in done.stderr


def test_three_touches_say_what_is_missing_and_what_to_add() -> None:
    file = touches(13)
    Path(file).write_text("".join(Path(file).read_text().splitlines(keepends=True)[:4]))
    done = run("solve", file, "--machine", "v400.yaml")
    assert done.exit_code == 4
    assert "do not determine a and b and c and radius" in done.stderr
    assert "Touch at least seven places" in done.stderr


def test_of_what_the_touches_do_not_determine_no_number_is_told() -> None:
    """Nine touches within 2 mm of the middle."""
    rows = [f"{x},{y},{0.002 * x - 0.001 * y:.4f}" for x in (-2, 0, 2) for y in (-2, 0, 2)]
    Path("near.csv").write_text("\n".join(("x_mm,y_mm,reading_mm", *rows)) + "\n")
    done = run("solve", "near.csv", "--machine", "v400.yaml", "--json")
    (found,) = lines(done)
    assert done.exit_code == 4
    assert not found["usable"]
    assert not any(each["determined"] for each in found["parameters"].values())
    assert {each["value"] for each in found["parameters"].values()} == {None}
    assert set(found["offsets_mm"].values()) == {None}
    page = run("solve", "near.csv", "--machine", "v400.yaml").stdout
    assert page.count("not determined") == 6
    assert "blocks of two known heights" in page
    lines_to_paste = run(
        "export", "near.csv", "--machine", "v400.yaml", "--format", "klipper", "--force"
    )
    assert "#*# delta_radius = 161.8000" in lines_to_paste.stdout
    assert "do not tell: a, b, c, radius, angle_a, angle_b" in lines_to_paste.stdout


def test_arms_are_taken_as_given_and_make_the_endstops_unsure() -> None:
    """Arms that are one tolerance too long give other endstops, and U covers that."""
    longer = replace(OFF, arms=np.array([0.3, 0.3, 0.3]))
    Path("t.csv").write_text(exact(V400, longer, Layout(places=41)))
    (found,) = lines(run("solve", "t.csv", "--machine", "v400.yaml", "--json"))
    wrong = abs(found["offsets_mm"]["a"] - TRUE["a"])
    assert 0.1 < wrong < found["expanded_mm"]["a"]
    text = Path("v400.yaml").read_text()
    Path("known.yaml").write_text(text.replace("leg_length: 0.3", "leg_length: 0.0"))
    (sure,) = lines(run("solve", "t.csv", "--machine", "known.yaml", "--json"))
    assert sure["expanded_mm"]["a"] < 0.5 * wrong


@pytest.mark.parametrize("form", ["linuxcnc", "table"])
def test_the_formats_of_an_orthoglide_are_refused(form: str) -> None:
    done = run("export", cfg(), "--format", form)
    assert done.exit_code == 2
    assert f"--format {form} is for the controller of kind orthoglide" in done.stderr
    Path("v400.yaml").unlink()
    back = run("export", SIX, "--format", "marlin")
    assert back.exit_code == 2
    assert "of kind linear_delta; this machine is of kind orthoglide" in back.stderr


def test_readings_of_gauges_are_no_readings_of_a_printer() -> None:
    done = run("solve", SIX, "--machine", "v400.yaml")
    assert done.exit_code == 3
    assert "the machine is a linear delta" in done.stderr


def test_verify_says_what_was_entered_of_each_parameter() -> None:
    """Afterwards the firmware has what was true, so nothing is left but noise."""
    after = replace(
        V400,
        endstops=tuple((np.array(V400.endstops) + OFF.endstops).tolist()),
        radius=V400.radius + OFF.radius,
        angles=tuple((np.array(V400.angles) + OFF.angles).tolist()),
    )
    names = cfg("before.cfg"), cfg("after.cfg", Truth(), after, seed=2)
    (found,) = lines(run("verify", *names, "--data", "mesh", "--json"))
    changes = {**dict(zip("abc", OFF.endstops, strict=True)), "radius": 0.24, "angle_a": 0.11}
    for name, change in changes.items():
        assert found["parameters"][name]["entered"] == pytest.approx(change)
    assert found["left_mm"] < 0.02 < found["found_mm"]
    page = run("verify", *names, "--data", "mesh").stdout
    assert "agree better than before" in page
    assert run("verify", *names, "--applied", "1", "2", "3").exit_code == 2
    assert run("report", names[0], "--after", names[1]).exit_code == 2


@pytest.mark.parametrize("options", [("verify",), ("diagnose", "--holdout")])
def test_files_of_two_machines_are_not_compared(options: tuple[str, ...]) -> None:
    one, other = cfg("one.cfg"), cfg("other.cfg", Truth(), KOSSEL)
    done = run(options[0], one, *options[1:], other)
    assert done.exit_code == 2
    assert "two machines: arms 344 and 265 mm long, delta radius 162 and 130 mm" in done.stderr


def test_measure_names_the_command_of_the_printer() -> None:
    done = run("measure", "--machine", "v400.yaml")
    assert done.exit_code == 2
    assert "BED_MESH_CALIBRATE" in done.stderr
    assert "printer.cfg" in done.stderr


def test_apply_leaves_it_to_the_firmware() -> None:
    done = run("apply", touches(41), "--machine", "v400.yaml", "--yes")
    assert done.exit_code == 2
    assert "orthocal export t.csv --machine v400.yaml --format klipper" in done.stderr


def test_a_new_machine_file_of_a_printer() -> None:
    made = run(
        *("machine", "new", "--kind", "linear_delta", "--leg-length", "300", "--radius", "140"),
        *("--bed-radius", "120", "--endstop", "380", "--repeatability", "0.02", "--yes"),
        *("--output", "k.yaml", "--json"),
    )
    assert made.exit_code == 0, made.stderr
    (found,) = lines(made)
    assert (found["kind"], found["delta_radius_mm"], found["bed_radius_mm"]) == (
        "linear_delta",
        140,
        120,
    )
    assert found["endstops_mm"] == {"a": 380, "b": 380, "c": 380}
    assert found["arm_length_mm"] == [300, 300, 300]
    assert found["probe"]["repeatability_mm"] == 0.02
    refused = run("machine", "new", "--kind", "linear_delta", "--width", "80", "--yes")
    assert refused.exit_code == 2
    assert "--width is not for a machine of kind linear_delta" in refused.stderr
    assert run("machine", "new", "--radius", "140", "--yes").exit_code == 2


def test_the_template_of_touches_can_be_solved() -> None:
    Path("t.csv").write_text(run("template", "touches").stdout)
    checked = run("validate", "t.csv", "--machine", "v400.yaml")
    assert checked.exit_code == 0, checked.stdout
    assert run("solve", "t.csv", "--machine", "v400.yaml").exit_code == 0


def test_diagnose_shows_the_bed_from_above() -> None:
    """A bed that rises towards +x and +y by its third power, far beyond the noise."""
    rows = []
    for number, line in enumerate(Path(touches(121)).read_text().splitlines()):
        cells = line.split(",")
        if number:
            x, y = float(cells[3]) / 150.0, float(cells[4]) / 150.0
            cells[6] = f"{float(cells[6]) + 0.6 * x * y * y:.6f}"
        rows.append(",".join(cells))
    Path("t.csv").write_text("\n".join(rows) + "\n")
    page = run("diagnose", "t.csv", "--machine", "v400.yaml").stdout
    drawn = [line[2:] for line in page.split("parameters only\n")[1].splitlines()[1:18]]
    assert len(drawn) == 17
    # Which way it bends shows at the upper right corner of the map against the upper left.
    upper = drawn[3].ljust(33)
    assert "▲" in upper[24:]
    assert "▼" in upper[:9]
    assert "The bed from above" in page


@pytest.mark.parametrize("data", ["calibration", "mesh"])
def test_the_report_is_written_whole(data: str) -> None:
    name = cfg()
    done = run("report", name, "--data", data, "--html", "r.html", "--markdown", "r.md")
    assert done.exit_code == 0, done.stderr
    page = Path("r.html").read_text()
    assert 'id="bed-0-0-t"' in page
    assert "No reading of this kind determines leg_length" in page
    assert "Leg x" not in page
    assert "Workspace" not in Path("r.md").read_text()
    (found,) = lines(run("report", name, "--data", data, "--json"))
    assert found["workspace"] is None
    assert found["answer"]["parameters"]["radius"]["unit"] == "mm"


def test_a_simulated_printer_is_found_out() -> None:
    """Offsets, radius and angles as they were drawn up; the arms are right, so U is ample."""
    given = ("--offsets", "0.3", "-0.2", "0.1", "--radius-angles", "0.2", "0.1", "-0.05")
    heights = ("--places", "41", "--height", "0", "--height", "40")
    made = run("simulate", "--machine", "v400.yaml", *given, *heights, "--seed", "3", "-o", "s.csv")
    assert made.exit_code == 0, made.stderr
    (found,) = lines(run("solve", "s.csv", "--machine", "v400.yaml", "--json"))
    assert found["input"]["readings"] == 82
    wanted = {
        "a": 420.3,
        "b": 419.8,
        "c": 420.1,
        "radius": 162.0,
        "angle_a": 210.1,
        "angle_b": 329.95,
    }
    for name, true in wanted.items():
        told = found["parameters"][name]
        # Of the endstops most of U is what the arms leave open.
        share = 0.3 if name in "abc" else 1.0
        assert abs(told["value"] - true) < share * told["expanded"]
    # One standard deviation of the noise and of a bed that is as rough as is usual.
    assert 0.5 < found["rms_after_mm"] / (0.013**2 + 0.02**2) ** 0.5 < 1.3
    again = run("simulate", "--machine", "v400.yaml", *given, *heights, "--seed", "3")
    assert again.stdout == Path("s.csv").read_text()
    assert run("simulate", "--machine", "v400.yaml", "-o", "s.yaml").exit_code == 2


def test_a_simulated_bed_of_its_own_shape_is_seen() -> None:
    shape = ("--cause", "bed_shape=0.3,0,-0.3,0,0,0,0.4")
    left = []
    for name, more in (("flat.csv", ()), ("bent.csv", shape)):
        run("simulate", "--machine", "v400.yaml", *more, "--seed", "4", "-o", name)
        (found,) = lines(run("solve", name, "--machine", "v400.yaml", "--json"))
        left.append(found["rms_after_mm"])
    assert left[1] > 1.7 * left[0]


def stretched(name: str = "belt.csv") -> str:
    """Touches on three heights of a printer with a stretched belt, 5 mm per metre of tower b."""
    truth = replace(OFF, scales=np.array([0.0, -5.0, 0.0]))
    rng = np.random.default_rng(2)
    session = probe_bed(V400, truth, (), Layout(41, heights=(0.0, 25.0, 50.0)), rng)
    Path(name).write_text(delta_csv(session))
    return name


def test_causes_of_the_rails_have_the_names_of_the_towers() -> None:
    """In every form: values for programs, the machine file, the page, and what is typed."""
    file = stretched()
    (found,) = lines(run("diagnose", file, "--machine", "v400.yaml", "--json"))
    (cause,) = found["causes"]
    assert (cause["id"], list(cause["parameters"])) == ("encoder_scale", ["a", "b", "c"])
    accept = ("--accept", "encoder_scale", "--output", "known.yaml")
    done = run("diagnose", file, "--machine", "v400.yaml", *accept)
    assert done.exit_code == 0, done.stderr
    (known,) = yaml.safe_load(Path("known.yaml").read_text())["identified"]
    assert list(known["parameters"]) == ["a", "b", "c"]
    assert known["parameters"]["b"]["value"] == pytest.approx(-5.0, abs=0.3)
    (again,) = lines(run("diagnose", file, "--machine", "known.yaml", "--json"))
    assert again["verdict"] == "consistent"
    text = Path("known.yaml").read_text()
    Path("other.yaml").write_text(text.replace("    b: {value", "    y: {value"))
    typed = run("simulate", "--machine", "v400.yaml", "--cause", "encoder_scale=1")
    assert "Write encoder_scale=a,b,c" in typed.stderr
    refused = run("solve", file, "--machine", "other.yaml")
    assert refused.exit_code == 3
    assert "encoder_scale has the parameters a, b, c." in refused.stderr


def test_sizes_of_causes_are_shown_with_the_uncertainty_of_the_table() -> None:
    file = stretched()
    (found,) = lines(run("diagnose", file, "--machine", "v400.yaml", "--json"))
    std = found["causes"][0]["parameters"]["b"]["std"]
    page = " ".join(run("diagnose", file, "--machine", "v400.yaml").stdout.split())
    shown = re.search(r"tower b -[\d.]+ ± ([\d.]+) mm/m", page)
    assert shown is not None
    assert float(shown[1]) == pytest.approx(1.96 * std, rel=0.06)
    assert "(± U, k = 1.96)" in page


def test_no_page_of_a_printer_speaks_of_gauges_and_postures() -> None:
    """Every cause that a printer can have, on the pages that name it."""
    foreign = re.compile(
        r"\b(postures?|nut|stands?|(?<!feeler )gauges?|legs?|cycles?)\b", re.IGNORECASE
    )
    vocabulary = Model(read_machine("v400.yaml").machine).machine.vocabulary
    for cause in CAUSES.values():
        if LinearDelta in cause.sizes:
            text = vocabulary.said(f"{cause.title} {cause.advice} {cause.instrument}")
            assert not foreign.search(text), text
    file, known = stretched(), ("--machine", "v400.yaml")
    noisy = Path(touches(41)).read_text().splitlines()
    for k in range(1, len(noisy), 2):
        head, _, value = noisy[k].rpartition(",")
        noisy[k] = f"{head},{float(value) + 0.3 * (-1) ** (k // 2 % 3):.4f}"
    Path("noisy.csv").write_text("\n".join(noisy) + "\n")
    for page in (
        *(
            run(verb, name, *known)
            for name in (file, "noisy.csv")
            for verb in ("solve", "diagnose")
        ),
        run("report", file, *known),
        run("plan", *known),
        run("plan", file, *known),
        run("export", touches(41), *known, "--format", "marlin"),
    ):
        found = foreign.findall(page.stdout)
        assert not found, (found, page.stdout)


def test_what_is_not_recommended_is_not_accepted() -> None:
    """Lost motion: a printer's firmware has no setting for it, and belts are tightened."""
    truth = replace(OFF, lost=np.array([0.12, 0.0, 0.1]))
    session = probe_bed(V400, truth, (), Layout(81), np.random.default_rng(2))
    Path("v400.yaml").write_text(machine_yaml(V400))
    Path("t.csv").write_text(delta_csv(session))
    done = run("diagnose", "t.csv", "--machine", "v400.yaml", "--accept", "backlash")
    assert "is not recommended" in done.stdout
    assert done.exit_code == 4
    assert "Making backlash part of the machine's model is not recommended" in done.stderr
    assert not Path("v400-backlash.yaml").exists()


def test_a_leaning_tower_that_is_named_can_be_lived_with() -> None:
    """No firmware knows of it, but its parameters are found beside it, and may be pasted."""
    truth = replace(OFF, leans=np.array([[3.0, -1.5], [1.0, -6.0], [1.0, -5.0]]))
    heights = Layout(81, heights=(0.0, 25.0, 50.0))
    session = probe_bed(V400, truth, (), heights, np.random.default_rng(2))
    Path("t.csv").write_text(delta_csv(session))
    page = run("diagnose", "t.csv", "--machine", "v400.yaml")
    assert "--accept tower_lean" in page.stdout
    assert run("export", "t.csv", "--machine", "v400.yaml", "--format", "klipper").exit_code == 4
    accept = ("--accept", "tower_lean", "--output", "known.yaml")
    assert run("diagnose", "t.csv", "--machine", "v400.yaml", *accept).exit_code == 0
    pasted = run("export", "t.csv", "--machine", "known.yaml", "--format", "klipper")
    assert pasted.exit_code == 0
    assert "Not in these lines: tower_lean" in pasted.stdout


def test_a_machine_of_no_kind_is_refused() -> None:
    name = cfg()
    text = Path(name).read_text()
    assert "kinematics" in text
    Path("slip.cfg").write_text(text.replace("kinematics", "kinematic"))
    done = run("solve", "slip.cfg")
    assert done.exit_code == 3
    assert "kinematics of [printer]: The option is missing." in done.stderr
    yaml_text = Path("v400.yaml").read_text()
    Path("slip.yaml").write_text(yaml_text.replace("kind: linear", "kinds: linear"))
    done = run("solve", touches(13), "--machine", "slip.yaml")
    assert done.exit_code == 3
    assert "Add a line `kind: linear_delta`." in done.stderr
    assert "arm_length_mm" not in done.stderr.replace("Known here", "").split("kinds")[0]


def test_distances_are_no_places_to_probe() -> None:
    layout = ("--layout", "print-13", "--program", "p.csv")
    done = run("plan", "--machine", "v400.yaml", *layout)
    assert done.exit_code == 2
    assert "DELTA_ANALYZE" in done.stderr
    assert "--layout bed-13" in done.stderr


def test_distances_scatter_as_a_calliper_does_and_not_as_a_probe() -> None:
    """Thirty calibrations with a probe of 12 µm and a calliper of 50 µm, on a bed without grain.

    Four degrees of freedom each: the mean variance has a relative spread of √(2/120) = 0.13, so
    that 1.65 is missed with a chance below one in ten thousand.
    """
    text = Path("v400.yaml").read_text().replace("calliper_mm: 0.03", "calliper_mm: 0.05")
    text = re.sub(r"texture_mm: [\d.]+", "texture_mm: 0.0", text)
    Path("v400.yaml").write_text(text)
    found = []
    for seed in range(30):
        (solved,) = lines(run("solve", cfg(f"{seed}.cfg", seed=seed), "--json"))
        found.append(solved["sigma_residuals_mm"] ** 2)
    assert np.mean(found) < 1.65 * 0.012**2
