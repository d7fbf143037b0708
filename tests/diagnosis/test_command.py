"""`orthocal diagnose` as its users and their programs see it."""

from pathlib import Path

import pytest

from orthoglide_cal.causes import CAUSES
from tests import truth
from tests.diagnosis.command import SECOND, THIRD, diagnose, one, written


class TestJson:
    def test_what_it_separates_are_causes_and_two_of_them(self) -> None:
        first, second = one(THIRD)["next_measurement"]["separates"]
        assert {first, second} <= set(CAUSES)
        assert f"distinguishes {first} from {second}" in " ".join(diagnose(THIRD).out.split())


class TestManyFiles:
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
        from orthoglide_cal.files.session_file import session_of_readings, session_text
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
