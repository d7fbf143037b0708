"""From probabilities to a verdict, on probabilities made up for the purpose."""

from dataclasses import replace
from itertools import combinations
from math import exp, log

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES, Step
from orthoglide_cal.data import read_measured
from orthoglide_cal.diagnosis.explanations import UNLISTED, Menu, menu_of
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.diagnosis.posterior import (
    DISMISSED,
    ODDS_TO_NAME,
    Posterior,
    answer,
    misfit,
)
from orthoglide_cal.machine import Estimate, IdentifiedCause
from orthoglide_cal.simulation import simulate
from tests.machines import PROTOTYPE, SAMPLES

FITS = 0.3  # chance of the misfit of an explanation that leaves no more than noise


def posterior(unlisted: float = 0.0, **listed: float) -> Posterior:
    """Shares by ids joined with "_and_"; "nothing" is (); normalised."""
    keys = {
        (): listed.pop("nothing", 1e-12),
        **{tuple(sorted(k.split("_and_"))): v for k, v in listed.items()},
    }
    total = sum(keys.values()) + unlisted
    return Posterior({k: v / total for k, v in keys.items()}, {"a pattern": unlisted / total})


class TestVerdict:
    def test_a_cause_that_stands_alone_is_named(self) -> None:
        found = answer(posterior(axis_gap=1.0, bar_skew=0.5 * DISMISSED), FITS)
        assert (found.verdict, found.accepted, found.ambiguous_with) == ("named", ("axis_gap",), ())

    def test_a_rival_in_reach_makes_it_ambiguous(self) -> None:
        found = answer(posterior(axis_gap=1.0, bar_skew=2.0 * DISMISSED, misread=0.3), FITS)
        assert found.verdict == "ambiguous"
        assert found.accepted == ("axis_gap",)
        assert found.ambiguous_with == ("misread", "bar_skew")

    def test_more_of_the_same_is_no_rival(self) -> None:
        """A second cause beside the best one does not contradict it."""
        found = answer(posterior(axis_gap=1.0, axis_gap_and_leg_length=0.2), FITS)
        assert (found.verdict, found.accepted) == ("named", ("axis_gap",))
        # Nor does a second one beside a rival say more than the rival itself.
        found = answer(posterior(axis_gap=1.0, bar_skew=0.2, bar_skew_and_misread=0.1), FITS)
        assert found.ambiguous_with == ("bar_skew",)

    def test_of_a_pair_only_the_doubtful_part_is_doubted(self) -> None:
        both = posterior(axis_gap_and_misread=1.0, axis_gap_and_stand_shift=0.8)
        found = answer(both, FITS)
        assert found.verdict == "ambiguous"
        assert found.accepted == ("axis_gap", "misread")
        assert found.ambiguous_with == ("stand_shift",)

    def test_nothing_is_named_before_the_odds_are_reached(self) -> None:
        below = posterior(nothing=1.0, axis_gap=0.5 * ODDS_TO_NAME, misread=0.4 * ODDS_TO_NAME)
        found = answer(below, FITS)
        assert (found.verdict, found.accepted) == ("consistent", ())
        assert found.ambiguous_with == ("axis_gap", "misread")
        assert answer(posterior(nothing=1.0, axis_gap=1.1 * ODDS_TO_NAME), FITS).verdict == "named"

    def test_what_would_have_been_seen_is_not_mentioned(self) -> None:
        found = answer(posterior(nothing=1.0, leg_length=0.06, axis_gap=1e-6), FITS)
        assert found.ambiguous_with == ("leg_length",)

    def test_a_pattern_beyond_the_list_wins(self) -> None:
        found = answer(posterior(unlisted=2.0, axis_gap=1.0), FITS)
        assert (found.verdict, found.accepted) == ("unexplained", ())
        assert answer(posterior(unlisted=0.5, axis_gap=1.0), FITS).verdict == "named"

    def test_the_best_of_bad_explanations_is_none(self) -> None:
        found = answer(posterior(axis_gap=1.0), 1e-6)
        assert (found.verdict, found.accepted) == ("unexplained", ())


def test_bayes_rule_with_the_menu_s_weights() -> None:
    menu = Menu((), (), (), ((),), {(): log(0.5), ("a",): log(0.2)})
    found = Posterior.of({(): 3.0, ("a",): 5.0}, menu, {"p": 4.0, "q": 2.0})
    parts = [
        0.5 * exp(3.0), 0.2 * exp(5.0), 0.5 * UNLISTED * exp(4.0), 0.5 * UNLISTED * exp(2.0)
    ]  # fmt: skip
    got = [found.listed[()], found.listed["a",], found.unlisted["p"], found.unlisted["q"]]
    assert got == pytest.approx([part / sum(parts) for part in parts])
    assert found.something == pytest.approx(got[1])
    assert found.nothing_listed == pytest.approx(got[2] + got[3])


