"""`orthocal diagnose` as its users and their programs see it."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.results import Answer
from tests import truth
from tests.diagnosis.command import GAP, HEALTHY, SECOND, THIRD, diagnose, one, written
from tests.machines import SAMPLES


def near(answer: dict[str, Any], *truth: float) -> None:
    for each, true in zip(answer["parameters"], truth, strict=True):
        assert abs(each["found"] - true) < 4.5 * each["std"]


class TestJson:
    def test_every_key_of_the_contract_is_there(self) -> None:
        answer = one(GAP)
        assert Answer.model_validate(answer).model_dump(mode="json") == answer
        assert answer["schema_version"] == 2
        assert answer["input"]["path"] == str(GAP)
        assert re.fullmatch("[0-9a-f]{64}", answer["input"]["sha256"])
        assert (answer["input"]["kind"], answer["input"]["readings"]) == ("readings", 60)
        assert answer["machine"] == {"name": "Orthoglide prototype", "kind": "orthoglide"}
        assert answer["verdict"] == "named"
        lack = answer["lack_of_fit"]
        assert lack["noise_mm"] == pytest.approx(np.hypot(0.006, 0.01 / np.sqrt(12.0)))
        (cause,) = answer["causes"]
        assert (cause["id"], cause["where"], cause["aliases"]) == ("axis_gap", "", [])
        hidden = (("xy", 0.30), ("yz", -0.25), ("zx", 0.35))
        for estimate, (name, true) in zip(cause["parameters"], hidden, strict=True):
            assert (estimate["name"], estimate["unit"]) == (name, "mm")
            assert abs(estimate["value"] - true) < 4.5 * estimate["std"]
        assert 0.5 < cause["probability"] <= 1.0
        assert cause["rms_after_mm"] < lack["noise_mm"] < cause["rms_before_mm"]
        assert cause["heldout_after_mm"] < 0.5 * cause["heldout_before_mm"]
        assert answer["ambiguous_with"] == []
        assert answer["next_measurement"] is None
        # Well within three times the 0.5 mm that the machine file states.
        assert cause["times_stated"] is None
        assert answer["beyond_tolerance"] == []
        near(answer, -0.18, 0.55, 0.26)

    def test_healthy_data_name_nothing(self) -> None:
        answer = one(HEALTHY)
        assert answer["verdict"] == "consistent"
        assert answer["causes"] == []
        assert answer["next_measurement"] is None
        assert answer["ambiguous_with"] == []
        assert "leg_length" in answer["not_excluded"]

    def test_an_open_answer_says_what_to_read_next(self) -> None:
        answer = one(SECOND)
        assert answer["verdict"] == "ambiguous"
        following = answer["next_measurement"]
        assert following["minutes"] > 0.0
        assert len(following["between"]) == 2
        assert len(following["separates"]) == 2
        assert following["separates"][0] != following["separates"][1]
        assert following["separation_sigma"] > 1.0
        assert following["what"].endswith(".")
        assert answer["input"]["kind"] == "six"
        assert answer["input"]["readings"] == 6

    def test_what_it_separates_are_causes_and_two_of_them(self) -> None:
        first, second = one(THIRD)["next_measurement"]["separates"]
        assert {first, second} <= set(CAUSES)
        assert f"distinguishes {first} from {second}" in " ".join(diagnose(THIRD).out.split())

    def test_single_posture_readings_are_diagnosed(self) -> None:
        answer = one(SAMPLES / "single_posture_session.csv")
        assert answer["verdict"] == "consistent"
        near(answer, 0.42, -0.31, 0.87)


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
            assert "once" in ran.err + ran.out
            assert (ran.out == "") == (not extra)


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
        assert (alone["holdout"], beside["holdout"]) == (None, str(later))
        for key in ("verdict", "parameters", "lack_of_fit"):
            assert beside[key] == alone[key]
        assert beside["causes"][0]["parameters"] == alone["causes"][0]["parameters"]
        held_out = beside["causes"][0]["heldout_after_mm"]
        assert held_out != alone["causes"][0]["heldout_after_mm"]
        assert held_out < 1.5 * truth.MICRON.sigma < beside["causes"][0]["heldout_before_mm"]

    def test_a_later_csv_is_read_by_the_session_s_own_machine(self, tmp_path: Path) -> None:
        """Its `max` and `min` are those of that machine, not of the prototype."""
        from orthoglide_cal.files import session_of_readings, session_text
        from tests.diagnosis.sessions import known

        session = truth.make_session(4, truth.LARGE, truth.MICRON, ("axis_gap",))
        readings, machine = known(session)
        record = tmp_path / "first.yaml"
        record.write_text(session_text(session_of_readings(readings, machine, {})))
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
