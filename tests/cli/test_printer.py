"""Printers from the command line: what is shown of them, refused, and what comes next.

Files that tests only read are made once; what reads them is run once.
"""

import itertools
import re
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.machine_file import read_machine_file
from orthoglide_cal.report.sentences import cause_words
from tests.cli.program import (
    answer,
    done,
    holds,
    once,
    parameters,
    refusals,
    refused,
    refuses,
    run,
    tells,
    words,
)
from tests.printer_files import OFF, exact, printer_cfg
from tests.printers import true_values
from tests.truth.delta import (
    KOSSEL,
    V400,
    Layout,
    Truth,
    delta_csv,
    delta_yaml,
    places_of,
    probe_bed,
)

MACHINE = ("--machine", "v400.yaml")
SHIFT = true_values(V400, OFF)
TRUE = {
    **dict(zip("abc", np.add(V400.endstops, SHIFT[:3]).tolist(), strict=True)),
    "radius": V400.radius + OFF.radius,
    "angle_a": V400.angles[0] + OFF.angles[0],
    "angle_b": V400.angles[1] + OFF.angles[1],
}
# What was entered is what was true.
CALIBRATED = replace(
    V400,
    endstops=tuple(TRUE[name] for name in "abc"),
    radius=TRUE["radius"],
    angles=tuple((np.array(V400.angles) + OFF.angles).tolist()),
)
# A stretched belt: 5 mm per metre of tower b.
STRETCHED = replace(OFF, scales=np.array([0.0, -5.0, 0.0]))


def touched(truth: Truth, layout: Layout, seed: int = 2) -> str:
    return delta_csv(probe_bed(V400, truth, (), layout, np.random.default_rng(seed)))


def tilted(tilt: float) -> str:
    """A printer that stands as its firmware has it, but for a tilt of its bed."""
    return touched(Truth(endstops=np.array([tilt, 0.0, -tilt])), Layout(places=81), 4)


# Settings that Klipper stored again: the same steps, with other endstops.
STORED = re.compile(r"(position_endstop = )(\d+)")


def table(at: Iterable[Sequence[float]], heights: Iterable[float]) -> str:
    rows = (f"{x:g},{y:g},{z:.6f}" for (x, y), z in zip(at, heights, strict=True))
    return "\n".join(("x_mm,y_mm,reading_mm", *rows)) + "\n"