def test_misfit_is_the_tail_of_chi_square() -> None:
    """2 degrees of freedom: exp(−x/2)."""
    assert misfit(7.0 * 0.01**2, 2.0, 0.01) == pytest.approx(exp(-3.5))
    assert misfit(1.0, 0.0, 0.01) == 1.0


class TestMenu:
    def test_two_machine_causes_never_stand_together(self) -> None:
        menu = menu_of(PROTOTYPE, timed=True)
        measured = {
            id for id, c in CAUSES.items() if c.step in (Step.CONTACT, Step.RECORD)
        }  # fmt: skip
        pairs = [key for key in menu.log_prior if len(key) == 2]
        assert all(measured & set(key) for key in pairs)
        machine = set(CAUSES) - measured
        # Every cause of the machine with every one of the contact or the record.
        wanted = {tuple(sorted((a, b))) for a in machine for b in measured}
        assert wanted <= set(pairs)
        assert {(c,) for c in CAUSES} <= set(menu.log_prior)

    def test_weights_are_probabilities(self) -> None:
        menu = menu_of(PROTOTYPE, timed=True)
        assert sum(map(exp, menu.log_prior.values())) + UNLISTED == pytest.approx(1.0)

    def test_only_what_can_be_is_tried(self) -> None:
        tried = set(menu_of(PROTOTYPE, timed=False).log_prior)
        timed = {id for id, cause in CAUSES.items() if cause.timed}
        assert timed >= {"backlash", "thermal_drift", "gauge_drift", "stand_shift"}
        assert not any(timed & set(key) for key in tried)
        gauge = replace(PROTOTYPE.gauge, revolution_mm=None)
        without_dial = menu_of(replace(PROTOTYPE, gauge=gauge), timed=True)
        assert ("gauge_slip",) not in without_dial.log_prior
        few = replace(PROTOTYPE, tolerances={"axis_gap": 0.3, "misread": 0.1})
        assert set(menu_of(few, timed=True).log_prior) == {
            (), ("axis_gap",), ("misread",), ("axis_gap", "misread")
        }  # fmt: skip
        none = menu_of(replace(PROTOTYPE, tolerances={}), timed=True)
        assert set(none.log_prior) == {()}

    def test_what_is_known_of_the_machine_is_not_tried_again(self) -> None:
        estimate = Estimate(0.1, 0.01, "mm")
        gap = IdentifiedCause(
            "axis_gap", "", dict.fromkeys(("xy", "yz", "zx"), estimate), "2024-05-06", "0" * 64
        )
        menu = menu_of(replace(PROTOTYPE, identified=(gap,)), timed=True)
        assert not any("axis_gap" in key for key in menu.log_prior)


class TestFrame:
    @pytest.mark.parametrize(
        "name", ["experiment2.csv", "double_posture_session.csv", "single_posture_session.csv"]
    )
    def test_noise_of_the_whitened_data_is_white(self, name: str) -> None:
        frame = Frame.of(read_measured(str(SAMPLES / name), PROTOTYPE), PROTOTYPE)
        k = len(frame.data)
        assert frame.matrix @ frame.matrix.T == pytest.approx(np.eye(k), abs=1e-12)
        assert np.abs(frame.matrix @ frame.plan.zeros).max() < 1e-12

    def test_six_differences_pass_the_isotropic_posture(self) -> None:
        """max − min alone would have the carriages go straight from limit to limit."""
        frame = Frame.of(read_measured(str(SAMPLES / "experiment2.csv"), PROTOTYPE), PROTOTYPE)
        assert set(frame.plan.displacement.tolist()) == {0.0, 60.0, -100.0}
        readings = simulate(PROTOTYPE, np.array([0.3, -0.5, 0.2]), frame.plan)
        differences = frame.root @ frame.matrix @ readings
        high, low = (frame.plan.displacement == d for d in (60.0, -100.0))
        by_series = {
            frame.plan.series_name(int(i)): readings[i] - readings[j]
            for i, j in combinations(range(len(readings)), 2)
            for i, j in ((i, j), (j, i))
            if high[i] and low[j] and frame.plan.series()[i] == frame.plan.series()[j]
        }
        expected = [by_series[name] for name in ("x_y", "x_z", "y_x", "y_z", "z_x", "z_y")]
        assert differences == pytest.approx(expected, abs=1e-12)
