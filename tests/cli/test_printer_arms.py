"""Arms that a machine file states beside the printer.cfg: counted in U, or refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.program import lines, run
from tests.printer_files import OFF, machine_yaml, printer_cfg
from tests.truth.delta import V400

LONGER = 0.9


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A printer whose real arms are longer than its firmware has them."""
    monkeypatch.chdir(tmp_path)
    truth = replace(OFF, arms=np.full(3, LONGER))
    Path("printer.cfg").write_text(printer_cfg(V400, truth))


def known(longer: float) -> str:
    """A machine file by which the arms were measured to 0.02 mm, longer than the firmware's."""
    arms = [arm + longer for arm in V400.arms]
    text = re.sub(r"arm_length_mm: .*", f"arm_length_mm: {arms}", machine_yaml(V400))
    text = re.sub(r"leg_length: [\d.]+", "leg_length: 0.02", text)
    Path("known.yaml").write_text(text)
    return "known.yaml"


def solved(longer: float) -> dict[str, Any]:
    given = ("solve", "printer.cfg", "--data", "mesh", "--machine", known(longer), "--json")
    return lines(run(*given))[0]


def test_measured_arms_that_the_firmware_has_not_make_the_endstops_unsure() -> None:
    """What is found goes with the firmware's arms, and is wrong by more than they were read to."""
    found = solved(LONGER)
    sure = solved(0.0)
    for tower, stop, off in zip("abc", V400.endstops, OFF.endstops, strict=True):
        wrong = abs(found["offsets_mm"][tower] - stop - off)
        assert sure["expanded_mm"][tower] < wrong < found["expanded_mm"][tower]
    page = run("solve", "printer.cfg", "--data", "mesh", "--machine", known(LONGER)).stdout
    said = " ".join(page.split())
    assert "Arms: the machine file says" in said
    assert "0.9 mm apart" in said
    assert "in both (arm_length)" in said


def test_arms_on_which_both_files_agree_are_as_sure_as_the_machine_file_says() -> None:
    page = run("solve", "printer.cfg", "--data", "mesh", "--machine", known(0.01)).stdout
    assert "Arms:" not in page
    assert solved(0.01)["expanded_mm"]["a"] == pytest.approx(solved(0.0)["expanded_mm"]["a"])


def test_a_machine_file_of_another_printer_is_refused() -> None:
    done = run("solve", "printer.cfg", "--machine", known(20.0))
    assert done.exit_code == 2
    assert "two machines: arms 364 and 344 mm long" in done.stderr
    assert "arm_length_mm" in done.stderr


def test_measured_arms_are_to_be_entered_where_the_firmware_reads_them() -> None:
    page = run("solve", "printer.cfg", "--data", "mesh").stdout
    assert "enter each in printer.cfg (arm_length)" in " ".join(page.split())
