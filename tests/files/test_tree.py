"""YAML without its traps; hostile files are refused while little work is done."""

import time

import pytest

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.tree import load_tree, yaml_text

from .helpers import document

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
