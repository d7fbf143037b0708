"""`orthocal guide json`: the keys of `--json`, as the schemas of the answer say them.

To write the page again: python -m tests.results.test_schema
"""

import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from orthoglide_cal.results.answer import Answer
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
CONTRACT = yaml.safe_load(Path(__file__).with_name("contract.yaml").read_text(encoding="utf-8"))
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
    """Those of plan and history are looked for where they are printed."""
    assert set(CONTRACT["answer"].split()) <= WHOLE["properties"].keys()
    for name, keys in CONTRACT["parts"].items():
        assert set(keys.split()) <= PARTS[name]["properties"].keys(), name


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
