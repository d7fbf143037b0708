"""Editing a YAML file in place: what is not changed stays, letter by letter."""

import pytest
import yaml

from orthoglide_cal.files.yaml_tree import edited
from tests.files.helpers import PROTOTYPE

TEXT = PROTOTYPE.read_text(encoding="utf-8")


def test_only_the_line_of_the_key_changes_and_comments_keep_their_column() -> None:
    new = edited(TEXT, {"leg_length_mm": 400, "gauge": {"range_mm": 12.5}})
    before, after = TEXT.splitlines(), new.splitlines()
    assert [(a, b) for a, b in zip(before, after, strict=True) if a != b] == [
        (
            "leg_length_mm: 310.25          # L, the parallelograms' length",
            "leg_length_mm: 400             # L, the parallelograms' length",
        ),
        ("  range_mm: 10", "  range_mm: 12.5"),
    ]


HISTORY = [{"date": "2025-01-31", "before": {"x": 0.0}, "after": {"x": -0.25}}]
OTHER = {"x": 0.43, "y": -0.2, "z": 0.0}


@pytest.mark.parametrize(
    "text",
    [
        "name: a # b\noffsets_mm: {x: 0, y: 0, z: 0} # now\nidentified: []\n",
        "offsets_mm:\n  x: 0   # first\n  y: 0\n  # of z\n  z: 0\nname: a",
        "offsets_mm: {x: 0}\nhistory: []\nname: a\n",
        "offsets_mm:\nhistory:\n\n# of the name\nname: a\n",
        "offsets_mm: {x: 0,\n  y: 0, z: 0}\nhistory: ~ # none\nname: a\n",
        "history:\n  - {date: a}\n  # second\n  - date: b\n    after: {x: 1} # end\nname: a\n",
        'name: "a"\nhistory:\n- date: a\n  before: {x: 0}\n- {date: b}\n# the end\n',
    ],
)
def test_values_are_those_asked_for_and_every_comment_outside_them_stays(text: str) -> None:
    wanted = {"offsets_mm": OTHER, "history": HISTORY}
    new = edited(text, wanted)
    assert yaml.safe_load(new) == {**yaml.safe_load(text), **wanted}
    for comment in ("# b", "# now", "# first", "# of z", "# of the name", "# none", "# the end"):
        assert (comment in new) == (comment in text)


@pytest.mark.parametrize("text", ["history:\n- {a: 1}\n- a: 2\n", "history: # h\n  - a: 1\nn: 1\n"])
def test_a_list_is_emptied(text: str) -> None:
    assert yaml.safe_load(edited(text, {"history": []})) == {**yaml.safe_load(text), "history": []}


def test_a_value_is_put_back_exactly() -> None:
    changed = edited(TEXT, {"offsets_mm": OTHER})
    assert changed != TEXT
    assert edited(changed, {"offsets_mm": {"x": 0, "y": 0, "z": 0}}) == TEXT