FILES: dict[str, Callable[[], str]] = {
    "v400.yaml": lambda: delta_yaml(V400),
    "smooth.yaml": lambda: re.sub(r"texture_mm: [\d.]+", "texture_mm: 0.0", delta_yaml(V400)),
    "printer.cfg": lambda: printer_cfg(V400, OFF),
    "after.cfg": lambda: printer_cfg(CALIBRATED, Truth(), seed=2),
    "again.cfg": lambda: STORED.sub(
        lambda line: f"{line[1]}{int(line[2]) + 1}", printer_cfg(V400, OFF)
    ),
    "kossel.cfg": lambda: printer_cfg(KOSSEL, Truth()),
    "longer.cfg": lambda: printer_cfg(V400, replace(OFF, arms=np.full(3, 0.9))),
    "t13.csv": lambda: exact(V400, OFF, Layout(places=13)),
    "t41.csv": lambda: exact(V400, OFF, Layout(places=41)),
    "belt.csv": lambda: touched(STRETCHED, Layout(25, (0.0, 25.0, 50.0))),
    "lost.csv": lambda: touched(replace(OFF, lost=np.array([0.12, 0.0, 0.1])), Layout(81)),
    "right.csv": lambda: tilted(0.0),
    "tilted.csv": lambda: tilted(0.06),
    "three.csv": lambda: "\n".join(exact(V400, OFF, Layout(places=13)).splitlines()[:4]) + "\n",
    "later.csv": lambda: touched(OFF, Layout(25), 5),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("printers")
    shutil.copytree(Path(__file__).with_name("touches"), folder, dirs_exist_ok=True)
    for name, text in FILES.items():
        (folder / name).write_text(text())
    return folder


@pytest.fixture(autouse=True)
def own(files: Path, folder: Path) -> None:
    """The files, in the folder of the test."""
    shutil.copytree(files, folder, dirs_exist_ok=True)


def page(*arguments: str) -> str:
    return words(once(*arguments).stdout)


@cache
def found(*arguments: str) -> dict[str, Any]:
    return answer(*arguments)


# --- what is found ----------------------------------------------------------------------------


def known(longer: float) -> tuple[str, str]:
    """A machine file by which the arms were measured to 0.02 mm, longer than the firmware's."""
    arms = [arm + longer for arm in V400.arms]
    text = re.sub(r"arm_length_mm: .*", f"arm_length_mm: {arms}", delta_yaml(V400))
    Path(f"{longer}.yaml").write_text(re.sub(r"leg_length: [\d.]+", "leg_length: 0.02", text))
    return "--machine", f"{longer}.yaml"


def test_measured_arms_that_the_firmware_has_not_make_the_radius_unsure() -> None:
    """What is found goes with the firmware's arms, and is wrong by more than they were read to."""
    mesh = ("solve", "longer.cfg", "--data", "mesh")
    apart, alike = (answer(*mesh, *known(longer)) for longer in (0.9, 0.01))
    told, sure = (parameters(fit)["radius"] for fit in (apart, alike))
    wrong = abs(told["active"] + told["found"] - TRUE["radius"])
    assert sure["expanded"] < wrong < told["expanded"]
    (said,) = (note for note in apart["notes"] if note.startswith("Arms: the machine file says"))
    holds(said, ["difference, 0.9 mm", "in both (arm_length)"])
    holds(" ".join(alike["notes"]), ["not:Arms:"])
    back = refused(2, *mesh, *known(20.0))
    assert "two machines: arms 364 and 344 mm long" in back
    assert "arm_length_mm" in back


def test_verify_says_what_was_entered_of_each_parameter() -> None:
    """Afterwards the firmware has what was true, so nothing is left but noise."""
    both = ("verify", "printer.cfg", "after.cfg", "--data", "mesh")
    compared = found(*both)
    assert "\n  Nothing more to do.\n" in run(*both).stdout
    # Before, entering lowered the nozzle; now that is no reservation.
    stored = run(*both[:-1], "calibration").stdout
    assert stored.startswith("✔ The touches agree better than before, as predicted\n")
    changes = {**dict(zip("abc", SHIFT[:3], strict=True)), "radius": 0.24, "angle_a": 0.11}
    for name, change in changes.items():
        assert compared["entered"][name] == pytest.approx(change)
    assert compared["rms_after_mm"] < 0.02 < compared["rms_before_mm"]


@pytest.mark.parametrize(
    ("left", "said", "kept", "moved"),
    [
        (0.4, "but not as predicted", False, False),
        (3.0, "The machine has moved: nothing was entered", False, True),
    ],
)
def test_what_is_better_is_not_yet_what_was_promised(
    left: float, said: str, kept: bool, moved: bool
) -> None:
    """So much of all that is off is left, with the same settings."""
    parts = {name: left * getattr(OFF, name) for name in ("endstops", "radius", "angles")}
    Path("after.cfg").write_text(printer_cfg(V400, replace(OFF, **parts), seed=2))
    both = ("verify", "printer.cfg", "after.cfg", "--data", "mesh")
    compared = answer(*both)
    assert compared["rms_after_mm"] == pytest.approx(left * compared["rms_before_mm"], abs=0.02)
    assert (compared["kept"], compared["moved"]) == (kept, moved)
    shown = run(*both)
    assert (shown.exit_code, shown.stdout[0]) == (4, "✘"), "mark and exit code are one decision"
    assert said in words(shown.stdout)


def test_no_better_than_before_is_not_as_promised() -> None:
    """29 touches on a shape of 40 µm: what was entered took nothing away, though F cannot tell."""
    at = places_of(Layout(29), V400.bed)
    x, y = at.T / V400.bed
    shape, off = 0.2 * (x**4 - 6.0 * x**2 * y**2 + y**4), 0.06 * x
    for name, height in (("before.csv", shape + off), ("after.csv", shape - 1.2 * off)):
        Path(name).write_text(table(at.tolist(), height))
    compared = answer("verify", "before.csv", "after.csv", *MACHINE)
    promised, after = compared["rms_promised_mm"], compared["rms_after_mm"]
    assert promised < 0.95 * compared["rms_before_mm"] < after
    assert after**2 < 1.9 * promised**2  # F of 28 and 23 degrees of freedom, 5 %
    assert not compared["kept"]


def test_where_no_improvement_was_predicted_the_headline_promises_none() -> None:
    """A calibrated printer that is probed twice is as predicted within U, on the side of it."""
    for seed in (3, 4, 5, 6):
        Path(f"{seed}.cfg").write_text(printer_cfg(CALIBRATED, Truth(), seed=seed))
    for data, before in itertools.product(("calibration", "mesh"), (3, 4, 5)):
        both = ("verify", f"{before}.cfg", f"{before + 1}.cfg", "--data", data)
        compared, shown = answer(*both), words(run(*both).stdout)
        assert (compared["kept"], compared["improves"]) == (True, False)
        assert "✔ The touches agree as predicted; no improvement beyond noise" in shown
        assert re.search(r"Predicted \d+ ± \d+ µm, measured \d+ µm", shown)
        apart = abs(compared["rms_after_mm"] - compared["rms_promised_mm"])
        assert apart <= compared["rms_expanded_mm"]


def test_dates_of_one_printer_are_judged_together() -> None:
    Path("later.cfg").write_text(printer_cfg(CALIBRATED, Truth(), seed=4))
    both = ("diagnose", "printer.cfg", "later.cfg", "--data", "mesh", "--together")
    found = answer(*both)
    assert [file["path"] for file in found["inputs"]] == ["printer.cfg", "later.cfg"]
    assert found["verdict"] == "consistent"
    before, after = (parameters(date) for date in found["dates"])
    for name, value in TRUE.items():
        assert before[name]["active"] != after[name]["active"]
        for parameter in (before[name], after[name]):
            assert abs(parameter["active"] + parameter["found"] - value) < 3.0 * parameter["std"]
    said = words(run(*both).stdout)
    assert "Not determined: leg_length, taken as stated to within 0.3 mm." in said
    assert "printer.cfg later.cfg --data mesh --together" in said


def test_a_simulated_printer_is_found_out() -> None:
    """Offsets, radius and angles as they were drawn up; the arms are right, so U is ample."""
    given = ("--offsets", "0.3", "-0.2", "0.1", "--radius-angles", "0.2", "0.1", "-0.05")
    drawn = (*given, "--places", "41", "--height", "0", "--height", "40", "--seed", "3")
    done("simulate", *MACHINE, *drawn, "-o", "s.csv")
    solved = answer("solve", "s.csv", *MACHINE)
    assert solved["input"]["readings"] == 82
    for told, true in zip(solved["parameters"], (0.3, -0.2, 0.1, 0.2, 0.1, -0.05), strict=True):
        # Of the endstops most of U is what the arms leave open.
        share = 0.3 if told["name"] in "abc" else 1.0
        assert abs(told["found"] - true) < share * told["expanded"]
    # One standard deviation of the noise and of a bed that is as rough as is usual.
    assert 0.5 < solved["rms"]["after_mm"] / (0.013**2 + 0.02**2) ** 0.5 < 1.3
    assert run("simulate", *MACHINE, *drawn).stdout == Path("s.csv").read_text()


# --- causes -----------------------------------------------------------------------------------


def test_causes_of_the_rails_have_the_names_of_the_towers() -> None:
    """In every form: values for programs, the machine file, the page, and what is typed."""
    (cause,) = found("diagnose", "belt.csv", *MACHINE)["causes"]
    assert cause["id"] == "encoder_scale"
    assert [parameter["name"] for parameter in cause["parameters"]] == ["a", "b", "c"]
    accept = ("--accept", "encoder_scale", "--output", "known.yaml")
    done("diagnose", "belt.csv", *MACHINE, *accept)
    (kept,) = yaml.safe_load(Path("known.yaml").read_text())["identified"]
    assert list(kept["parameters"]) == ["a", "b", "c"]
    assert kept["parameters"]["b"]["value"] == pytest.approx(-5.0, abs=0.3)
    std = cause["parameters"][1]["std"]
    said = page("diagnose", "belt.csv", *MACHINE, "--details")
    shown = re.search(r"encoder_scale: a [^b]+ b −[\d.]+ ± ([\d.]+)", said)
    assert float(shown[1]) == pytest.approx(1.96 * std, rel=0.06)
    assert "U: expanded uncertainty" in said


def test_no_page_of_a_printer_speaks_of_gauges_and_postures() -> None:
    """Every cause that a printer can have, on the pages that name it."""
    foreign = re.compile(
        r"\b(postures?|nut|stands?|(?<!feeler )gauges?|legs?|cycles?)\b", re.IGNORECASE
    )
    machine = read_machine_file("v400.yaml").model.machine
    for cause in CAUSES.values():
        if type(machine) in cause.sizes:
            text = " ".join(cause_words(cause.id, machine).values())
            assert not foreign.search(text), text
    for said in (
        *(page(verb, "belt.csv", *MACHINE) for verb in ("solve", "diagnose")),
        page("report", "belt.csv", *MACHINE),
        page("plan", *MACHINE),
        page("plan", "belt.csv", *MACHINE),
        page("export", "t41.csv", *MACHINE, "--format", "marlin"),
    ):  # fmt: skip
        assert said
        assert not foreign.findall(said), said


# --- little, nothing, or nothing to change ----------------------------------------------------


@pytest.mark.parametrize("line", refusals(Path(__file__).with_name("said_of_printers.txt")))
def test_what_a_page_says_and_does_not(line: str) -> None:
    tells(line)


def test_where_nothing_is_to_be_entered_no_screen_allows_it() -> None:
    """A probe that scatters by 0.19 mm; and 13 heights of which nothing is known."""
    for count, name in ((61, "rough.csv"), (13, "junk.csv")):
        noise = np.random.default_rng(6).uniform(
            *((-0.3, 0.3) if count > 13 else (-5.0, 2.0)), count
        )
        Path(name).write_text(table(places_of(Layout(count), V400.bed).tolist(), noise))
    rough, junk = (run("diagnose", name, *MACHINE).stdout for name in ("rough.csv", "junk.csv"))
    holds(words(rough), ["! Not on the list", "Nothing to enter", "not:may be entered"])
    holds(words(junk), ["Do not enter", "not:with them: ."])


def test_a_shape_that_leaves_nothing_determined_is_no_calibrated_machine() -> None:
    """So large a shape hides angles of more than a degree: they are not "within U"."""
    at = places_of(Layout(61), V400.bed)
    x, y = at.T / V400.bed
    noise = np.random.default_rng(8).normal(0.0, 0.008, len(at))
    height = 0.25 * (x**4 - 6.0 * x**2 * y**2 + y**4) + noise
    Path("clover.csv").write_text(table(at.tolist(), height))
    found = answer("diagnose", "clover.csv", *MACHINE)
    assert (found["verdict"], found["release"]["usable"]) == ("named", False)
    assert not all(one["determined"] for one in found["parameters"])


def test_a_tilt_that_each_endstop_alone_could_have_is_to_be_entered() -> None:
    """Within U, most of which is what the arms leave open: of all three endstops alike."""
    straight, solved = (found("solve", name, *MACHINE) for name in ("right.csv", "tilted.csv"))
    assert (straight["release"]["usable"], straight["release"]["settled"]) == (True, True)
    assert all(
        abs(parameter["found"]) < 0.7 * parameter["expanded"] for parameter in solved["parameters"]
    )
    assert not solved["release"]["settled"]
    few, many = (page("plan", name, *MACHINE) for name in ("t13.csv", "tilted.csv"))
    assert few.index("To reduce U: about") < few.index(" Next ")
    assert "telling: " not in few.partition(" Next ")[0]
    assert "no further probe readings lower U" in many


def test_of_what_the_touches_do_not_determine_no_number_is_told() -> None:
    told = found("solve", "grid.csv", *MACHINE)
    assert not told["release"]["usable"]
    for parameter in told["parameters"]:
        stated = [parameter[key] for key in ("determined", "found", "enter")]
        assert stated == [False, None, None]
    assert page("solve", "grid.csv", *MACHINE).count("not determined") == 6


# --- which of the readings that a printer.cfg stores ------------------------------------------


def typed(text: str) -> list[str]:
    """The commands that a page tells to type, about printer.cfg."""
    told = re.findall(r"orthocal (?:\w+) printer\.cfg[^\n`]*", text)
    assert told, text
    return told


@pytest.mark.parametrize(
    "command",
    [
        ("solve",),
        ("export", "--format", "text"),
        ("export", "--format", "klipper"),
        ("report", "--markdown", "-"),
        ("plan", "--layout", "bed-13", "--details"),
    ],
)
def test_the_next_steps_are_about_the_readings_that_were_shown(command: tuple[str, ...]) -> None:
    said = once(command[0], "printer.cfg", "--data", "mesh", *command[1:]).stdout
    told = typed(said.partition("Also judged: ")[0])
    assert all("--data mesh" in line for line in told), told


def test_a_cause_is_accepted_from_the_readings_that_showed_it() -> None:
    """Towers that lean by as much as nothing else does, which only the mesh shows."""
    leaning = replace(OFF, leans=np.array([[9.0, -4.0], [2.0, -18.0], [1.0, 15.0]]))
    Path("printer.cfg").write_text(printer_cfg(V400, leaning))
    text = Path("v400.yaml").read_text()
    Path("v400.yaml").write_text(text.replace("bed_shape: 0.1", "bed_shape: 0"))
    said = run("diagnose", "printer.cfg", "--data", "mesh", *MACHINE).stdout
    (accept,) = (line for line in typed(said) if "--accept" in line)
    assert "--data mesh" in accept
    accepted = run(*accept.split()[1:], "--output", "known.yaml")
    assert accepted.exit_code == 0, accepted.stderr
    assert "report printer.cfg --machine known.yaml --data mesh" in accepted.stderr


def test_a_report_judges_the_data_selected_and_shows_the_others() -> None:
    """The calibration is fine, and the mesh shows that towers lean: a caution."""
    leaning = replace(OFF, leans=np.array([[1.8, -0.8], [0.4, -3.6], [0.2, 3.0]]))
    Path("printer.cfg").write_text(printer_cfg(V400, leaning))
    both = {
        data: answer("report", "printer.cfg", "--data", data) for data in ("calibration", "mesh")
    }
    usable = {data: report["answer"]["release"]["usable"] for data, report in both.items()}
    assert usable == {"calibration": True, "mesh": False}
    for data, other in (("calibration", "mesh"), ("mesh", "calibration")):
        assert both[data]["answer"]["input"]["data"] == data
        assert [entry["input"]["data"] for entry in both[data]["others"]] == [other]
    codes = ["other_data", "nozzle_lower"]
    assert both["calibration"]["answer"]["release"]["codes"] == codes
    whole = answer("report", "printer.cfg")
    assert whole["answer"] == both["calibration"]["answer"]
    assert len({report["identity"]["number"] for report in both.values()}) == 2
    shown = run("report", "printer.cfg")
    assert shown.exit_code == 0
    first, _, rest = shown.stdout.partition("Also judged: ")
    # What would crash into the bed stands first.
    assert "! Entering this lowers the nozzle by" in first
    assert "The parameters may be entered, with care." in first
    assert "points of a mesh" in rest
    assert "orthocal report printer.cfg --data mesh" in rest


@pytest.mark.parametrize(
    ("height", "count", "said"),
    [
        ("0.250000", 0, "a placeholder, not a measurement. Probe the bed, and save the mesh."),
        ("99.000000", 1, "The height is 99 mm off with the settings in force."),
    ],
)
def test_other_data_that_are_refused_are_a_caution_on_every_screen(
    height: str, count: int, said: str
) -> None:
    """All heights of the mesh are the same, or the first of each row is far off."""
    row = re.compile(r"^#\*# \t  .*$", re.MULTILINE)
    one = re.compile(r"-?\d+\.\d{6}")
    text = FILES["printer.cfg"]()
    Path("printer.cfg").write_text(row.sub(lambda line: one.sub(height, line[0], count), text))
    for verb in ("solve", "diagnose", "report", "export", "validate"):
        shown = words(done(verb, "printer.cfg"))
        assert "The mesh in the same file was not used. " in shown, verb
        assert said in shown, verb
    codes = ["nozzle_lower", "unused_data"]
    assert answer("solve", "printer.cfg")["release"]["codes"] == codes
    assert said in refused(3, "solve", "printer.cfg", "--data", "mesh")


def test_other_data_that_contradict_hold_the_release() -> None:
    """The towers were moved between the calibration and the mesh; a stale mesh only warns."""
    moved = replace(OFF, endstops=np.array([1.31, -0.22, 0.17]))
    kept, other = printer_cfg(V400, OFF), printer_cfg(V400, moved)
    parts = [text.index("#*# [bed_mesh default]") for text in (kept, other)]
    Path("printer.cfg").write_text(kept[: parts[0]] + other[parts[1] :])
    for data in ("calibration", "mesh"):
        shown = run("solve", "printer.cfg", "--data", data)
        assert shown.exit_code == 4
        assert "contradicts these values beyond U (difference: a" in words(shown.stdout)
    mesh = kept[: kept.index("#*# [delta_calibrate]")] + other[parts[1] :]
    calibration = kept[kept.index("#*# [delta_calibrate]") : parts[0]]
    Path("printer.cfg").write_text(mesh + calibration)
    release = answer("solve", "printer.cfg")["release"]
    assert (release["usable"], release["codes"]) == (True, ["other_data", "nozzle_lower"])
    shown = words(run("solve", "printer.cfg", "--data", "mesh").stdout)
    assert "the mesh is older than the calibration in force" in shown


def test_touches_of_a_csv_are_held_out_from_a_mesh() -> None:
    """What --data chooses is of the printer.cfg; the other file has nothing to choose."""
    typed = "diagnose", "printer.cfg", "--data", "mesh", "--holdout", "later.csv"
    held, shown = found(*typed), words(run(*typed, "--recalibrated").stdout)
    again = "diagnose printer.cfg --holdout later.csv --recalibrated --data mesh --details"
    assert shown.endswith(f"More: orthocal {again}")
    for name, date in (("printer.cfg", "2026-03-02.cfg"), ("later.csv", "2026-03-01.csv")):
        Path(date).write_bytes(Path(name).read_bytes())
    said = refused(2, "diagnose", "2026-03-02.cfg", "--holdout", "2026-03-01.csv")
    assert said.endswith("first: orthocal diagnose 2026-03-01.csv --holdout 2026-03-02.cfg")
    assert held["input"]["data"] == "mesh"


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize("line", refusals(Path(__file__).with_name("refused_printers.txt")))
def test_what_is_not_of_printers_is_refused(line: str) -> None:
    refuses(line)


@pytest.mark.parametrize(
    ("verb", "file"), [("diagnose", "three.csv"), ("solve", "near.csv"), ("diagnose", "series.csv")]
)
def test_places_that_determine_nothing_are_no_failed_search(verb: str, file: str) -> None:
    """Within 5 mm of the middle the radius and the tower angles hardly show beside the noise."""
    shown = run(verb, file, *MACHINE)
    told = words(shown.stdout)
    assert shown.exit_code == 4
    assert "These readings do not determine a, b, c, radius, angle_a, angle_b." in told
    assert "1. Touch at least seven places" in told
    assert "A series at one place says how the probe" in told
    assert not re.search("offsets|search", told)


def test_a_new_machine_file_of_a_printer() -> None:
    made = answer(
        *("machine", "new", "--kind", "linear_delta", "--leg-length", "300", "--radius", "140"),
        *("--bed-radius", "120", "--endstop", "380", "--repeatability", "0.02", "--yes"),
        *("--output", "k.yaml"),
    )
    assert (made["kind"], made["delta_radius_mm"]) == ("linear_delta", 140)
    assert made["bed_radius_mm"] == 120
    assert made["endstops_mm"] == {"a": 380, "b": 380, "c": 380}
    assert made["arm_length_mm"] == [300, 300, 300]
    assert made["probe"]["repeatability_mm"] == 0.02


def test_the_bare_program_beside_a_printers_file_says_what_to_do_with_it() -> None:
    settings = Path("printer.cfg").read_text()
    for path in Path().iterdir():
        path.unlink()
    Path("mine.cfg").write_text(settings)
    Path("other.cfg").write_text("[printer]\nkinematics: corexy\n")
    said = run().stdout
    for command in ("orthocal solve mine.cfg", "orthocal diagnose mine.cfg"):
        assert command in said
    for other in ("other.cfg", "measure", "Orthoglide"):
        assert other not in said
    Path("mine.cfg").unlink()
    assert "orthocal measure" in run().stdout
