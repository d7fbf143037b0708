"""`orthocal solve`: what a technician reads, and what a program reads."""

import hashlib
import math
from pathlib import Path

import pytest

from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.machine_file import default_machine, machine_text
from orthoglide_cal.results.answer import Answer
from tests.cli.program import DOUBLE, SESSION, SINGLE, SIX, answer, lines, run


@pytest.mark.parametrize("file", [SIX, DOUBLE, SINGLE, SESSION])
def test_json_is_the_answer(file: str) -> None:
    """Of the schema, about this file, and what its parts say agrees with each other."""
    shown = run("solve", "--json", file)
    (found,) = lines(shown)
    measured = read_input(file, default_machine()).measured
    expected = {
        "path": file,
        "sha256": hashlib.sha256(Path(file).read_bytes()).hexdigest(),
        "kind": measured.kind,
        "readings": len(measured),
        "data": None,
    }
    assert found["input"] == expected
    assert found.keys() == Answer.model_json_schema(mode="serialization")["properties"].keys()
    assert found["release"]["usable"] == (shown.exit_code == 0) == (not found["release"]["reasons"])
    assert [parameter["name"] for parameter in found["parameters"]] == ["x", "y", "z"]
    for k, parameter in enumerate(found["parameters"]):
        variance = sum(source["std"][k] ** 2 for source in found["budget"])
        assert parameter["std"] == pytest.approx(math.sqrt(variance))
        assert parameter["expanded"] == pytest.approx(found["k"] * parameter["std"])
        assert (parameter["enter"] is not None) == found["release"]["usable"]
        assert found["correlation"][k][k] == 1.0
    assert len(found["deviations"]) == 6
    for row in found["deviations"]:
        assert row["expanded_mm"] > 0.0
        if found["release"]["usable"]:
            # On the nominal machine, but for the rounding of what is entered.
            gap = row["measured_mm"] - row["modelled_mm"]
            assert row["expected_mm"] == pytest.approx(gap, abs=5e-4)


def test_without_spare_readings_nothing_is_not_a_number() -> None:
    text = "difference,value_mm\ndx_y,0.1\ndy_x,0.2\ndz_x,-0.3\n"
    found = answer("solve", "-", text=text)
    assert found["noise"]["dof"] == 0
    assert found["noise"]["residuals_mm"] is found["noise"]["repeats_mm"] is None
    assert math.isfinite(found["parameters"][0]["std"])
    assert "no spare readings" in found["judgement"]
    details = run("solve", "-", "--details", text=text).stdout
    assert "nan" not in details
    assert "Noise, mm" in details


def test_text_says_what_to_type_into_the_controller(tmp_path: Path) -> None:
    """New = active + Δρ, with the machine's active offsets; after the verdict."""
    machine = tmp_path / "tuned.yaml"
    text = machine_text(default_machine())
    machine.write_text(
        text.replace("{x: 0.0, y: 0.0, z: 0.0}", "{x: 0.25, y: -1.5, z: 0.0}"), encoding="utf-8"
    )
    shown = run("solve", "--machine", str(machine), DOUBLE).stdout
    found = answer("solve", "--machine", str(machine), DOUBLE)
    assert found["release"]["usable"]
    assert shown.index("may be entered") < shown.index("± U   enter")
    assert "+0.671" in run("solve", "--machine", str(machine), DOUBLE, "--details").stdout
    cells = {row.split()[0]: row.split() for row in shown.splitlines() if row[:3] in {"  x", "  y"}}
    for parameter, active in zip(found["parameters"], (0.25, -1.5), strict=False):
        row = cells[parameter["name"]]
        assert float(row[1]) == active
        assert float(row[2].replace("−", "-")) == pytest.approx(parameter["found"], abs=5e-4)
        assert float(row[3]) == pytest.approx(parameter["expanded"], rel=0.05)
        new = active + parameter["found"]
        assert float(row[4]) == parameter["enter"] == pytest.approx(new, abs=5e-4)
