"""What is tried, and how large it plausibly is: given, a default, or ruled out."""

import hashlib
from pathlib import Path
from typing import Any

import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference.candidates import Candidates, Ids
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import Orthoglide
from tests import truth
from tests.cli.program import SIX, answer, run, words
from tests.cli.program import written_in as written
from tests.machines import NOMINAL, PROTOTYPE, extended

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
