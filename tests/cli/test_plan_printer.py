"""`orthocal plan` for printers: layouts, and places that can be filled in and solved."""

import csv
import shutil
from pathlib import Path

import pytest

from tests.cli.program import lines, run
from tests.files.test_printer_file import GOOD
from tests.printers import CONFIG

NAMES = ["a", "b", "c", "radius", "angle_a", "angle_b"]
MACHINE = ("--machine", str(CONFIG))


def test_the_json_is_that_of_the_contract_as_far_as_it_fits() -> None:
    (data,) = lines(run("plan", *MACHINE, "--json"))
    for row in data["by_cycles"]:
        assert list(row["parameters"]) == NAMES
        assert list(row["expanded_mm"]) == list(row["noise_std_mm"]) == NAMES[:4]
        assert row["minutes"] > 0.0
        for name in NAMES[:4]:
            assert row["parameters"][name]["expanded"] == row["expanded_mm"][name]
    sizes = {row["layout"]: row["readings"] for row in data["by_cycles"]}
    for count in (7, 13, 25, 49, 121):
        assert sizes[f"bed-{count}"] == count
        assert sizes[f"blocks-{count}"] == 3 * count
        assert sizes[f"print-{count}"] == count + 12
    assert data["protocol"] == "telling"
    design = data["design"]
    assert design["causes"] == ["tower_lean", "bed_shape"]
    assert design["reached"]
    assert design["rivals_sigma"] >= design["wanted_sigma"] == 5.0
    assert len(design["places_mm"]) == design["readings"] == sizes["telling"]
    pairs = {frozenset(each["causes"]): each["sigma"] for each in data["separation"]}
    assert pairs[frozenset(design["causes"])] == pytest.approx(design["rivals_sigma"])
    assert "tower_radius" in data["invisible"]
    assert data["limits"]["source"] == "leg_length"
    flat = lines(run("plan", *MACHINE, "--layout", "bed-49", "--json"))[0]
    pairs = {frozenset(each["causes"]): each["sigma"] for each in flat["separation"]}
    assert pairs[frozenset(design["causes"])] < 1.0


def test_the_page_fits_a_terminal_and_names_what_shows_the_rest() -> None:
    shutil.copy(CONFIG, "delta.yaml")
    shown = run("plan", "--machine", "delta.yaml", "--details").stdout
    assert run("plan", *MACHINE, "--html", "plan.html").exit_code == 0
    assert "A leg_length" in Path("plan.html").read_text(encoding="utf-8")
    assert max(map(len, shown.splitlines())) <= 80
    # Each layout is one line of a table.
    table = shown[shown.index("  layout ") : shown.index("  U of each parameter: a, b, c")]
    assert {len(line.split()) for line in table.replace("→ ", "").splitlines()[:-1]} == {10}
    words = " ".join(shown.replace("│", " ").split())
    assert "radius in mm, angle_a, angle_b in deg (95 %)" in words
    assert "No layout determines leg_length" in words
    assert "tower_radius a rule from the middle of the bed to each rail" in words
    assert "To distinguish tower_lean and bed_shape" in words


def test_a_printers_own_file_is_a_machine_to_plan_for(tmp_path: Path) -> None:
    path = tmp_path / "printer.cfg"
    path.write_text(GOOD, encoding="utf-8")
    (data,) = lines(run("plan", str(path), "--data", "mesh", "--json"))
    assert data["machine"] == "printer.cfg"
    assert data["next"]
    text = run("plan", str(path), "--data", "mesh", "--program", "-").stdout
    rows = list(csv.DictReader(text.splitlines()))
    assert [{name: float(row[f"{name}_mm"]) for name in "xyz"} for row in rows] == data["design"][
        "places_mm"
    ]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--cycles 3", "no gauges and no protocol"),
        ("--layout bed-8", "Choose one of bed-7, "),
        ("--program p.nc", "End it in .csv"),
        ("--program p.csv --json", "Leave out --json"),
    ],
)
def test_what_a_printer_has_not_is_refused(options: str, said: str, folder: Path) -> None:
    shown = run("plan", *MACHINE, *options.split())
    assert shown.exit_code == 2
    assert said in (shown.stdout if "--json" in options else shown.stderr)
    assert not list(folder.iterdir())
