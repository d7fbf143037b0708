"""`orthocal diagnose` as its users and their programs see it."""

import json
import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from orthoglide_cal.cli.app import app
from orthoglide_cal.data import read_machine
from tests import truth
from tests.machines import SAMPLES
from tests.truth.session import Session

KEYS = {
    "schema_version",
    "input",
    "machine",
    "verdict",
    "lack_of_fit",
    "causes",
    "ambiguous_with",
    "next_measurement",
    "offsets_mm",
    "std_mm",
}
CAUSE_KEYS = {
    "id",
    "probability",
    "where",
    "parameters",
    "rms_before_mm",
    "rms_after_mm",
    "heldout_before_mm",
    "heldout_after_mm",
    "aliases",
}
HEALTHY = SAMPLES / "double_posture_session.csv"
GAP = SAMPLES / "session.yaml"
SECOND, THIRD = SAMPLES / "experiment2.csv", SAMPLES / "experiment3.csv"


@dataclass(frozen=True)
class Ran:
    code: int
    out: str
    err: str

    def lines(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.out.splitlines()]


def diagnose(*arguments: object, text: str | None = None) -> Ran:
    done = CliRunner().invoke(app, ["diagnose", *map(str, arguments)], input=text)
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert "Traceback" not in done.output
    return Ran(done.exit_code, done.stdout, done.stderr)


@cache
def shown(path: Path) -> str:
    """The text for one of the samples."""
    ran = diagnose(path)
    assert ran.code == 0
    return ran.out


@cache
def one(*arguments: object) -> dict[str, Any]:
    ran = diagnose(*arguments, "--json")
    assert ran.code == 0
    assert ran.err == ""
    (answer,) = ran.lines()
    return answer


def written(folder: Path, session: Session, name: str = "readings.csv") -> tuple[Path, Path]:
    """Record and machine file of a session."""
    machine = folder / "machine.yaml"
    machine.write_text(truth.machine_yaml(session.machine, session.gauge), encoding="utf-8")
    return truth.write_readings(session, folder / name), machine


class TestJson:
    def test_every_key_of_the_contract_is_there(self) -> None:
        answer = one(GAP)
        assert set(answer) >= KEYS
        assert answer["schema_version"] == 1
        assert set(answer["input"]) == {"path", "sha256", "kind", "readings"}
        assert answer["input"]["path"] == str(GAP)
        assert re.fullmatch("[0-9a-f]{64}", answer["input"]["sha256"])
        assert (answer["input"]["kind"], answer["input"]["readings"]) == ("readings", 60)
        assert answer["machine"] == "Orthoglide prototype"
        assert answer["verdict"] == "named"
        lack = answer["lack_of_fit"]
        assert {"statistic", "p_value", "noise_mm", "residual_mm"} <= set(lack)
        assert lack["noise_mm"] == pytest.approx(np.hypot(0.006, 0.01 / np.sqrt(12.0)))
        (cause,) = answer["causes"]
        assert set(cause) >= CAUSE_KEYS
        assert (cause["id"], cause["where"], cause["aliases"]) == ("axis_gap", "", [])
        assert set(cause["parameters"]) == {"xy", "yz", "zx"}
        for name, true in (("xy", 0.30), ("yz", -0.25), ("zx", 0.35)):
            estimate = cause["parameters"][name]
            assert set(estimate) == {"value", "std", "unit"}
            assert estimate["unit"] == "mm"
            assert abs(estimate["value"] - true) < 4.5 * estimate["std"]
        assert 0.5 < cause["probability"] <= 1.0
        assert cause["rms_after_mm"] < lack["noise_mm"] < cause["rms_before_mm"]
        assert cause["heldout_after_mm"] < 0.5 * cause["heldout_before_mm"]
        assert answer["ambiguous_with"] == []
        assert answer["next_measurement"] is None
        for axis, true in (("x", -0.18), ("y", 0.55), ("z", 0.26)):
            assert abs(answer["offsets_mm"][axis] - true) < 4.5 * answer["std_mm"][axis]

    def test_healthy_data_name_nothing(self) -> None:
        answer = one(HEALTHY)
        assert answer["verdict"] == "consistent"
        assert answer["causes"] == []
        assert answer["next_measurement"] is None
        assert "leg_length" in answer["ambiguous_with"]

    def test_an_open_answer_says_what_to_read_next(self) -> None:
        answer = one(SECOND)
        assert answer["verdict"] == "ambiguous"
        following = answer["next_measurement"]
        assert set(following) == {"what", "separates", "separation_sigma"}
        assert len(following["separates"]) == 2
        assert following["separates"][0] != following["separates"][1]
        assert following["separation_sigma"] > 1.0
        assert following["what"].endswith(".")
        assert answer["input"]["kind"] == "six"
        assert answer["input"]["readings"] == 6
        assert all(np.isfinite(answer["std_mm"][axis]) for axis in "xyz")

    def test_the_same_data_give_the_same_answer(self) -> None:
        assert diagnose(GAP, "--json").out == diagnose(GAP, "--json").out

    def test_single_posture_readings_are_diagnosed(self) -> None:
        answer = one(SAMPLES / "single_posture_session.csv")
        assert answer["verdict"] == "consistent"
        for axis, true in (("x", 0.42), ("y", -0.31), ("z", 0.87)):
            assert abs(answer["offsets_mm"][axis] - true) < 4.5 * answer["std_mm"][axis]


