"""`orthocal plan`: what it promises is what `measure` and `solve` do then."""

import html
import re
import textwrap
from pathlib import Path

import yaml

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.planning.design import GIVES_UP
from tests.cli.program import lines, once, run, words
from tests.machines import ROOT

OWN = [id for id, cause in CAUSES.items() if Orthoglide in cause.sizes]

KEYS = {
    "schema_version", "machine", "protocol", "gauges", "cycles", "by_cycles", "budget", "limits",
    "target", "compare", "separation", "invisible", "design",
}  # fmt: skip


def machine(folder: Path, **changes: object) -> str:
    shipped = (ROOT / "configs" / "orthoglide_prototype.yaml").read_text("utf-8")
    given = {**yaml.safe_load(shipped), **changes}
    path = folder / "mine.yaml"
    kept = {name: value for name, value in given.items() if value is not None}
    path.write_text(yaml.safe_dump(kept), encoding="utf-8")
    return str(path)


def test_the_json_is_that_of_the_contract() -> None:
    shown = once("plan", "--json")
    assert shown.stdout.count("\n") == 1
    (data,) = lines(shown)
    assert set(data) >= KEYS
    assert "next" not in data  # without a file
    row = next(each for each in data["by_cycles"] if each["cycles"] == 3)
    assert row["readings"] == 60
    for key in ("noise_std_mm", "expanded_mm"):
        assert list(row[key]) == ["x", "y", "z"]
    assert row["minutes"] > 0.0
    count = len(OWN)
    assert len(data["separation"]) == count * (count - 1) // 2
    assert {id for each in data["separation"] for id in each["causes"]} == set(OWN)
    assert "leg_length" in data["invisible"]
    design = data["design"]
    assert set(design) >= {"readings", "minutes", "gauge_at", "noise_std_mm"}
    assert design["share_of_readings"] <= 0.65
    assert data["limits"]["source"] == "leg_length"
    assert {each["method"] for each in data["compare"]} == {
        "single", "single-sequential", "six-linear", "twelve-linear", "six", "twelve", "readings",
    }  # fmt: skip


def test_a_target_takes_as_many_cycles_as_it_needs() -> None:
    (data,) = lines(once("plan", "--target", "0.022", "--json"))
    assert data["target"] == {"expanded_mm": 0.022, "reached": True, "cycles": data["cycles"]}
    reach = {each["cycles"]: max(each["expanded_mm"].values()) for each in data["by_cycles"]}
    assert reach[data["cycles"]] <= 0.022 < reach[6]
    shown = once("plan", "--target", "0.022").stdout
    assert f"± 0.022 mm takes {data['cycles']} cycles" in shown


def test_a_target_below_what_cannot_be_seen_says_what_would_help(tmp_path: Path) -> None:
    def said(target: str, *options: str) -> str:
        shown = once("plan", "--target", target, *options).stdout
        return words(shown.partition("\nNext\n")[0])

    small = said("0.01")
    assert "✘ ± 0.01 mm cannot be reached in this way" in small
    assert "± 0.019 mm stays (leg_length)." in small
    # A target beyond all reason is repeated as it was asked.
    smaller = said("1e-9")
    assert "± 1e-09 mm cannot be reached in this way" in smaller
    assert smaller.count("stays (leg_length). Measure the legs") == 1
    coarse = {"resolution_mm": 0.5, "range_mm": 10.0, "repeatability_mm": 5.0}
    noisy = said("0.1", "--machine", machine(tmp_path, gauge=coarse))
    assert "It needs more than 50 cycles, because the readings scatter" in noisy


def test_more_cycles_are_said_to_help_where_they_do(tmp_path: Path) -> None:
    assert "More cycles help little" in once("plan").stdout
    assert "More cycles hardly help" in run("plan", "--cycles", "10").stdout
    known = {"leg_length": 0.0}
    exact = {"resolution_mm": 0.01, "range_mm": 10, "repeatability_mm": 0.006,
             "placement_mm": 0.01, "scale_u": 1e-6}  # fmt: skip
    path = machine(tmp_path, tolerances=known, gauge=exact)
    assert "more cycles help" in run("plan", "--machine", path).stdout


def test_a_machine_without_possible_causes_is_planned_for(tmp_path: Path) -> None:
    none = machine(tmp_path, tolerances=dict.fromkeys(OWN, 0.0))
    shown = run("plan", "--machine", none, "--details")
    assert shown.exit_code == 0
    assert "No cause leaves a trace." in shown.stdout
    only = machine(tmp_path, tolerances={**dict.fromkeys(OWN, 0.0), "axis_gap": 0.5})
    assert "A axis_gap" in run("plan", "--machine", only, "--details").stdout
    (data,) = lines(run("plan", "--machine", only, "--json"))
    assert data["separation"] == []


def test_what_it_says_to_type_can_be_typed(tmp_path: Path) -> None:
    path = machine(tmp_path)
    shown = run("plan", "--gauges", "1", "--machine", path).stdout
    assert f"orthocal measure --machine {path} --gauges 1" in shown
    shown = run("plan", "--design", "best", "--cycles", "5", "--machine", path).stdout
    assert f"orthocal measure --machine {path} --design best --cycles 5" in shown


def test_its_page_has_what_is_shown_and_short_facts() -> None:
    assert GIVES_UP in words(run("plan", "--details").stdout)  # as measure says it
    text = run("plan", "--html", "-").stdout
    assert "█&lt;1" in text
    assert "A axis_gap" in text
    # A heading of 360 px shows two lines of about 27 characters of each fact.
    header = text.partition("<header>")[2].partition("</header>")[0]
    facts = [re.sub("<[^>]*>", "", fact) for fact in re.findall("<dd>(.*?)</dd>", header)]
    assert len(facts) >= 2
    assert all(len(textwrap.wrap(html.unescape(fact), 27)) <= 2 for fact in facts), facts
