"""`orthocal guide json`: the keys of `--json`, as the schemas of the answer say them.

To write the page again: python -m tests.results.test_schema
"""

import textwrap
from collections.abc import Iterator
from typing import Any

from orthoglide_cal.results import Answer
from tests.machines import ROOT

PAGE = ROOT / "orthoglide_cal" / "guide" / "json.md"
HEAD = """\
# The answer as JSON

`solve`, `diagnose` and `export` print this object with `--json`, one line for
each input file. `report --json` has it under `answer`. An input that cannot be
used gives `{"input": {"path": …}, "error": …}` in its place.
"""
WHOLE = Answer.model_json_schema(mode="serialization")
PARTS = WHOLE["$defs"]
TYPES = {"integer": "whole number", "string": "text", "boolean": "true or false"}


def type_words(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        part = PARTS[name]
        return type_words(part) if "enum" in part else str(name)
    if "const" in schema:
        return str(schema["const"])
    if "enum" in schema:
        return ", ".join(schema["enum"])
    if "anyOf" in schema:
        return " or ".join(map(type_words, schema["anyOf"]))
    if schema["type"] == "array":
        inner = schema.get("items") or schema["prefixItems"][0]
        return f"[{type_words(inner)}, …]"
    if schema["type"] == "object":
        return f"{{name: {type_words(schema['additionalProperties'])}, …}}"
    return TYPES.get(schema["type"], schema["type"])


def lines(title: str, schema: dict[str, Any]) -> Iterator[str]:
    yield f"\n## {title}\n"
    for paragraph in schema["description"].split("\n\nAttributes:")[0].split("\n\n"):
        yield textwrap.fill(paragraph, 78, break_on_hyphens=False) + "\n"
    for name, each in schema["properties"].items():
        meaning = f"; {each['description']}" if "description" in each else ""
        text = f"- `{name}`: {type_words(each)}{meaning}"
        yield from textwrap.wrap(text, 78, subsequent_indent="  ", break_on_hyphens=False)


def page() -> str:
    parts = {name: each for name, each in PARTS.items() if "properties" in each}
    named = {"Answer": WHOLE, **parts}
    return HEAD + "".join(f"{line}\n" for name in named for line in lines(name, named[name]))


def test_the_guide_says_the_keys_of_the_schema() -> None:
    assert PAGE.read_text(encoding="utf-8") == page()


def test_every_key_of_the_contract_is_there() -> None:
    """Other programs are written against these: keys may be added, none may go."""
    contract = (
        "schema_version input machine method verdict explanations release parameters k correlation"
        " alone rms noise deviations budget lack_of_fit converged residuals causes baselines"
        " ambiguous_with beyond_tolerance not_excluded assumed undetermined next_measurement check"
        " workspace sensitivity notes"
    )
    parts = {
        "InputFile": "path sha256 kind readings",
        "MachineName": "name kind",
        "Explanation": "ids probability rms_mm parameters",
        "Release": "usable needed settled reasons cautions codes",
        "Parameter": "name unit active found std expanded enter determined",
        "Alone": "parameters rms_after_mm",
        "Residue": "before_mm after_mm",
        "Noise": "used_mm repeats_mm residuals_mm stated_mm floor_mm dof",
        "PromisedDifference": "name measured_mm modelled_mm expected_mm expanded_mm",
        "Contribution": "source type size unit assumed std",
        "LackOfFit": "statistic dof p_value repeats_p_value left_mm expected_mm",
        "Residual": "leg direction posture x_mm y_mm measured_mm modelled_mm with_causes_mm",
        "FoundCause": "id probability where parameters rms_before_mm rms_after_mm"
        " heldout_before_mm heldout_after_mm heldout_ratio aliases times_stated remedy recommended",
        "Estimate": "name unit value std",
        "Baselines": "quartic_mm earlier_map_mm",
        "NextMeasurement": "what minutes separates separation_sigma",
        "CheckReading": "what expected_mm expanded_mm before_mm",
        "Workspace": "before_mm after_mm limit_mm",
    }
    assert set(contract.split()) <= WHOLE["properties"].keys()
    for name, keys in parts.items():
        assert set(keys.split()) <= PARTS[name]["properties"].keys(), name


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
