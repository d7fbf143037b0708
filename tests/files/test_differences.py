"""Files of differences: kinds by their names, and every fault."""

from pathlib import Path

import pytest

from orthoglide_cal.files.input import read_input
from orthoglide_cal.model.measured import DIFFERENCES, DataKind
from tests.sentences import sentences

from .helpers import MODEL, differences

SAMPLES = Path(__file__).parents[2] / "sample_data"


def table(names, value="0.1"):
    return "difference,value_mm\n" + "".join(f"{name},{value}\n" for name in names)


@pytest.mark.parametrize("kind", DIFFERENCES)
@pytest.mark.parametrize("d", ["d", "", "D", "Δ"])
def test_kinds_are_recognised_by_name(tmp_path, kind, d):
    which = DIFFERENCES[kind][::-1]
    read = differences(tmp_path, table([d + difference.name[1:] for difference in which]))
    assert read.kind is kind
    assert read.which == which
    assert read.value.tolist() == [0.1] * len(which)
    assert read.remarks == ()


def test_the_papers_experiments():
    """Table 4, with Δx_z = +1.48 in experiment 1 as its r.m.s. of 1.19 demands."""
    expected = {
        1: ([0.52, 1.48, 2.37, -0.25, -0.57, -0.04], 1.19),
        2: ([-0.43, -0.37, 0.42, -0.18, -1.14, -0.70], 0.62),
        3: ([-0.23, 0.27, 0.34, -0.10, -0.09, 0.11], 0.21),
    }
    for number, (values, rms) in expected.items():
        read = read_input(str(SAMPLES / f"experiment{number}.csv"), MODEL).measured
        assert (read.kind, read.which) == (DataKind.SIX, DIFFERENCES[DataKind.SIX])
        assert read.value.tolist() == values
        assert round(float((read.value**2).mean() ** 0.5), 2) == rms


def test_other_ways_to_write_the_same(tmp_path):
    read = differences(
        tmp_path, "Difference ; Value_mm\r\n# c\r\ndX_Y+;\u22120,01\r\n\r\n d x_y\u2212 ;0.02\r\n"
    )
    assert [difference.name for difference in read.which] == ["dx_y+", "dx_y-"]
    assert read.value.tolist() == [-0.01, 0.02]


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        (table(["x_y", "x_z", "y_x", "z_x"]), "six", "differences these are missing: dy_z, dz_y"),
        (table(["z_x+", "z_y-"]), "twelve", "twelve differences these are missing"),
    ],
)
def test_remarks(tmp_path, text, kind, words):
    read = differences(tmp_path, text)
    assert read.kind == kind
    assert any(words in remark for remark in sentences(read.remarks))
