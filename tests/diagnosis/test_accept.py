"""`orthocal diagnose --accept`: a cause becomes part of the machine."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from orthoglide_cal.cli.app import app
from orthoglide_cal.files.machine_file import read_machine
from tests import truth
from tests.diagnosis.command import GAP, HEALTHY, SECOND, diagnose, one, written
from tests.truth.session import Session


class TestAccept:
    def test_a_new_machine_file_that_every_command_uses(self, tmp_path: Path) -> None:
        session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
        readings, machine = written(tmp_path, session)
        before, extended = machine.read_bytes(), tmp_path / "extended.yaml"
        accept = ("--machine", machine, "--accept", "axis_gap", "--output", extended)
        ran = diagnose(readings, *accept)
        assert ran.code == 0
        assert str(extended) in ran.err
        assert machine.read_bytes() == before
        (found,) = read_machine(extended).accepted
        assert found.cause.id == "axis_gap"
        assert found.data_sha256 == one(readings, "--machine", machine)["input"]["sha256"]
        assert re.fullmatch(r"\d{4}-\d{2}-\d{2}", found.date or "")
        for true, estimate in zip(
            session.effects[0].parameters, found.estimates.values(), strict=True
        ):
            assert 0.0 < estimate.std < 0.05
            assert estimate.unit == "mm"
            assert abs(estimate.value - true) < 4.5 * estimate.std
        self.solved_without_bias(session, readings, machine, extended)
        again = one(readings, "--machine", extended)
        assert again["verdict"] == "consistent"
        # Never overwritten.
        kept = extended.read_bytes()
        ran = diagnose(readings, *accept)
        assert ran.code == 2
        assert extended.read_bytes() == kept

    @staticmethod
    def solved_without_bias(
        session: Session, readings: Path, machine: Path, extended: Path
    ) -> None:
        errors = []
        for model in (machine, extended):
            done = CliRunner().invoke(
                app, ["solve", str(readings), "--machine", str(model), "--json"]
            )
            answer = json.loads(done.stdout)
            parameters = (answer["alone"] or answer)["parameters"]
            offsets = np.array([each["found"] for each in parameters])
            errors.append(np.abs(offsets - session.offsets).max())
        assert errors[0] > 0.03 > 0.015 > errors[1]

    def test_the_default_name_says_what_was_accepted(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        assert diagnose(GAP, "--accept", "axis_gap").code == 0
        assert [path.name for path in tmp_path.iterdir()] == ["machine-axis_gap.yaml"]

    @pytest.mark.parametrize("cause", ["misread", "stand_shift", "gauge_slip", "sign_flip"])
    def test_the_measurement_is_no_part_of_the_machine(self, tmp_path: Path, cause: str) -> None:
        target = tmp_path / "new.yaml"
        ran = diagnose(GAP, "--accept", cause, "--output", target)
        assert ran.code == 4
        assert "measurement" in ran.err
        assert "Cause found" in ran.out
        assert not target.exists()

    @pytest.mark.parametrize(
        ("data", "cause"),
        [(SECOND, "axis_gap"), (HEALTHY, "axis_gap"), (GAP, "encoder_scale")],
        ids=["open with a bar", "healthy", "another cause"],
    )
    def test_what_the_data_do_not_support_is_refused(
        self, tmp_path: Path, data: Path, cause: str
    ) -> None:
        target = tmp_path / "new.yaml"
        ran = diagnose(data, "--accept", cause, "--output", target)
        assert ran.code == 4
        assert ran.err
        assert not target.exists()

    def test_a_refusal_does_not_spoil_the_line_of_json(self, tmp_path: Path) -> None:
        target = tmp_path / "new.yaml"
        ran = diagnose(HEALTHY, "--json", "--accept", "axis_gap", "--output", target)
        assert ran.code == 4
        assert [line["verdict"] for line in ran.lines()] == ["consistent"]

    def test_one_file_only(self) -> None:
        assert diagnose(GAP, HEALTHY, "--accept", "axis_gap").code == 2
