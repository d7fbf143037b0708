"""The benchmark of real printers, on files made for the purpose."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.files.input import read_input
from tests.printer_files import OFF, printer_cfg
from tests.truth.delta import V400, Truth

from .real import machines, main, with_arms

LONGER = replace(OFF, arms=np.array([0.6, -0.4, 0.1]))


def put(folder: Path, name: str, truth: Truth, noise: float = 0.0) -> str:
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(printer_cfg(V400, truth, noise=noise, seed=len(name)), encoding="utf-8")
    return str(path)


def test_names_that_differ_in_a_date_are_of_one_machine(tmp_path: Path) -> None:
    names = ("v400_2023-08-20.cfg", "v400_2023-09-10.cfg", "printer-20241223_204558.cfg", "k/a.cfg")
    for name in (*names, "k/b.cfg", "README.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name, encoding="utf-8")
    (tmp_path / "k/c.cfg").write_text("k/a.cfg", encoding="utf-8")  # the same again
    found = {name: [path.name for path in paths] for name, paths in machines(tmp_path)}
    assert found == {"v400": list(names[:2]), "printer": [names[2]], "k": ["a.cfg", "b.cfg"]}


def test_arms_of_one_date_predict_another(tmp_path: Path) -> None:
    """They are the reason here: what parameters alone leave is gone."""
    moved = replace(LONGER, endstops=np.array([0.1, 0.3, -0.2]))
    files = put(tmp_path, "one.cfg", LONGER), put(tmp_path, "two.cfg", moved)
    first, second = (read_input(path, stored="mesh") for path in files)
    # Second-order terms: (0.6 mm)² by the length of an arm.
    assert with_arms(first, second) < 2e-4
    # Arms of a machine whose arms are right say nothing of those that are not.
    sound = read_input(put(tmp_path, "sound.cfg", OFF), stored="mesh")
    assert with_arms(sound, second) > 1e-3


@pytest.mark.slow
def test_a_folder_gives_a_table_and_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("one/2024-01-01.cfg", "one/2024-02-01.cfg"):
        put(tmp_path, name, LONGER, noise=0.012)
    (tmp_path / "broken.cfg").write_text("[printer]\nkinematics: delta\n", encoding="utf-8")
    assert main([str(tmp_path), "--json", str(tmp_path / "out.json")]) == 0
    said = capsys.readouterr().out
    assert "2 predictions; extension by the better baseline" in said
    assert len(re.findall("^one +2024-0", said, re.MULTILINE)) == 4
    assert '"earlier_map"' in (tmp_path / "out.json").read_text(encoding="utf-8")