class TestManyFiles:
    def test_one_line_each_in_order_whatever_is_in_the_middle(self, tmp_path: Path) -> None:
        broken = tmp_path / "broken.csv"
        broken.write_text("leg,posture,direction,reading_mm\nx,iso,y,one\n", encoding="utf-8")
        missing = tmp_path / "missing.csv"
        ran = diagnose(GAP, broken, HEALTHY, missing, "--json")
        assert ran.code == 3
        first, second, third, fourth = ran.lines()
        assert first["verdict"] == "named"
        assert second["input"]["path"] == str(broken)
        assert "line 2" in second["error"]
        assert set(second) == {"input", "error"}
        assert third["verdict"] == "consistent"
        assert str(missing) in fourth["error"]

    def test_the_worst_exit_code_wins(self, tmp_path: Path) -> None:
        """One gauge on one leg does not determine three offsets: no number may be used."""
        rows = HEALTHY.read_text(encoding="utf-8").splitlines()
        lame = tmp_path / "one_gauge.csv"
        kept = [row for row in rows[1:] if re.match(r"\d+,y,\w+,x,", row)]
        assert len(kept) == 10
        lame.write_text("\n".join([rows[0], *kept]) + "\n", encoding="utf-8")
        ran = diagnose(lame, HEALTHY, "--json")
        assert ran.code == 4
        first, second = ran.lines()
        assert set(first) == {"input", "error"}
        assert second["verdict"] == "consistent"
        nothing = tmp_path / "nothing.csv"
        nothing.write_text("", encoding="utf-8")
        assert diagnose(nothing, lame, "--json").code == 4
        assert diagnose(nothing, "--json").code == 3

    def test_text_goes_to_output_and_trouble_to_error(self, tmp_path: Path) -> None:
        ran = diagnose(tmp_path / "missing.csv", HEALTHY)
        assert ran.code == 3
        assert "missing.csv" in ran.err
        assert "missing.csv" not in ran.out
        assert "Consistent" in ran.out

    def test_standard_input_is_a_file_too(self) -> None:
        text = GAP.read_text(encoding="utf-8")
        ran = diagnose("-", HEALTHY, "--json", text=text)
        assert ran.code == 0
        first, second = ran.lines()
        assert first["input"]["path"] == "-"
        assert first["input"]["sha256"] == one(GAP)["input"]["sha256"]
        assert [cause["id"] for cause in first["causes"]] == ["axis_gap"]
        assert second["verdict"] == "consistent"

    def test_standard_input_cannot_be_two_files(self) -> None:
        for extra in ([], ["--json"]):
            ran = diagnose("-", "--holdout", "-", *extra, text="")
            assert ran.code == 2
            assert "once" in ran.err
            assert ran.out == ""


