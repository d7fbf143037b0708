"""The causes as a list: one stage each, found by being there."""

import re

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model.model import Cause, Stage
from orthoglide_cal.report.sentences import cause_words
from tests.machines import ROOT
from tests.subjects import SUBJECTS, Subject, every_cause, every_subject

alone = pytest.mark.parametrize("cause", CAUSES.values(), ids=list(CAUSES))


@every_subject
def test_a_machine_file_that_ships_sizes_what_its_kind_can_have(subject: Subject) -> None:
    own = {id for id, cause in CAUSES.items() if type(subject.machine) in cause.sizes}
    assert set(subject.machine.tolerances) == own
    assert own < set(CAUSES)


@every_cause
def test_it_does_not_happen_on_other_kinds(cause: Cause, subject: Subject) -> None:
    for other in SUBJECTS.values():
        silent = other.machine.changed(tolerances={})
        assert cause.possible(silent) == (type(silent) in cause.sizes)
        assert cause.assumed(silent) == (type(silent) in cause.sizes)
        assert cause.stated(silent) == cause.sizes.get(type(silent), 0.0)
    assert cause.possible(subject.machine)
    assert not cause.assumed(subject.machine)


@every_cause
def test_each_acts_in_its_own_stage_alone(cause: Cause, subject: Subject) -> None:
    """All four stages by hand: one changes what it is given, three give it back."""
    theta = cause.scale * np.linspace(1.0, 2.0, cause.unknowns)
    model, plan, machine = subject.model, subject.plan, subject.machine
    place = cause.places(plan, machine)[-1]
    geometry, command = model.real.geometry, model.machine.command(plan)
    rng = np.random.default_rng(3)
    joints, heights = command.joints + 0.1, rng.normal(0.0, 1.0, len(plan))
    where = model.machine.sensed(model.real, subject.values, plan, True)[1]
    where = where + rng.uniform(-0.3, 0.3, where.shape)
    bent = cause.geometry(geometry, theta)
    given = {
        "geometry": np.concatenate((geometry.points, geometry.directions, [geometry.lengths])),
        "motion": joints,
        "contact": heights,
        "record": heights,
    }
    found = {
        "geometry": np.concatenate((bent.points, bent.directions, [bent.lengths])),
        "motion": cause.motion(joints, theta, command),
        "contact": cause.contact(heights, cause.at(theta, place), plan, machine, where),
        "record": cause.record(heights, cause.at(theta, place), plan, machine),
    }
    changed = [stage for stage in Stage if not np.array_equal(given[stage], found[stage])]
    assert changed == [cause.stage]


@every_cause
def test_each_tells_a_technician_what_it_is_and_what_to_do(cause: Cause, subject: Subject) -> None:
    words = cause_words(cause.id, subject.machine, "there")
    assert {*words} == {"title", "check", "advice", "no_setting"}
    for phrase in (words["title"], words["check"]):
        assert phrase[0].islower()
        assert phrase[-1] != "."
    assert len(words["check"]) <= 62
    assert words["advice"].endswith(".")
    assert len(words["advice"]) > 20


@every_cause
def test_each_takes_its_size_from_the_tolerances(cause: Cause, subject: Subject) -> None:
    """And its default is what the file that ships states."""
    kind, stated = type(subject.machine), subject.machine.tolerances[cause.id]
    stds = cause.prior_std(subject.machine)
    assert stds.shape == (cause.unknowns,)
    assert cause.stated(subject.machine) == stated
    # The arms of this printer differ by 2.25 mm: they are doubted.
    doubted = 2.25 if (cause.id, kind.__name__) == ("leg_length", "LinearDelta") else 0.0
    share = np.ones(len(cause.names))
    if cause.id == "bed_shape":
        share[7:] = np.repeat([0.1, 0.01, 0.001], [5, 6, 7])
    assert stds[: len(cause.names)] == pytest.approx(
        np.hypot(stated, doubted) * cause.scale * share
    )
    if cause.id == "backlash":  # first positions are less uncertain than the widths
        assert stds[3:] == pytest.approx(0.3 * stds[:3])
    assert cause.scale == {"mrad": 1e-3, "1e-3": 1e-3}.get(cause.unit, 1.0)
    assert cause.sizes[kind] == stated
    file = (ROOT / "configs" / subject.file).read_text(encoding="utf-8")
    unit = f"{cause.unit}; " if cause.unit else ""
    # With the reason for that size.
    assert re.search(rf"^  {cause.id}: .*# {re.escape(unit)}\w.*$", file, re.MULTILINE)


def test_what_lies_in_the_measurement_is_never_compensable() -> None:
    for cause in CAUSES.values():
        assert cause.in_machine == (cause.stage in (Stage.GEOMETRY, Stage.MOTION))
        assert cause.in_machine or not cause.compensable
        # Only the machine, and the bars, bed and probe that belong to it, are the same in the
        # next session.
        belongs = cause.id in ("bar_skew", "bed_shape", "probe_tilt")
        assert cause.lasting == (cause.in_machine or belongs)
