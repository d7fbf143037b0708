"""Effects on a bed act in their region and as their names say, and large ones stand out."""

import numpy as np
import pytest

from .bed import HOWS, KINDS, Region, distinguish_bed, draw_bed
from .test_beyond import in_time


@pytest.mark.parametrize("how", HOWS)
@pytest.mark.parametrize("kind", ["half", "ring"])
def test_an_effect_is_what_it_says_in_its_region_and_nothing_elsewhere(how: str, kind: str) -> None:
    hidden = draw_bed(3, how, kind)
    session, added = hidden.session, hidden.session.contact
    rows = hidden.where.rows(session.x, session.y)
    assert 0 < rows.sum() < len(rows)
    assert not added[~rows].any()
    values, minutes = added[rows], session.minutes[rows]
    assert values == pytest.approx(in_time(how, values, minutes, hidden.shape), abs=1e-9)
    assert np.abs(values).max() > (1.0 if how == "scatters" else 4.0) * session.machine.noise


def test_regions_have_the_answers_names_and_cover_the_bed() -> None:
    x, y = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 200))
    # Of the halves two hold each place.
    counts = {"everything": 1, "half": 2, "quarter": 1, "ring": 1}
    for kind, names in KINDS.items():
        assert set(sum(Region(name).rows(x, y).astype(int) for name in names)) == {counts[kind]}
    assert (Region("edge").names, Region().names) == ({"region": "edge"}, {})
    assert Region("back left").kind == "quarter"


def test_a_step_of_one_pass_of_three_is_clear() -> None:
    far = distinguish_bed(draw_bed(3, "steps", "half"))
    assert far.clear
    assert all(how == "steps" for how, _ in far.same)
