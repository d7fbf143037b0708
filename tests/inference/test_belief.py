"""What is tried, with which prior; and what an open choice does to the offsets."""

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference.candidates import Candidates, Ids
from orthoglide_cal.model.model import Model
from tests.machines import NOMINAL, PROTOTYPE, extended

OWN = {id: cause for id, cause in CAUSES.items() if type(PROTOTYPE) in cause.sizes}


def tried(model: Model, ordered: bool = True) -> set[Ids]:
    return set(Candidates.of(model, ordered).log_prior)


class TestCandidates:
    def test_two_machine_causes_never_stand_together(self) -> None:
        measured = {id for id, cause in OWN.items() if not cause.in_machine}
        pairs = [ids for ids in tried(NOMINAL) if len(ids) == 2]
        assert all(measured & set(ids) for ids in pairs)
        machine = set(OWN) - measured
        # Every cause of the machine with every one of the contact or the record.
        wanted = {tuple(sorted((a, b))) for a in machine for b in measured}
        assert wanted <= set(pairs)
        assert {(c,) for c in OWN} <= tried(NOMINAL)
        # What another kind of machine can have is not tried.
        assert {id for ids in tried(NOMINAL) for id in ids} == set(OWN) < set(CAUSES)

    def test_only_what_can_be_is_tried(self) -> None:
        timed = {id for id, cause in CAUSES.items() if cause.timed}
        assert timed >= {"backlash", "thermal_drift", "gauge_drift", "stand_shift"}
        assert not any(timed & set(ids) for ids in tried(NOMINAL, ordered=False))
        gauge = PROTOTYPE.gauge.changed(revolution_mm=None)
        assert ("gauge_slip",) not in tried(Model(PROTOTYPE.changed(gauge=gauge)))
        none = dict.fromkeys(OWN, 0.0)
        few = Model(PROTOTYPE.changed(tolerances={**none, "axis_gap": 0.3, "misread": 0.1}))
        assert tried(few) == {(), ("axis_gap",), ("misread",), ("axis_gap", "misread")}
        assert tried(Model(PROTOTYPE.changed(tolerances=none))) == {()}
        assert tried(Model(PROTOTYPE.changed(tolerances={}))) == tried(NOMINAL)

    def test_what_is_known_of_the_machine_is_not_tried_again(self) -> None:
        known_gap = extended(axis_gap=(0.1, 0.2, -0.1))
        assert not any("axis_gap" in ids for ids in tried(known_gap))
        assert any("bar_skew" in ids for ids in tried(known_gap))
