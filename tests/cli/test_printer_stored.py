"""Which of the readings that a printer.cfg stores: said on every page, kept in every next step."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.cli.program import lines, run
from tests.printer_files import OFF, machine_yaml, printer_cfg
from tests.truth.delta import V400, Layout, delta_csv, probe_bed


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("printer.cfg").write_text(printer_cfg(V400, OFF))
    Path("v400.yaml").write_text(machine_yaml(V400))


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
        ("plan", "--layout", "bed-13"),
    ],
)
def test_the_next_steps_are_about_the_readings_that_were_shown(command: tuple[str, ...]) -> None:
    page = run(command[0], "printer.cfg", "--data", "mesh", *command[1:]).stdout
    told = typed(page)
    assert all("--data mesh" in each for each in told), told


def test_what_is_pasted_is_what_was_shown() -> None:
    shown = lines(run("solve", "printer.cfg", "--data", "mesh", "--json"))[0]["parameters"]
    (step,) = (
        each for each in typed(run("solve", "printer.cfg", "--data", "mesh").stdout)
        if " export " in each
    )  # fmt: skip
    pasted = run(*step.split()[1:]).stdout
    assert f"delta_radius = {shown['radius']['value']:.4f}" in pasted


def test_a_cause_is_accepted_from_the_readings_that_showed_it() -> None:
    """Towers that lean by as much as nothing else does, which only the mesh shows."""
    leaning = replace(OFF, leans=np.array([[9.0, -4.0], [2.0, -18.0], [1.0, 15.0]]))
    Path("printer.cfg").write_text(printer_cfg(V400, leaning))
    text = Path("v400.yaml").read_text()
    Path("v400.yaml").write_text(text.replace("bed_shape: 0.1", "bed_shape: 0"))
    given = ("diagnose", "printer.cfg", "--data", "mesh", "--machine", "v400.yaml")
    page = run(*given).stdout
    (accept,) = (each for each in typed(page) if "--accept" in each)
    assert "--data mesh" in accept
    done = run(*accept.split()[1:], "--output", "known.yaml")
    assert done.exit_code == 0, done.stderr
    assert "report printer.cfg --machine known.yaml --data mesh" in done.stderr


@pytest.mark.parametrize(
    ("data", "words"), [("calibration", "7 heights and 3 distances"), ("mesh", "points of a mesh")]
)
def test_every_page_says_which_readings_it_is_of(data: str, words: str) -> None:
    chosen = ("--data", data)
    for verb in ("solve", "diagnose", "validate"):
        assert words in run(verb, "printer.cfg", *chosen).stdout
    assert words in run("report", "printer.cfg", *chosen, "--markdown", "-").stdout
    assert words in run("verify", "printer.cfg", "printer.cfg", *chosen).stdout
    for verb in ("solve", "diagnose", "report"):
        (found,) = lines(run(verb, "printer.cfg", *chosen, "--json"))
        assert found["input"]["data"] == data


def test_reports_of_the_mesh_and_of_the_calibration_have_two_numbers() -> None:
    numbers = {
        lines(run("report", "printer.cfg", "--data", data, "--json"))[0]["number"]
        for data in ("mesh", "calibration")
    }
    assert len(numbers) == 2


def test_touches_of_a_csv_are_held_out_from_a_mesh() -> None:
    """What --data chooses is of the printer.cfg; the other file has nothing to choose."""
    touched = probe_bed(V400, OFF, (), Layout(25), np.random.default_rng(5))
    Path("later.csv").write_text(delta_csv(touched))
    options = ("--data", "mesh", "--holdout", "later.csv", "--json")
    done = run("diagnose", "printer.cfg", *options)
    assert done.exit_code == 0, done.stderr
    assert lines(done)[0]["input"]["data"] == "mesh"
    refused = run("solve", "later.csv", "--machine", "v400.yaml", "--data", "mesh")
    assert refused.exit_code == 2
    assert "--data is for a printer.cfg; later.csv is none." in refused.stderr
    refused = run("validate", "later.csv", "--machine", "v400.yaml", "--data", "mesh")
    assert refused.exit_code == 2


def test_a_file_without_what_was_saved_may_have_been_cut_off() -> None:
    text = Path("printer.cfg").read_text()
    Path("cut.cfg").write_text("[include macros.cfg]\n" + text[: text.index("#*#")])
    done = run("solve", "cut.cfg")
    assert done.exit_code == 3
    assert "The block that SAVE_CONFIG writes is missing." in done.stderr
    Path("option.cfg").write_text(re.sub("delta_radius = .*", "", text))
    done = run("solve", "option.cfg")
    assert done.exit_code == 3
    assert "delta_radius" in done.stderr
    assert "cut off" not in done.stderr


def test_a_decimal_comma_of_a_setting_needs_no_columns() -> None:
    text = Path("printer.cfg").read_text()
    Path("comma.cfg").write_text(re.sub(r"arm_length = (\d+)\.", r"arm_length = \1,", text))
    done = run("solve", "comma.cfg")
    assert done.exit_code == 3
    assert "Write a decimal point, as Klipper does." in done.stderr
    assert "columns" not in done.stderr


def test_places_that_are_not_filled_in_are_one_fault() -> None:
    plan = ("plan", "--machine", "v400.yaml", "--layout", "bed-13", "--program", "places.csv")
    assert run(*plan).exit_code == 0
    done = run("diagnose", "places.csv", "--machine", "v400.yaml")
    assert done.exit_code == 3
    assert done.stderr.count("\n") == 1
    assert "reading_mm: No reading is filled in." in done.stderr


def series(count: int, rate: float) -> str:
    """Touches of the middle, one every ten seconds, by a probe that drifts [mm/h]."""
    rng = np.random.default_rng(7)
    rows = [
        f"{k},{k / 6:.3f},0,0,{rate * k / 360 + 0.005 * rng.standard_normal():.4f}"
        for k in range(count)
    ]
    return "\n".join(("seq,minutes,x_mm,y_mm,reading_mm", *rows)) + "\n"


def test_a_series_at_one_place_is_told_to_go_with_touches_of_the_bed() -> None:
    Path("series.csv").write_text(series(60, 1.0))
    done = run("diagnose", "series.csv", "--machine", "v400.yaml")
    assert done.exit_code == 4
    assert "A series at one place says how the probe scatters and drifts" in done.stderr


def test_the_bare_program_beside_a_printers_file_says_what_to_do_with_it() -> None:
    Path("v400.yaml").unlink()
    Path("printer.cfg").rename("mine.cfg")
    Path("other.cfg").write_text("[printer]\nkinematics: corexy\n")
    page = run().stdout
    assert "orthocal solve mine.cfg" in page
    assert "orthocal diagnose mine.cfg" in page
    assert "other.cfg" not in page
    assert "measure" not in page
    assert "Orthoglide" not in page
    Path("mine.cfg").unlink()
    assert "orthocal measure" in run().stdout


@pytest.mark.parametrize(
    "verb", ["solve", "diagnose", "plan", "report", "export", "validate", "verify"]
)
def test_the_help_says_that_a_printers_file_is_read(verb: str) -> None:
    assert "printer.cfg" in " ".join(run(verb, "--help").stdout.split("Options")[0].split())