class TestHeldOut:
    def test_the_paper_s_third_experiment(self) -> None:
        """0.213 mm by the offsets alone; at most 0.065 mm by the extension."""
        applied = ("--applied", -0.53, 0.59, -1.76)
        answer = one(SECOND, "--holdout", THIRD, *applied)
        cause = answer["causes"][0]
        assert cause["heldout_before_mm"] == pytest.approx(0.213, abs=1e-3)
        assert cause["heldout_after_mm"] <= 0.065
        # Six numbers cannot carry the name: the answer stays open.
        assert answer["verdict"] == "ambiguous"
        assert {"axis_gap", "bar_skew"} <= {cause["id"], *answer["ambiguous_with"]}
        without = one(SECOND, "--holdout", THIRD)["causes"][0]
        assert without["heldout_before_mm"] > 0.5

    def test_no_fit_sees_the_later_readings(self, tmp_path: Path) -> None:
        session = truth.make_session(2, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
        first, machine = written(tmp_path, session)
        later, _ = written(tmp_path, truth.second_session(session, 5), "later.csv")
        alone = one(first, "--machine", machine)
        beside = one(first, "--machine", machine, "--holdout", later)
        for key in ("verdict", "offsets_mm", "std_mm", "lack_of_fit"):
            assert beside[key] == alone[key]
        assert beside["causes"][0]["parameters"] == alone["causes"][0]["parameters"]
        held_out = beside["causes"][0]["heldout_after_mm"]
        assert held_out != alone["causes"][0]["heldout_after_mm"]
        assert held_out < 1.5 * truth.MICRON.sigma < beside["causes"][0]["heldout_before_mm"]

    def test_a_later_csv_is_read_by_the_session_s_own_machine(self, tmp_path: Path) -> None:
        """Its `max` and `min` are those of that machine, not of the prototype."""
        from orthoglide_cal.data import session_of_readings, write_session
        from tests.diagnosis.sessions import known

        session = truth.make_session(4, truth.LARGE, truth.MICRON, ("axis_gap",))
        readings, machine = known(session)
        record = tmp_path / "first.yaml"
        write_session(session_of_readings(readings, machine, {}), record)
        later, _ = written(tmp_path, truth.second_session(session, 5), "later.csv")
        answer = one(record, "--holdout", later)
        assert [cause["id"] for cause in answer["causes"]] == ["axis_gap"]
        assert answer["causes"][0]["heldout_after_mm"] < 1.5 * truth.MICRON.sigma

    @pytest.mark.parametrize(
        "options",
        [
            ("--applied", 0.1, 0.0, 0.0),
            ("--applied", "nan", 0.0, 0.0, "--holdout", THIRD),
            ("--output", "x.yaml"),
            ("--accept", "nonsense"),
        ],
        ids=lambda options: options[0],
    )
    def test_options_that_do_not_go_together(self, options: tuple[object, ...]) -> None:
        ran = diagnose(SECOND, *options)
        assert ran.code == 2
        assert ran.out == ""
        assert ran.err

    def test_a_later_file_that_cannot_be_read(self, tmp_path: Path) -> None:
        missing = tmp_path / "missing.csv"
        ran = diagnose(SECOND, "--holdout", missing, "--json")
        assert ran.code == 3
        (line,) = ran.lines()
        assert str(missing) in line["error"]


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
        (found,) = read_machine(extended).identified
        assert found.id == "axis_gap"
        assert found.data_sha256 == one(readings, "--machine", machine)["input"]["sha256"]
        assert re.fullmatch(r"\d{4}-\d{2}-\d{2}", found.date)
        for true, estimate in zip(
            session.effects[0].parameters, found.parameters.values(), strict=True
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
        for known in (machine, extended):
            done = CliRunner().invoke(
                app, ["solve", str(readings), "--machine", str(known), "--json"]
            )
            assert done.exit_code == 0
            solution = json.loads(done.stdout)
            offsets = np.array([solution["offsets_mm"][axis] for axis in "xyz"])
            errors.append(np.abs(offsets - session.offsets).max())
        assert errors[0] > 0.03 > 0.015 > errors[1]

    def test_what_is_simulated_carries_it(self, tmp_path: Path) -> None:
        extended = tmp_path / "machine-axis_gap.yaml"
        assert diagnose(GAP, "--accept", "axis_gap", "--output", extended).code == 0
        options = ("simulate", "--seed", "5", "--offsets", "0.2", "-0.4", "0.1", "--noise", "0.001")
        made = CliRunner().invoke(app, [*options, "--machine", str(extended)])
        assert made.exit_code == 0
        plain = diagnose("-", "--json", text=made.stdout)
        assert [cause["id"] for cause in plain.lines()[0]["causes"]] == ["axis_gap"]
        knowing = diagnose("-", "--json", "--machine", extended, text=made.stdout)
        assert knowing.lines()[0]["verdict"] == "consistent"

    def test_the_default_name_says_what_was_accepted(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        assert diagnose(GAP, "--accept", "axis_gap").code == 0
        assert [path.name for path in tmp_path.iterdir()] == ["machine-axis_gap.yaml"]

    def test_standard_input_can_be_accepted(self, tmp_path: Path) -> None:
        target = tmp_path / "new.yaml"
        text = GAP.read_text(encoding="utf-8")
        ran = diagnose("-", "--accept", "axis_gap", "--output", target, text=text)
        assert ran.code == 0
        assert read_machine(target).identified[0].id == "axis_gap"

    @pytest.mark.parametrize("cause", ["misread", "stand_shift", "gauge_slip", "sign_flip"])
    def test_the_measurement_is_no_part_of_the_machine(self, tmp_path: Path, cause: str) -> None:
        target = tmp_path / "new.yaml"
        ran = diagnose(GAP, "--accept", cause, "--output", target)
        assert ran.code == 4
        assert "measurement" in ran.err
        assert "Named" in ran.out
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


class TestText:
    FILES = (HEALTHY, GAP, SECOND, THIRD, SAMPLES / "single_posture_session.csv")

    @pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
    def test_nothing_is_wider_than_a_terminal(self, path: Path) -> None:
        lines = shown(path).splitlines()
        assert len(lines) > 15
        assert max(map(len, lines)) <= 80
        assert [line for line in lines if line != line.rstrip()] == []
        assert "\x1b" not in shown(path)

    def test_many_postures_and_cycles_stay_within_it(self, tmp_path: Path) -> None:
        from orthoglide_cal.data import default_machine, readings_csv
        from orthoglide_cal.plan import Plan
        from orthoglide_cal.protocols import double_posture, synthetic_session

        machine = default_machine()
        plan = double_posture(machine, cycles=12)
        moved = plan.displacement * np.where(np.arange(len(plan)) % 7 < 3, 0.37, 1.0)
        plan = Plan(
            plan.leg, plan.direction, moved, plan.contact, plan.gauge_at, plan.setup,
            plan.order, plan.hours,
        )  # fmt: skip
        rng = np.random.default_rng(1)
        made = synthetic_session(machine, plan, np.array([0.3, -0.2, 0.5]), rng)
        path = tmp_path / ("a rather long name of a file of readings " * 3 + ".csv")
        path.write_text(readings_csv(made), encoding="utf-8")
        ran = diagnose(path)
        assert ran.code == 0
        assert max(map(len, ran.out.splitlines())) <= 80
        assert "22.2" in ran.out

    def test_wrapped_lines_keep_their_place(self) -> None:
        lines = shown(GAP).splitlines()
        start = next(k for k, line in enumerate(lines) if line.lstrip().startswith("mend"))
        column = lines[start].index("Shim")
        assert lines[start + 1].startswith(" " * column)
        assert lines[start + 1][column] != " "

    def test_it_says_what_to_do(self) -> None:
        text = " ".join(shown(GAP).split())
        assert "Named: the actuator axes do not meet in one point." in text
        assert "xy +0.3" in text
        assert f"orthocal diagnose {GAP} --accept axis_gap" in text
        assert "readings left out of the fit" in text
        assert "tolerances halved and doubled" in text
        assert "type in" in text
        assert "-0.189" in text

    def test_an_open_answer_offers_no_compensation(self) -> None:
        text = " ".join(shown(SECOND).split())
        assert "Ambiguous" in text
        assert "Read next" in text
        assert "--accept" not in text

    def test_a_fault_of_the_measurement_offers_none_either(self, tmp_path: Path) -> None:
        session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("misread",))
        readings, machine = written(tmp_path, session)
        ran = diagnose(readings, "--machine", machine)
        text = " ".join(ran.out.split())
        assert "Named: one reading is wrong." in text
        assert "nothing for the controller to correct" in text
        assert "--accept" not in text

    def test_a_faint_cause_leaves_room_for_nothing(self) -> None:
        """Beside a cause that hardly shows stands how likely it is that nothing is wrong."""
        from orthoglide_cal.diagnosis import diagnose as judge
        from orthoglide_cal.report.diagnose_text import render
        from tests.diagnosis.sessions import known

        readings, machine = known(truth.make_session(1, truth.PROTOTYPE, truth.DIAL, ("misread",)))
        found = judge(readings, machine)
        assert "nothing is wrong at all" not in render(found, readings, machine).plain
        faint = replace(found, ranking={**found.ranking, "": 0.217})
        assert "21.7 % that nothing is wrong at all" in render(faint, readings, machine).plain

    def test_names_from_outside_are_shown_not_obeyed(self, tmp_path: Path) -> None:
        session = truth.make_session(21, truth.PROTOTYPE, truth.MICRON)
        readings, machine = written(tmp_path, session, "\x1b[31mred.csv")
        text = machine.read_text(encoding="utf-8")
        name = '"[bold]\\u202Eevil[/bold]"'
        machine.write_text(text.replace("truth-prototype", name), encoding="utf-8")
        ran = diagnose(readings, "--machine", machine)
        assert "\x1b" not in ran.out
        assert "\u202e" not in ran.out
        assert "[bold]" in ran.out
