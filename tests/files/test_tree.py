"""YAML without its traps; hostile files are refused while little work is done."""

import time

import pytest
import yaml

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.machine_file import edited
from orthoglide_cal.files.tree import load_tree, yaml_text

from .helpers import PROTOTYPE, document

LAUGHS = "a: &a [x,x,x]\n" + "".join(
    f"{c}: &{c} [*{b},*{b},*{b},*{b}]\n" for b, c in zip("abcdefgh", "bcdefghi", strict=True)
)

HOSTILE = {
    "billion laughs": (LAUGHS, "Anchors and aliases"),
    "object": ("a: !!python/object/apply:os.system ['true']\n", "Tags"),
    "6 MB": ("a: " + "x" * 6_000_000, "larger than 5 MB"),
    "deep lists": ("[" * 100_000, "deeper than 20"),
    "deep maps": ("{a: " * 100_000, "deeper than 20"),
    "many values": ("a: [" + "1," * 2_000_000 + "]", "values"),
    "many keys": ("".join(f"k{i}: 1\n" for i in range(300_000)), "values"),
    "complex keys": ("? " * 200_000, "key must be a word"),
    "open quote": ('a: "' + "x" * 4_000_000, "not valid YAML"),
    "two documents": ("a: 1\n---\nb: 2\n", "several documents"),
    "escape sequence": ('a: "\\e[31m"\n', "control character"),
    "tab": ("a:\n\tb: 1\n", "not valid YAML: a tab in the indentation.*Indent with spaces"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_text_is_refused_quickly(name):
    text, what = HOSTILE[name]
    start = time.process_time()
    with pytest.raises(InputError, match=what) as caught:
        load_tree(document(text, "bad.yaml"))
    assert time.process_time() - start < 1.0
    assert caught.value.file == "bad.yaml"
    assert caught.value.remedy
    assert len(str(caught.value)) < 500


def test_scalars_stay_text_and_lines_are_known():
    tree = load_tree(document("a: 1e-3\nb:\n  - 012\n  - c: on\n    d: ~\ne: 'null'\nf: 1:30\n"))
    assert tree.value == {
        "a": "1e-3", "b": ["012", {"c": "on", "d": None}], "e": "null", "f": "1:30",
    }  # fmt: skip
    assert [tree.place(path)[0] for path in (("b",), ("b", 1, "d"), ("b", 9, "x"), ("e",))] == [
        2, 5, 2, 6,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("a: 1\nb: {c: 1, c: {d: 2}}\na: 3\n", [(2, "b.c"), (3, "a")]),
        # Also inside a duplicate.
        (
            "a: 1\nb: {c: 1}\na: {b: 1, b: 2, c: [{d: 1, d: 2}]}\n",
            [(3, "a.b"), (3, "a.c[0].d"), (3, "a")],
        ),
        ("a: 1\nb: {c: 1}\nl: [{c: 0, c: 1}]\n", [(3, "l[0].c")]),
    ],
)
def test_duplicate_keys_are_all_noted(text, faults):
    tree = load_tree(document(text))
    assert [(f.line, f.column) for f in tree.problems] == faults
    assert (tree.value["a"], tree.value["b"]) == ("1", {"c": "1"})


def test_yaml_has_no_aliases_which_the_reader_refuses():
    same = {"x": 1.5}
    text = yaml_text({"a": same, "b": [same, same]})
    tree = load_tree(document(text, "same.yaml"))
    assert tree.value == {"a": {"x": "1.5"}, "b": [{"x": "1.5"}, {"x": "1.5"}]}


# --- edited in place: what is not changed stays, letter by letter ------------------------------

TEXT = PROTOTYPE.read_text(encoding="utf-8")


def test_only_the_line_of_the_key_changes() -> None:
    new = edited(TEXT, {("leg_length_mm",): 400, ("gauge", "range_mm"): 12.5})
    before, after = TEXT.splitlines(), new.splitlines()
    assert [(a, b) for a, b in zip(before, after, strict=True) if a != b] == [
        (
            "leg_length_mm: 310.25          # L, the parallelograms' length",
            "leg_length_mm: 400          # L, the parallelograms' length",
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
    offsets = {("offsets_mm", axis): value for axis, value in OTHER.items()}
    whole = offsets if "# first" in text else {("offsets_mm",): OTHER}
    new = edited(text, {**whole, ("history",): HISTORY})
    assert yaml.safe_load(new) == {**yaml.safe_load(text), **wanted}
    for comment in ("# b", "# now", "# first", "# of z", "# of the name", "# none", "# the end"):
        assert (comment in new) == (comment in text)


@pytest.mark.parametrize(
    "text",
    [
        "a: 1\nh: []\n",
        "a: 1\nh: [] # none",
        "h:\n  - a: 0 # first\n\n# then\nb: 2\n",
        "h:\r\n- {a: 0}\r\n- b: 1\r\n",
        '{"h": [{"a": 0}, {"b": 1}], "complete": true}\n',
    ],
)
def test_an_item_comes_last_and_goes_again(text: str) -> None:
    items = yaml.safe_load(text)["h"]
    new = edited(text, {("h", len(items)): {"x": 1, "y": [1, 2], "z": {"b": [{"c": 1}]}}}, " # no")
    assert yaml.safe_load(new)["h"][:-1] == items
    assert "\r" not in text or new.count("\r\n") == new.count("\n")
    assert yaml.safe_load(new)["h"][-1]["z"] == {"b": [{"c": 1}]}
    assert edited(new, {("h", len(items)): None}) == text


@pytest.mark.parametrize("text", ["a: 1", "a:\n  b: 1 # b\n# end\n", "a: 1\n\ncomplete: true\n"])
def test_a_key_comes_last_and_goes_again(text: str) -> None:
    new = edited(text, {("h",): [{"x": 1}], ("v",): {"x": 1}}, " # new")
    assert new.count(" # new\n") == 2 or new.endswith(" # new")
    assert yaml.safe_load(new) == {**yaml.safe_load(text), "h": [{"x": 1}], "v": {"x": 1}}
    assert edited(new, {("v",): None, ("h",): None}) == text
