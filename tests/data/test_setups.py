"""Which readings share a gauge zero."""

from orthoglide_cal.data.setups import number_setups

from .helpers import readings


def numbers(places, gauges, ordered=True):
    return number_setups(places, gauges, range(len(places)), ordered=ordered).tolist()


def test_a_place_and_a_label_make_a_setup():
    assert numbers("aabab", ["", "", "", "", ""]) == [0, 0, 1, 0, 1]
    assert numbers("aaab", ["1", "2", "1", "1"]) == [0, 1, 0, 2]


def test_a_returning_gauge_has_a_new_zero():
    assert numbers("aabba", ["1"] * 5) == [0, 0, 1, 1, 2]
    assert numbers("aabba", ["1"] * 5, ordered=False) == [0, 0, 1, 1, 0]


def test_a_second_gauge_in_between_does_not_matter():
    assert numbers("ababab", ["1", "2"] * 3) == [0, 1, 0, 1, 0, 1]


def test_numbers_follow_time():
    places, gauges = "ba", ["", ""]
    assert number_setups(places, gauges, [1, 0], ordered=True).tolist() == [1, 0]


HEAD = "leg,posture,direction,gauge,reading_mm"
ROWS = ["x,iso,y,A,0.1", "x,max,y,A,0.2", "y,iso,z,A,0.3", "x,iso,y,A,0.4"]


def test_only_a_stated_order_tells_of_a_return(tmp_path):
    assert readings(tmp_path, "\n".join([HEAD, *ROWS])).plan.setup.tolist() == [0, 0, 1, 0]
    for column in ("seq", "minutes"):
        stated = [f"{HEAD},{column}", *(f"{row},{k}" for k, row in enumerate(ROWS))]
        read = readings(tmp_path, "\n".join(stated))
        assert read.plan.setup.tolist() == [0, 0, 1, 2]
        assert any("came back" in remark for remark in read.remarks)


def test_the_order_is_that_of_seq(tmp_path):
    stated = [f"{HEAD},seq", *(f"{row},{k}" for row, k in zip(ROWS, (0, 1, 3, 2), strict=True))]
    assert readings(tmp_path, "\n".join(stated)).plan.setup.tolist() == [0, 0, 1, 0]


def test_another_position_along_the_leg_is_another_setup(tmp_path):
    text = "leg,posture,direction,gauge_at,reading_mm\nx,iso,y,0.3,1\nx,iso,y,,1\nx,max,y,0.5,2\n"
    assert readings(tmp_path, text).plan.setup.tolist() == [0, 1, 1]
