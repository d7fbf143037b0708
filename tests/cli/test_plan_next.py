"""`plan FILE`: what to measure next, ranked; `diagnose` names the first of it."""

from pathlib import Path

import pytest

from orthoglide_cal.files import write_text
from tests import truth
from tests.cli.program import DOUBLE, SINGLE, SIX, lines, run

KEYS = {"what", "minutes", "separates", "separation_sigma", "expanded_mm", "chance"}


@pytest.fixture(scope="module")
def open_session(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A skewed bar beside which exchanged gauges are possible, and its machine file."""
    folder: Path = tmp_path_factory.mktemp("open")
    session = truth.make_session(7_100_003, truth.PROTOTYPE, truth.DIAL, ("bar_skew",))
    write_text(folder / "machine.yaml", truth.machine_yaml(truth.PROTOTYPE, truth.DIAL))
    path = truth.write_readings(session, folder / "first.csv")
    return str(path), str(folder / "machine.yaml")


def test_the_ranking_begins_with_what_diagnose_names(open_session: tuple[str, str]) -> None:
    path, machine = open_session
    (plan,) = lines(run("plan", path, "--machine", machine, "--json"))
    (diagnosis,) = lines(run("diagnose", path, "--machine", machine, "--json"))
    first, *others = plan["next"]
    assert set(first) == KEYS
    assert diagnosis["verdict"] == "ambiguous"
    assert diagnosis["next_measurement"] == {
        name: first[name] for name in ("what", "separates", "separation_sigma")
    }
    assert first["chance"] > 0.95
    # What settles it almost surely comes first, the quickest before the others.
    sure = [each for each in plan["next"] if each["chance"] >= 0.95]
    assert plan["next"][: len(sure)] == sure
    assert [each["minutes"] for each in sure] == sorted(each["minutes"] for each in sure)
    assert others[-1]["chance"] < 0.5


def test_the_text_says_what_to_type(open_session: tuple[str, str]) -> None:
    path, machine = open_session
    shown = run("plan", path, "--machine", machine).output
    # The recommendation leads.
    assert next(line for line in shown.splitlines() if line[:1] in "i!✔✘").startswith("i Next, ")
    assert "What to measure next, best first" in shown
    assert "First what settles almost surely" in " ".join(shown.split())
    assert "measure --then" in shown
    assert "settles" in shown
    page = run("diagnose", path, "--machine", machine).output
    assert "Read next: " in page
    assert " min and tells bar_skew from " in page


@pytest.mark.parametrize("path", [DOUBLE, SINGLE, SIX])
def test_every_kind_of_data_has_a_next(path: str) -> None:
    """Sound data, too: ranked by the uncertainty that is left for the time."""
    (plan,) = lines(run("plan", path, "--json"))
    found = plan["next"]
    assert found
    assert all(each["minutes"] > 0.0 for each in found)
    assert {len(each["separates"]) for each in found} <= {0, 2}
    if not any(each["separates"] for each in found):
        assert all(each["chance"] == 0.0 for each in found)
        assert min(found, key=lambda each: each["expanded_mm"]["x"])["expanded_mm"]["x"] > 0.0


def test_without_a_file_nothing_is_next() -> None:
    (plan,) = lines(run("plan", "--json"))
    assert "next" not in plan


def test_a_file_that_cannot_be_read_is_refused() -> None:
    done = run("plan", "nowhere.csv")
    assert done.exit_code == 3
    assert "nowhere.csv" in done.output
