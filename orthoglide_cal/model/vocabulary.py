"""What people call that which a calibration of a kind of machine determines, and its steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Vocabulary:
    """Words of one kind of machine; every page takes them from here."""

    one: str  # what is calibrated: "offset"
    many: str
    title: str  # its full name, as a heading: "Joint offsets"
    found: str  # what was found of it, as a column's head: "Δρ"
    relation: str  # how the found value belongs to the real one
    enter: str  # how the new values are entered; they follow, or the command that shows them
    restart: str  # what makes the controller use them
    entering: str  # both in a few words
    beyond: str  # why a value is impossible; "{limit}" stands for the largest plausible ones
    recheck: str  # what to look at where a value is impossible
    more: str  # which readings would determine more
    fewest: str | None  # which determine all of it; None where the missing ones can be named
    noise: str  # whose noise the readings have: "gauge"
    repeats: str  # what the scatter of repeated readings does not hold
    again: str  # what to do where nothing explains the readings
    positions: str  # at what readings are taken: "postures"
    instruments: str  # what reads, as a page names it: "gauges"
    repeat: str  # how to reduce noise
    finer: str  # what shows smaller steps
    compare: str  # what to do once the new values are used
    further: str  # what besides the usual readings would distinguish causes
    probing: str = ""  # how such a machine measures itself; empty where somebody reads gauges
    going_on: str = ""  # what to type to go on from readings; empty where one starts anew
    also: str = ""  # what belongs to that noise, too
    axes: Mapping[str, str] = field(default_factory=dict)  # parameters of its rails → in words


# Joint offsets that somebody measures with gauges and types in.
OFFSETS = Vocabulary(
    one="offset",
    many="offsets",
    title="Joint offsets",
    found="Δρ",
    relation="true position = indicated + Δρ",
    enter="Enter the new joint offsets in the controller, in mm: ",
    restart="Re-home all three axes.",
    entering="Enter the offsets, home all axes",
    beyond="no home switch is that far off (up to {limit} is plausible).",
    recheck="Check the unit of the readings, their legs and directions, and the leg length in"
    " the machine file. If a carriage really is that far off, move its home switch,"
    " or state homing_mm in the machine file.",
    more="Measure again with more postures.",
    fewest=None,
    noise="gauge",
    repeats="They share one gauge set-up, so they understate the real scatter.",
    again="Check the set-up, measure again, and compare the two sessions.",
    positions="postures",
    instruments="gauges",
    repeat="Take more cycles",
    finer="a gauge with finer divisions",
    compare="Compare",
    going_on="measure --then",
    further="two more postures of each leg between the isotropic one and its limits",
)

# Parameters of a firmware, which probes the bed by itself.
FIRMWARE = Vocabulary(
    one="parameter",
    many="parameters",
    title="Parameters",
    found="found",
    relation="real value = the controller's + found",
    enter="Enter the new parameters in the firmware:",
    restart="Restart the firmware, home the printer, and make a new bed mesh.",
    entering="Enter the parameters, restart the firmware, home, make a new mesh",
    beyond="no printer is that far off (up to {limit} is plausible).",
    recheck="Check the unit of the readings and the numbers of the machine: arm lengths,"
    " radius, endstops.",
    more="Probe more places, spread over the whole bed; if that does not do, the same places"
    " again on blocks of two known heights, or measure distances on a printed object.",
    fewest="Touch at least seven places spread over the whole bed: the middle and six near the"
    " edge, evenly around. More places, or heights, show how sure that is. A series at one place"
    " says how the probe scatters and drifts once it stands with them in one file.",
    noise="probe",
    repeats="They are touches of the same spots: the bed's local shape is not in them.",
    again="Clean bed and nozzle and probe again: more places, spread over the whole bed. Few places"
    " fit nearly anything, and cannot show what is wrong.",
    probing="Klipper: DELTA_CALIBRATE or BED_MESH_CALIBRATE, then SAVE_CONFIG, and bring"
    " printer.cfg. Others: probe with G30 at places all over the bed, bed mesh off, and write"
    " x, y and the height at which it triggers in a CSV: orthocal template touches. Then:"
    " orthocal diagnose FILE",
    also=" and the bed's local shape",
    positions="places",
    instruments="probe",
    repeat="Probe more places",
    finer="a probe with finer steps",
    compare="Probe again, and compare",
    further="more places, and on blocks of two known heights",
    axes={"a": "tower a", "b": "tower b", "c": "tower c"},
)
