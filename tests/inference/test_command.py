"""`orthocal diagnose` as its users and their programs see it; what is tried, and how large it is.

Sizes are given, defaults, or ruled out.
"""

import hashlib
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.machine_file import read_machine_file
from orthoglide_cal.files.readings import session_of_readings, session_text
from orthoglide_cal.inference.data import Candidates, Ids
from orthoglide_cal.inference.diagnose import Diagnosis
from orthoglide_cal.inference.diagnose import diagnose as analysed
from orthoglide_cal.inference.result import Explanation
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.documents.answer import headline
from orthoglide_cal.results.making import answer_to
from tests import truth
from tests.cli.program import DOUBLE, SAMPLES, SESSION, SIX, answer, lines, once, run, words
from tests.cli.program import written_in as written
from tests.inference.sessions import changed, known
from tests.machines import NOMINAL, PROTOTYPE, extended
from tests.sentences import sentences


class TestHeldOut:
    def test_the_paper_s_third_experiment(self) -> None:
        """0.213 mm by the offsets alone; at most 0.065 mm by the extension."""
        applied = ("--applied", -0.53, 0.59, -1.76)
        result = answer("diagnose", SIX, "--holdout", SAMPLES / "experiment3.csv", *applied)
        cause = result["causes"][0]
        assert cause["heldout_before_mm"] == pytest.approx(0.213, abs=1e-3)
        assert cause["heldout_after_mm"] <= 0.065
        # Six numbers cannot carry the name: the answer stays open.
        assert result["verdict"] == "ambiguous"
        assert {"axis_gap", "bar_skew"} <= {cause["id"], *result["ambiguous_with"]}
        more = run("diagnose", SIX, "--holdout", SAMPLES / "experiment3.csv", *applied).stdout
        assert " --applied -0.53 0.59 -1.76 --details" in more.partition(" --holdout ")[2]
        without = answer("diagnose", SIX, "--holdout", SAMPLES / "experiment3.csv")["causes"][0]
        assert without["heldout_before_mm"] > 0.5

    def test_no_fit_sees_the_later_readings(self, tmp_path: Path) -> None:
        session = truth.make_session(2, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
        first, machine = written(tmp_path, session)
        later, _ = written(tmp_path, truth.second_session(session, 5), "later.csv")
        alone = answer("diagnose", first, "--machine", machine)
        beside = answer("diagnose", first, "--machine", machine, "--holdout", later)
        assert (alone["holdout"], beside["holdout"]) == (None, str(later))
        for key in ("verdict", "parameters", "lack_of_fit"):
            assert beside[key] == alone[key]
        assert beside["causes"][0]["parameters"] == alone["causes"][0]["parameters"]
        held_out = beside["causes"][0]["heldout_after_mm"]
        assert held_out != alone["causes"][0]["heldout_after_mm"]
        assert held_out < 1.5 * truth.MICRON.sigma < beside["causes"][0]["heldout_before_mm"]

    def test_a_later_csv_is_read_by_the_session_s_own_machine(self, tmp_path: Path) -> None:
        """Its `max` and `min` are those of that machine, not of the prototype."""
        session = truth.make_session(4, truth.LARGE, truth.MICRON, ("axis_gap",))
        readings, machine = known(session)
        record = tmp_path / "first.yaml"
        record.write_text(session_text(session_of_readings(readings, machine, {})))
        later, _ = written(tmp_path, truth.second_session(session, 5), "later.csv")
        result = answer("diagnose", record, "--holdout", later)
        assert [cause["id"] for cause in result["causes"]] == ["axis_gap"]
        assert result["causes"][0]["heldout_after_mm"] < 1.5 * truth.MICRON.sigma


class TestAccept:
    def test_a_new_machine_file_that_every_command_uses(self, tmp_path: Path) -> None:
        session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
        readings, machine = written(tmp_path, session)
        before, extended = machine.read_bytes(), tmp_path / "extended.yaml"
        accept = ("--machine", machine, "--accept", "axis_gap", "--output", extended)
        ran = run("diagnose", readings, *accept)
        assert ran.exit_code == 0
        assert str(extended) in ran.stderr
        assert machine.read_bytes() == before
        (found,) = read_machine_file(extended).model.accepted
        assert found.cause.id == "axis_gap"
        assert (
            found.data_sha256
            == answer("diagnose", readings, "--machine", machine)["input"]["sha256"]
        )
        assert re.fullmatch(r"\d{4}-\d{2}-\d{2}", found.date or "")
        for true, estimate in zip(session.effects[0].parameters, found.estimates, strict=True):
            assert 0.0 < estimate.std < 0.05
            assert estimate.unit == "mm"
            assert abs(estimate.value - true) < 4.5 * estimate.std
        # Solved without bias.
        errors = []
        for model in (machine, extended):
            result = answer("solve", readings, "--machine", model)
            parameters = (result["alone"] or result)["parameters"]
            offsets = np.array([each["found"] for each in parameters])
            errors.append(np.abs(offsets - session.offsets).max())
        assert errors[0] > 0.03 > 0.015 > errors[1]
        again = answer("diagnose", readings, "--machine", extended)
        assert again["verdict"] == "consistent"
        # Never overwritten.
        kept = extended.read_bytes()
        ran = run("diagnose", readings, *accept)
        assert ran.exit_code == 2
        assert extended.read_bytes() == kept

    @pytest.mark.parametrize(
        ("data", "cause", "said"),
        [
            *((SESSION, cause, "lies in the measurement, not in the machine")
              for cause in ("misread", "stand_shift", "gauge_slip", "sign_flip")),
            (SIX, "axis_gap", "do not distinguish what lies in the machine from"),
            (DOUBLE, "axis_gap", "are consistent: they do not support axis_gap"),
            (SESSION, "encoder_scale", "contradict encoder_scale. They name axis_gap."),
        ],
    )  # fmt: skip
    def test_what_the_data_do_not_support_is_refused(
        self, tmp_path: Path, data: Path, cause: str, said: str
    ) -> None:
        """The result is shown all the same."""
        target = tmp_path / "new.yaml"
        ran = run("diagnose", data, "--accept", cause, "--output", target)
        assert ran.exit_code == 4
        assert said in words(ran.stderr)
        assert words(once("diagnose", data).stdout) in words(ran.stdout)
        assert not target.exists()

    def test_a_refusal_does_not_spoil_the_line_of_json(self, tmp_path: Path) -> None:
        target = tmp_path / "new.yaml"
        ran = run("diagnose", DOUBLE, "--json", "--accept", "axis_gap", "--output", target)
        assert ran.exit_code == 4
        assert [line["verdict"] for line in lines(ran)] == ["consistent"]


def sound_with(diagnosis: Diagnosis, share: float) -> Diagnosis:
    """The same, but for the probability that nothing is wrong."""
    others = [one for one in diagnosis.explanations if not one.sound]
    return changed(diagnosis, explanations=(*others, Explanation(probability=share)))


class TestText:
    def test_an_open_answer_offers_no_compensation(self) -> None:
        text = words(once("diagnose", SIX).stdout)
        assert "? Undecided: " in text
        assert "orthocal measure" in text
        assert "--accept" not in text

    def test_what_is_less_likely_than_nothing_is_not_called_likeliest(self) -> None:
        """The sound machine is one of the open answers, and then nothing must be wrong."""
        read = read_input(SIX)
        diagnosis = analysed(read.measured, read.model)
        faint = sound_with(diagnosis, 1.01 * diagnosis.causes[0].probability)
        first, second = (Case(read, answer_to(read, diagnosed=each)) for each in (diagnosis, faint))
        assert "a sound machine" not in headline(first)
        assert "a sound machine (" in headline(second)
        (before,), (after,) = (sentences(each.answer.release.reasons) for each in (first, second))
        assert before.startswith("Something is wrong")
        assert after.startswith("Something may be wrong")
        assert after.endswith("or from a sound machine.")


# Faults of the record, each with a seed whose truth stands clear of every rival.
RECORD = {"misread": 1, "gauge_slip": 3, "sign_flip": 2, "swapped_gauges": 37}

# What an Orthoglide can have.
OWN = {id: cause for id, cause in CAUSES.items() if Orthoglide in cause.sizes}


def hidden(cause: str) -> truth.Session:
    machine = truth.PROTOTYPE if RECORD[cause] % 2 else truth.LARGE
    return truth.make_session(RECORD[cause], machine, truth.MICRON, (cause,))


def resized(machine: Path, sizes: dict[str, float | None]) -> Path:
    """The machine file with other tolerances: id → size; None takes the entry away."""
    text = machine.read_text(encoding="utf-8")
    for id, size in sizes.items():
        entry = f"  {id}: {truth.machines.TOLERANCES[id]}\n"
        assert entry in text
        text = text.replace(entry, "" if size is None else f"  {id}: {size}\n")
    # A machine file is read once, so each has its own name.
    path = machine.with_name(f"{hashlib.sha256(text.encode()).hexdigest()}.yaml")
    path.write_text(text, encoding="utf-8")
    return path


def assumed(result: dict[str, Any]) -> dict[str, float]:
    """Id → size of what was tried at its default."""
    assert [each["id"] for each in result["assumed_sizes"]] == result["assumed"]
    return {each["id"]: each["size"] for each in result["assumed_sizes"]}


@pytest.mark.parametrize("cause", ["gauge_slip", "sign_flip"])
def test_what_the_machine_file_does_not_mention_is_named_all_the_same(
    cause: str, tmp_path: Path
) -> None:
    readings, machine = written(tmp_path, hidden(cause))
    silent = resized(machine, dict.fromkeys(RECORD))
    full = answer("diagnose", readings, "--machine", machine)
    found = answer("diagnose", readings, "--machine", silent)
    assert (found["verdict"], [one["id"] for one in found["causes"]]) == ("named", [cause])
    assert assumed(full) == {}
    assert assumed(found) == {id: truth.machines.TOLERANCES[id] for id in RECORD}
    note = "Assumed sizes (not in the machine file): "
    assert note in words(run("diagnose", readings, "--machine", silent, "--details").stdout)
    # These defaults are what the full file states, so nothing else differs.
    same = full.keys() - {"assumed", "assumed_sizes"}
    assert {key: found[key] for key in same} == {key: full[key] for key in same}


def test_a_machine_that_can_have_nothing_is_judged_all_the_same(tmp_path: Path) -> None:
    for cause, verdict in (("misread", "unexplained"), (None, "consistent")):
        session = hidden(cause) if cause else truth.make_session(21, truth.PROTOTYPE, truth.MICRON)
        readings, machine = written(tmp_path, session)
        found = answer("diagnose", readings, "--machine", resized(machine, dict.fromkeys(OWN, 0.0)))
        assert (found["verdict"], found["causes"], found["ambiguous_with"]) == (verdict, [], [])


def test_what_is_ruled_out_is_not_accepted(tmp_path: Path) -> None:
    session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
    readings, machine = written(tmp_path, session)
    target = tmp_path / "extended.yaml"
    ran = run(
        "diagnose", readings, "--machine", resized(machine, {"axis_gap": 0.0}),
        "--accept", "axis_gap", "--output", target,
    )  # fmt: skip
    assert ran.exit_code == 4
    assert "rules axis_gap out" in words(ran.stderr)
    assert not target.exists()


def test_only_what_was_tried_was_assumed(tmp_path: Path) -> None:
    """Differences have no order in time: what is seen in it alone plays no part."""
    _, machine = written(tmp_path, hidden("misread"))
    silent = resized(machine, dict.fromkeys(OWN))
    found = answer("diagnose", SIX, "--machine", silent)
    ids = set(assumed(found))
    assert {"axis_gap", "bar_skew", "misread"} <= ids
    assert not ids & {id for id, cause in CAUSES.items() if cause.timed}
    assert ids <= set(OWN)


@pytest.mark.parametrize(
    ("how", "factor", "cause", "seed"),
    [("halved", 0.5, "axis_squareness", 8), ("doubled", 2.0, "encoder_scale", 15)],
)
def test_it_is_the_answer_with_those_sizes(
    how: str, factor: float, cause: str, seed: int, tmp_path: Path
) -> None:
    """Also for defaults: as if the machine file stated each of them, halved or doubled.

    It is another answer than with the sizes as they are.
    """
    session = truth.make_session(seed, truth.PROTOTYPE, truth.DIAL, (cause,))
    readings, machine = written(tmp_path, session)
    sizes = {id: factor * size for id, size in truth.machines.TOLERANCES.items()}
    other = answer("diagnose", readings, "--machine", resized(machine, sizes))
    silent = resized(machine, dict.fromkeys(RECORD))
    found = answer("diagnose", readings, "--machine", silent)
    assert found["sensitivity"][how] == {
        "verdict": other["verdict"],
        "ids": sorted(one["id"] for one in other["causes"]),
    }
    assert other["verdict"] != found["verdict"]


def tried(model: Model, ordered: bool = True) -> set[Ids]:
    return set(Candidates.of(model, ordered).log_prior)


def test_two_machine_causes_never_stand_together() -> None:
    measured = {id for id, cause in OWN.items() if not cause.in_machine}
    pairs = [ids for ids in tried(NOMINAL) if len(ids) == 2]
    assert all(measured & set(ids) for ids in pairs)
    machine = set(OWN) - measured
    # Every cause of the machine with every one of the contact or the record.
    wanted = {tuple(sorted((a, b))) for a in machine for b in measured}
    assert wanted <= set(pairs)
    assert {(c,) for c in OWN} <= tried(NOMINAL)
    # What another kind of machine can have is not tried.
    assert {id for ids in tried(NOMINAL) for id in ids} == set(OWN) < set(CAUSES)


def test_only_what_can_be_is_tried() -> None:
    timed = {id for id, cause in CAUSES.items() if cause.timed}
    assert timed >= {"backlash", "thermal_drift", "gauge_drift", "stand_shift"}
    assert not any(timed & set(ids) for ids in tried(NOMINAL, ordered=False))
    gauge = PROTOTYPE.gauge.changed(revolution_mm=None)
    assert ("gauge_slip",) not in tried(Model(PROTOTYPE.changed(gauge=gauge)))
    none = dict.fromkeys(OWN, 0.0)
    few = Model(PROTOTYPE.changed(tolerances={**none, "axis_gap": 0.3, "misread": 0.1}))
    assert tried(few) == {(), ("axis_gap",), ("misread",), ("axis_gap", "misread")}
    assert tried(Model(PROTOTYPE.changed(tolerances=none))) == {()}
    assert tried(Model(PROTOTYPE.changed(tolerances={}))) == tried(NOMINAL)


def test_what_is_known_of_the_machine_is_not_tried_again() -> None:
    known_gap = extended(axis_gap=(0.1, 0.2, -0.1))
    assert not any("axis_gap" in ids for ids in tried(known_gap))
    assert any("bar_skew" in ids for ids in tried(known_gap))
