"""Printers: what is told where touches say little, nothing, or that nothing is to be changed."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.cli.program import lines, run
from tests.printer_files import OFF, exact, machine_yaml, printer_cfg
from tests.truth.delta import V400, Layout, Truth, delta_csv, probe_bed

MACHINE = ("--machine", "v400.yaml")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("v400.yaml").write_text(machine_yaml(V400))


def tilted(tilt: float = 0.0) -> str:
    """A printer that stands as its firmware has it, but for a tilt of its bed."""
    truth = Truth(endstops=np.array([tilt, 0.0, -tilt]))
    session = probe_bed(V400, truth, (), Layout(places=81), np.random.default_rng(4))
    Path("t.csv").write_text(delta_csv(session))
    return "t.csv"


def test_where_nothing_is_to_be_changed_it_is_said() -> None:
    """Calibrated again it would get other digits, and no better ones."""
    page = run("solve", tilted(), *MACHINE).stdout
    assert "✔ Nothing to enter: the firmware has these values" in page
    assert "type in" not in page
    assert "orthocal export" not in page
    assert "orthocal plan t.csv --machine v400.yaml" in page
    (found,) = lines(run("solve", "t.csv", *MACHINE, "--json"))
    assert found["usable"]
    assert found["settled"]
    assert "Nothing to enter" in run("diagnose", "t.csv", *MACHINE).stdout
    pasted = run("export", "t.csv", *MACHINE, "--format", "klipper").stdout
    assert "Nothing to enter" in pasted


def test_a_tilt_that_each_endstop_alone_could_have_is_to_be_entered() -> None:
    """Far below U, most of which is what the arms leave open: of all three endstops alike."""
    (found,) = lines(run("solve", tilted(tilt=0.06), *MACHINE, "--json"))
    assert max(found["expanded_mm"].values()) > 0.3
    assert not found["settled"]
    assert "type in" in run("solve", "t.csv", *MACHINE).stdout


def seven(height: float) -> str:
    """Seven touches of a printer that is right, but that every second of the rim is higher."""
    header, *rows = exact(V400, Truth(), Layout(places=7)).splitlines()
    rim = [k for k, row in enumerate(rows) if ",0.00,0.00,0," not in row]
    rim.sort(key=lambda k: np.arctan2(*map(float, rows[k].split(",")[4:2:-1])))
    for number, k in enumerate(rim):
        rows[k] = rows[k].rpartition(",")[0] + f",{height * (-1) ** number:.6f}"
    Path("seven.csv").write_text("\n".join((header, *rows)) + "\n")
    return "seven.csv"


def test_seven_touches_do_not_claim_what_is_wrong() -> None:
    """One spare reading: any cause fits it, and that nothing is wrong is likelier than each."""
    file = seven(0.033)
    (found,) = lines(run("diagnose", file, *MACHINE, "--json"))
    assert found["verdict"] == "ambiguous"
    page = " ".join(run("diagnose", file, *MACHINE).stdout.split())
    assert "leave open what is wrong, and whether anything is" in page
    assert "Likeliest" not in page
    assert "nor from a sound machine" in page
    assert "Something is wrong" not in page
    assert "so few that nearly anything fits" in page
    solved = run("solve", file, *MACHINE).stdout
    assert "1. Probe more places" in solved


def test_without_a_touch_to_spare_the_model_is_not_said_to_fit() -> None:
    rows = Path(seven(0.1)).read_text().splitlines()[:7]
    Path("six.csv").write_text("\n".join(rows) + "\n")
    page = " ".join(run("diagnose", "six.csv", *MACHINE).stdout.split())
    assert "✔" not in page
    assert "whether the model fits cannot be told" in page
    assert "Unexplained stay" not in page
    assert "degrees of freedom" not in page
    assert "(1 degree of freedom)" in run("diagnose", seven(0.02), *MACHINE).stdout.replace(
        "\n", " "
    )


@pytest.mark.parametrize("verb", ["solve", "diagnose"])
def test_touches_too_near_to_each_other_are_no_failed_search(verb: str) -> None:
    """Within 5 mm of the middle the radius and the tower angles hardly show beside the noise."""
    places = ((0, 0), (5, 0), (0, 5), (-5, 0), (0, -5), (3, 3), (3, -3), (-3, -3))
    heights = (0.01, 0.02, -0.01, 0.03, 0.04, 0.01, 0.011, 0.012)
    rows = (f"{x},{y},{height}" for (x, y), height in zip(places, heights, strict=True))
    Path("near.csv").write_text("\n".join(("x_mm,y_mm,reading_mm", *rows)) + "\n")
    done = run(verb, "near.csv", *MACHINE)
    assert done.exit_code == 4
    assert "These readings do not determine a and b and c and radius" in done.stderr
    assert "Touch at least seven places spread over the whole bed" in done.stderr
    assert "offsets" not in done.stderr
    assert "search" not in done.stderr


def test_the_next_touches_stand_before_the_next_steps() -> None:
    page = run("plan", tilted(tilt=0.06), *MACHINE).stdout
    assert page.index("i Next, about") < page.index("What to do next")
    assert "telling: " not in page.partition("What to do next")[0]


@pytest.mark.parametrize(("share", "kept"), [(1.0, True), (0.6, False)])
def test_what_is_better_is_not_yet_what_was_promised(share: float, kept: bool) -> None:
    """Of all that is off a share was entered: the touches agree better either way."""
    rest = replace(
        OFF,
        endstops=(1.0 - share) * OFF.endstops,
        radius=(1.0 - share) * OFF.radius,
        angles=(1.0 - share) * OFF.angles,
    )
    Path("before.cfg").write_text(printer_cfg(V400, OFF))
    Path("after.cfg").write_text(printer_cfg(V400, rest, seed=2))
    given = ("verify", "before.cfg", "after.cfg", "--data", "mesh")
    (found,) = lines(run(*given, "--json"))
    assert found["left_mm"] < 0.5 * found["found_mm"]
    assert found["kept"] is kept
    page = run(*given).stdout
    assert ("✔ The touches agree better than before, as promised" in page) is kept
    assert ("but not as promised" in page) is not kept


def test_values_and_page_give_the_same_residuals() -> None:
    """In the sentences of the answer, too: nobody has to know of degrees of freedom."""
    rows = Path(tilted()).read_text().splitlines()
    for k in range(1, len(rows), 2):
        head, _, value = rows[k].rpartition(",")
        rows[k] = f"{head},{float(value) + 0.3 * (-1) ** (k // 2 % 3):.4f}"
    Path("t.csv").write_text("\n".join(rows) + "\n")
    (found,) = lines(run("diagnose", "t.csv", *MACHINE, "--json"))
    assert found["verdict"] == "unexplained"
    lack = found["lack_of_fit"]
    page = " ".join(run("diagnose", "t.csv", *MACHINE).stdout.split())
    assert f"{1000.0 * lack['left_mm']:.1f} µm r.m.s." in page
    assert f"would leave {lack['expected_mm']:.4f} mm" in page
    assert f"{lack['left_mm']:.3f} mm r.m.s., where" in " ".join(found["reasons"])


def test_what_seldom_happens_is_not_called_what_noise_would_give() -> None:
    """A pattern that noise leaves in fewer than one of a hundred, on a bed without grain."""
    text = re.sub(r"texture_mm: [\d.]+", "texture_mm: 0.0", Path("v400.yaml").read_text())
    Path("v400.yaml").write_text(text)
    page = " ".join(run("solve", seven(0.0145), *MACHINE).stdout.split())
    assert "larger than usual for this probe's noise" in page
    assert "not large enough to call the model wrong" in page
    assert "smaller ones" not in page
