"""Reasons, cautions, notes and remedies in words: the one table from a code to its sentence.

A sentence is a format string over the data of its reason, the `words` of the machine and those of
the `cause` that the reason names by its id. Where its grammar depends on the data it is a function.
"""

import math
import string
from collections.abc import Callable, Mapping
from typing import Any

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference import FoundPattern
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    chance,
    counted,
    listed,
    percent,
    plain,
    signed,
    two_figures,
    unit_words,
    with_uncertainty,
)

Data = Mapping[str, Any]
# After so many time constants what settles has come to rest: 2 % are left.
RESTING = 4.0


# A mesh older than the calibration in force: by lines of one file; by dates.
_STALE = (
    "The calibration (line {calibration}) was stored after this mesh was first saved (line {mesh})."
    " If BED_MESH_CALIBRATE was not run again since then, the mesh is older than the calibration in"
    " force: the result is wrong.",
    "The height map ({date}) is older than the calibration in force ({settings}, {calibrated}):"
    " probe the bed again (G29).",
)


_STILL = "Without touching the stands at leg {leg}, "

# In addition to Python's formats.
_FORMATS: Mapping[str, Callable[..., str]] = {
    "names": ", ".join,
    "listed": listed,
    "lengths": lambda values: ", ".join(f"{value:g}" for value in dict.fromkeys(values)),
    "series": lambda at: f" of leg {at['leg']}, direction {at['direction']}" if at else "",
    "and": " and ".join,
    "with": " with ".join,
    "causes": lambda ids: " and ".join(ids) or "this",
    "two": two_figures,
    "p": chance,
    "changes": lambda values: ", ".join(f"{name} {signed(by, 3)}" for name, by in values.items()),
    "sizes": lambda rows: ", ".join(
        f"{name} {signed(size, 3)} {unit_words(unit)}" for name, size, unit in rows
    ),
    "in_force": lambda names: f" (other {', '.join(names)} in force)" * bool(names),
    "tenths": lambda value: plain(value, 1),
    "µm": lambda length_mm: f"{1e3 * length_mm:.0f} µm",
    "freed": lambda arms: ", ".join(
        f"{arm.name} {with_uncertainty(arm.value, arm.expanded)}" for arm in arms
    ),
    "stale": lambda order: _STALE["date" in order].format(**order),
    "cycles": lambda count: {1: "one cycle", 5: "five cycles"}.get(count, f"{count} cycles"),
    "half_way": lambda other: ", with the gauges half-way" * other,
    "short": lambda by: f"{abs(by):g} mm {'short' if by > 0.0 else 'too far'}",
    "place": lambda where: f" ({where})" if where else "",
    "moves": lambda rows: ", ".join(
        f"{name} by {two_figures(size)} {unit_words(unit)}" for name, size, unit in rows
    ),
}


class _Formatter(string.Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        words = sentence if isinstance(value, Reason) else _FORMATS.get(format_spec)
        return words(value) if words else str(super().format_field(value, format_spec))


def sentence(reason: Reason, machine: Machine | None = None) -> str:
    """The sentence for a reason, in the words of a kind of machine; a file's remark needs none."""
    words, known = _SENTENCES[reason.code], dict(reason.data)
    of_file = f"{known.pop('of_file')}: " if "of_file" in known else ""
    if machine:
        known["words"] = machine.vocabulary
        if not isinstance(words, str):
            return words(machine, known)
        if "{cause." in words:
            known["cause"] = CAUSES[str(known["id"])].words(machine)
    return of_file + _Formatter().vformat(str(words), (), known)


def _residuals(size: str, end: str) -> str:
    scatter = "one reading scatters by {scatter_mm:.2g} mm, stated: {stated_mm:.2g} mm"
    return f"The residuals are {size} the {{words.noise}}'s noise{{words.also}}{end % scatter}"


def _implausible(machine: Machine, data: Data) -> str:
    names = ", ".join(f"{name} {value:+.1f} {unit}" for name, unit, value, _ in data["values"])
    limit = ", ".join(dict.fromkeys(f"{most:g} {unit}" for _, unit, _, most in data["values"]))
    vocabulary = machine.vocabulary
    return f"{vocabulary.one.capitalize()} {names}: {vocabulary.beyond.format(limit=limit)}"


def _undecided(machine: Machine, data: Data) -> str:
    rivals, sound = data["rivals"], data["sound"]
    names = [" with ".join(data["ids"]) or "a cause", *map(" with ".join, rivals[:1])]
    if len(rivals) > 1:
        names.append(counted(len(rivals) - 1, "other"))
    if data["unlisted"] or not rivals:
        names.append("something that is not on the list")
    either = " or ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    return (
        f"Something {'may be' if sound else 'is'} wrong besides the {machine.vocabulary.many}:"
        f" {either}. These data cannot distinguish them"
        f"{' from each other or from a sound machine' if sound else ''}."
    )


def _offsets_wrong(machine: Machine, data: Data) -> str:
    ids, titles = data["ids"], " and ".join(CAUSES[id].words(machine).title for id in data["ids"])
    return (
        f"{titles[0].upper()}{titles[1:]} ({' and '.join(ids)}, {percent(data['probability'], 1)}):"
        f" {machine.vocabulary.many} alone would be wrong by up to"
        f" {data['change']:.3f} {data['unit']}."
    )


def _other_data(_: Machine, data: Data) -> str:
    judged = {
        "named": f"shows {' and '.join(data['ids'])}, too",
        "ambiguous": "leaves open what is wrong",
        "unexplained": "shows something that no listed cause explains",
    }.get(data["verdict"], "must not be used")
    return f"The {data['data']} in the same file, judged alone, {judged}."


def _of_session(machine: Machine, data: Data) -> str:
    text = sentence(data["reason"], machine)
    return f"{data['when']}, {text[0].lower()}{text[1:]}"


# How readings deviate → what gauges do, {s} with one; the effect's short name; remedy.
_HOWS: Mapping[str, tuple[str, str, str]] = {
    "repeats": (
        "deviate{s} in the same way each time",
        "deviation",
        "Look for what returns each time at {where}: wear, a bent bar, a cable that pulls.",
    ),
    "drifts": (
        "drift{s} smoothly in time",
        "drift",
        "Let the machine and {where} come to rest: tighten clamps, close doors, warm up. Then"
        " measure there again.",
    ),
    "settles": (
        "creep{s} after set-up and come{s} to rest",
        "creep",
        "Let {where} rest for {rest:.0f} minutes before the first reading; measure there again.",
    ),
    "steps": (
        "step{s} at one moment",
        "step",
        "Find what was knocked at {moment:.1f} min, between {between} of {where}; measure there"
        " again.",
    ),
    "scatters": (
        "scatter{s} more than noise",
        "scatter",
        "Check clamp, tip and vibration of {where}; measure there again.",
    ),
    "hysteresis": (
        "lag{s} behind the plunger's movement",
        "lag",
        "Clean the plunger of {where}, or exchange the gauge; measure there again.",
    ),
    "temperature": (
        "follow{s} the recorded temperature",
        "temperature",
        "Warm up until the temperature of {where} is steady and record it with each reading;"
        " measure there again.",
    ),
}


def where_words(machine: Machine, pattern: FoundPattern) -> str:
    """The gauges, or readings, that deviate."""
    where = pattern.where
    if "region" in where:
        return f"the touches at the {where['region']} of the bed"
    if not machine.vocabulary.measure:
        return "the probe"
    if "posture" in where:
        return f"the readings at {where['posture']}"
    if not where:
        return "all gauges"
    place = f" of leg {where['leg']}" if "leg" in where else ""
    place += f" along {where['direction']}" if "direction" in where else ""
    return f"the gauge{'s' * (len(where) < 2)}{place}"


def pattern_words(machine: Machine, pattern: FoundPattern) -> str:
    """What deviates, how, and by how much."""
    subject = where_words(machine, pattern)
    single = len(pattern.where) == (2 if machine.vocabulary.measure else 0)
    verb = _HOWS[pattern.how][0].format(s="s" * single)
    numbers = [f"{with_uncertainty(pattern.size_mm, pattern.expanded_mm).lstrip('+')} mm"]
    largest = {
        size.unit: two_figures(abs(size.value))
        for size in sorted(pattern.parameters, key=lambda size: abs(size.value))
        if size.name == "time_constant" or size.unit == "mm/K"
    }
    numbers += [f"{value} {unit}" for unit, value in largest.items()]
    if pattern.how == "steps" and pattern.from_minutes is not None:
        numbers.append(f"at {plain(pattern.from_minutes, 1)} min")
    return f"{subject} {verb} ({', '.join(numbers)})"


def pattern_name(pattern: FoundPattern) -> str:
    """The effect in one noun."""
    return _HOWS[pattern.how][1]


def pattern_remedy(machine: Machine, pattern: FoundPattern) -> str:
    """What to do about it."""
    known = {size.name: size.value for size in pattern.parameters}
    rest = math.ceil(RESTING * known.get("time_constant", 0.0))
    text = _HOWS[pattern.how][2]
    between = "two readings"
    if len(pattern.between) > 1:
        first, last = pattern.between
        place = ", ".join(f"{name} {value}" for name, value in first.items() if name != "order")
        place = f" ({place})" * bool(place)
        between = f"readings {first['order']}{place} and {last['order']}"
    moment, where = pattern.from_minutes or 0.0, where_words(machine, pattern)
    return text.format(where=where, rest=rest, moment=moment, between=between)


def _retake(_: Machine, data: Data) -> str:
    kept = data["kept"]
    few = len(kept) <= 3  # to say why
    steps = ", ".join(f"r {step} ({why})" if few else f"r {step}" for step, why in kept)
    return f"Retake what was questioned and kept: {steps}:"


# Readings that a gauge can hardly have shown: why, and the remedy.
_BETTER = " If the gauge repeats better than stated, correct repeatability_mm in the machine file."
_REPEATS_MM = "though the gauge repeats within {repeatability_mm:g} mm."
_DECIMALS = "Check the unit, and resolution_mm in the machine file."
_DOUBTS: Mapping[str, tuple[str, str]] = {
    "stuck": (
        f"Repeated readings{{where:series}} never differ, {_REPEATS_MM}",
        f"Is the gauge stuck or its display held? Measure again.{_BETTER}",
    ),
    "steady": (
        f"Repeated readings{{where:series}} differ by {{scatter_mm:.1g}} mm only, {_REPEATS_MM}",
        f"Check the unit, and whether the gauge moves freely.{_BETTER}",
    ),
    "off_scale": (
        "{count} of {readings} readings have more decimals than a gauge with divisions of"
        " {step_mm:g} mm shows (first: line {line}, {value_mm:g} mm).",
        _DECIMALS,
    ),
    "fine_differences": (
        "The differences have more decimals than a gauge with divisions of {step_mm:g} mm gives,"
        " even as means of readings.",
        _DECIMALS,
    ),
    "too_far_apart": (
        "Readings{where:series} are {span_mm:.4g} mm apart (line {line}: {value_mm:g} mm), beyond"
        " the gauge's range of {range_mm:g} mm.",
        "Correct the reading or the unit, or range_mm in the machine file.",
    ),
    "other_unit": ("This gauge cannot show these readings in mm. Are they {mistake}?", "{remedy}"),
}


def _doubt(doubt: Reason, part: int) -> str:
    """Why readings are doubted (0), or what to do (1)."""
    return _Formatter().vformat(_DOUBTS[doubt.code][part], (), doubt.data)


# A height that counts from anywhere.
_ZERO_UNKNOWN = (
    "it cannot show the common height of the three endstops. Set the height of the nozzle again"
    " after entering them."
)
_NOZZLE = (
    "For the same Z the nozzle stands {{mm:.3f}} mm {} with the settings in force than with those"
    " of DELTA_CALIBRATE. If you changed the endstops afterwards, as for a first layer, entering"
    " the result undoes this and {} the nozzle by as much. Set its height again before you print."
)
_DIAL = "No dial indicator has a {}. Check the unit: lengths are in mm."
_SENTENCES: Mapping[str, str | Callable[[Machine, Data], str]] = {
    # Why there is no result, or why it fails its own check.
    "refused": "{what}",
    "settings_unknown": "{what}",
    "not_converged": "The search for the {words.many} did not converge.",
    "implausible": _implausible,
    "undetermined": "These readings do not determine {names:names}: they add nothing to what was"
    " known before.",
    "gauge_doubt": lambda _, data: _doubt(data["doubt"], 0),
    # What the diagnosis has against it.
    "undecided": _undecided,
    "few_readings": "With so few readings, nearly any cause fits.",
    "cause_found": "{ids:and} was found.",
    "unshown_fault": "These readings cannot show whether {cause.title}{where:place}. If so, the"
    " {words.many} change by up to {change:.3f} {unit}.",
    "offsets_wrong": _offsets_wrong,
    "unexplained": "No listed cause of usual size explains these data: {left_mm:.3f} mm r.m.s."
    " remains; the {words.noise}'s noise{words.also} would leave {expected_mm:.3f} mm.",
    "refuted_left_out": "{ids:with} fits, but does not predict readings left out: they differ by"
    " {error_mm:µm} r.m.s. instead of {stated_mm:µm}.",
    "refuted_later": "{ids:with} fits, but later readings refute it: they differ by {with_mm:µm}"
    " r.m.s. from what it predicts, without it by {without_mm:µm}.",
    "other_data_contradict": "The {data} in the same file contradicts these values beyond U:"
    " {apart:moves}.",
    # What to know although it may be entered.
    "corrected": "They are right only with {ids:and} corrected by the controller: without that they"
    " would be wrong by up to {change:.3f} {unit}.",
    "within_u": "With {ids:and} the {words.many} change by at most {change:.3f} {unit}, less than"
    " U.",
    "beyond_list": lambda machine, data: (
        "The reason is not known: "
        f"{'; '.join(pattern_words(machine, one) for one in data['patterns'])}."
    ),
    "local_shape": "The bed's local shape is about {factor:.1f} times its stated or usual size, and"
    " U covers only part of it. State it as texture_mm of the probe.",
    "remains": "Offsets do not remove {ids:causes}: {left_mm:two} mm r.m.s. will remain.",
    "other_data": _other_data,
    "nozzle_lower": "Entering this lowers the nozzle by {mm:.2f} mm: set its height again.",
    "overdue_gauge": "Gauge {id} is overdue: its calibration was due on {due}.",
    "temperature_changed": "The temperature changed by {kelvin:tenths} K while measuring.",
    # The residuals, judged.
    "no_spare_readings": "There are no spare readings: these data cannot show whether the model"
    " fits, and U rests on the {words.noise}'s stated noise ({stated_mm:.2g} mm).",
    "residuals_too_large": _residuals(
        "larger than", " (%s): the model is incomplete, and U does not cover this."
    ),
    "residuals_unusual": _residuals(
        "larger than usual for", ", not large enough to call the model wrong (%s; {p_value:p})."
    ),
    "residuals_agree": "The residuals agree with the {words.noise}'s noise{words.also}"
    " ({p_value:p}).",
    # What is missing, and two measurements compared.
    "not_recorded": "Not recorded: {missing:names}.",
    "of_session": _of_session,
    "other_gauges": "Other gauges were used: {before:names} before, {after:names} after.",
    "guard_band": "Pass if |deviation| + U is within the limit for every difference; fail if"
    " |deviation| − U is beyond it for any; otherwise undecided (guard band U on both sides, as in"
    " ISO 14253-1).",
    "order_as_given": "The order of the files is taken as given: no date or entry shows it.",
    "temperatures_differ": "The temperature differed: {before_c:tenths} °C before, {after_c:tenths}"
    " °C after.",
    # The history of a machine, and what to do about it.
    "left_out": lambda _, data: f"Left out: {counted(data['count'], 'simulated session')}.",
    "undated": "Not every file has a date: the order given counts.",
    "judged_by_last": "All are judged by the machine of the last session; others differ in"
    " {names:names}.",
    "temperatures_vary": "The temperature differs ({low_c:tenths} to {high_c:tenths} °C); what"
    " follows it is not a change of the machine.",
    "gauges_vary": "The gauges differ; the scale error of each set is accounted for.",
    "arms_vary": "The arm lengths in the firmware differ: parameters are compared at the last"
    " ones.",
    "adjusted": "Recorded adjustment between {before} and {after}: {sizes:sizes}.",
    "corrected_otherwise": "From {after} on, the controller corrects {ids:and} differently.",
    "shown_in_all": "{id} shows in all sessions: one size is found from all of them.",
    "shown_in": lambda _, data: f"{data['id']} shows in {listed(data['paths'])}.",
    "one_more_session": "Measure once more: one further session decides between them.",
    "home_repeatedly": "Home three times and measure once after each: that decides between them.",
    "changed": "Look for a collision, a loose carriage or an exchanged part.",
    "drifting": "Look for wear or warming up; calibrate again before the drift matters.",
    "scattering": "Check home switches and couplings: calibration cannot be better than homing.",
    "unchanged": "Nothing to do: measure again at the next service, or after a collision.",
    # Before a controller's file is written.
    "first_written": "Offsets are written here for the first time. The change is added to each"
    " value, which may hold more than the offset, such as the place of the switch.",
    "includes": "The file includes others. Where one of them holds the same value, that counts.",
    # About the data.
    "remark": "{text}",
    "below_resolution": "The residuals are smaller than the {words.noise}'s resolution allows"
    " ({floor_mm:.2g} mm); the intervals use the resolution.",
    # Notes of a diagnosis.
    "not_excluded": "Not excluded, too small to show: {ids:names}.",
    "two_would_follow": "{ids:with} would also fit, but two causes together fit nearly any"
    " pattern. To check them, repeat with {words.further}.",
    "acts_too": "In addition, {cause.title}{where:place}.",
    "perhaps_also": "These readings cannot show whether {ids:and} is also present.",
    "perhaps_alone": "{id} alone is also possible (probability {probability:.2g}): {others:and}"
    " may be absent.",
    "few_differences": "{count} differences leave {spare} degrees of freedom beyond the three"
    " offsets, and this answer has {unknowns} unknowns. It therefore depends on plausible sizes,"
    " not on the data alone. Raw readings with more postures would show more.",
    "measure_again": "Correct a fault of the measurement by measuring again, not in the"
    " controller.",
    "recalibrated": "The machine was recalibrated before the held-out readings{changed:in_force}."
    " Its parameters are fitted to them, with and without the causes. These are carried over"
    " unchanged.",
    "origin_moved": "Between the two measurements the origin of the endstops has moved:"
    " {moves:changes} mm. None of this was entered. The endstops are fitted to the held-out"
    " readings. All other parameters are carried over.",
    "maps_repeat": "The residual maps of these dates repeat (r = {correlation:.2f}): the"
    " residuals are a lasting shape, not noise.",
    "local_residual": "Unexplained: {left_mm:µm} r.m.s. Of this {noise_mm:µm} is the probe's noise."
    " {beyond_mm:µm} is local: neighbouring places share it. It is no evidence for any cause.",
    # Remedies.
    "do": "{what}",
    "validate": "Check the file:",
    "recheck": "{words.recheck}",
    "more_readings": "{words.more}",
    "again": "{words.again}",
    "beyond_remedy": lambda machine, data: pattern_remedy(machine, data["pattern"]),
    "accept": "{cause.advice} Or accept {id} as part of the machine:",
    "controller_corrects": "Or let LinuxCNC correct {id}:",
    "look": "Check whether {cause.title}{where:place}. How to check: {cause.instrument}. If"
    " nothing is wrong there, rule it out:",
    "retake": _retake,
    "probe_both": "Calibrate and probe a mesh one after the other, with nothing changed in between;"
    " then compare again.",
    "check_gauge": lambda _, data: _doubt(data["doubt"], 1),
    # What to measure next.
    "walk_down": "iso, {most}, {least} and iso",
    "walk_up": "iso, {least}, {most} and iso, each reached from the other side",
    "walk_half_way": "up to {most} and down to {least}, half-way ({half_mm:lengths} mm) both going"
    " and coming back",
    "read_again": _STILL + "read its last posture ({posture}) again.",
    "read_later": _STILL + "read its last posture ({posture}) again after a quarter of an hour.",
    "read_on": _STILL + "read {cycles:cycles}: {walk}.",
    "read_short": _STILL + "drive as before but with carriage {carriage} {short_mm:short}, as the"
    " screen shows: {walk}.",
    "session_alone": "Measure a separate session, {protocol}, {cycles:cycles} per leg; write down"
    " every reading. It needs no old data.",
    "stand_again": "Set the stands up again at leg {leg}{half_way:half_way}, labels and + sides"
    " checked, and read {cycles:cycles}: {walk}.",
    "turn_bar": "Turn the bar of leg {leg} half round its own axis, set the stands up again at leg"
    " {leg}{half_way:half_way} and read {cycles:cycles}.",
    "repeat": "Repeat the session, {cycles:cycles} per leg{half_way:half_way}: {walk};"
    " stands set up again, labels and + sides checked.",
    "turn_bars": "Turn every bar half round its own axis, and repeat the session, {cycles:cycles}"
    " per leg{half_way:half_way}.",
    "repeat_at": "Repeat the session, {cycles:cycles} per leg, with the gauges {gauge_mm:.0f} mm"
    " from the carriage joint.",
    "repeat_reversed": "Repeat the session, one cycle per leg, with the legs in the order z, y,"
    " x{half_way:half_way}.",
    "touch_raised": "Touch {places} places all over the bed again with a block of known height,"
    " {height_mm:g} mm, under the probe. (Or turn the plate by a third and probe again: what turns"
    " with it is its own shape.)",
    # Of a file, as it was read.
    **{code: " ".join(texts) for code, texts in _DOUBTS.items()},
    "gauge_repeatability_mm": _DIAL.format(
        "repeatability of {repeatability_mm:g} mm with divisions of {resolution_mm:g} mm"
    ),
    "gauge_resolution_mm": _DIAL.format("division of {resolution_mm:g} mm"),
    "gauge_range_mm": _DIAL.format(
        "range of {range_mm:g} mm with divisions of {resolution_mm:g} mm"
    ),
    "gauge_revolution_mm": _DIAL.format(
        "turn of {revolution_mm:g} mm within a range of {range_mm:g} mm"
    ),
    "implausible_temperature": "A workshop of {celsius:g} °C? Temperatures are in °C, from -40 to"
    " 60.",
    "unknown_names": "{kind} are not known and were not used: {names:listed}. {hints}",
    "no_identified": "The line `identified:` is missing. Was the file cut off? If not, add"
    " `identified: []`.",
    "other_machine": "The session was measured on {recorded!r}, which differs from the machine"
    " given, {given!r}, in: {keys:names}. The machine given was used.",
    "beyond_range": "{count} of {readings} readings are beyond the gauge's range of {range_mm:g} mm"
    " (first: line {line}, {value_mm:g} mm): check the unit, and the gauge in the machine file.",
    "untimed": "Times were not given, or are all the same; {minutes:g} minutes per reading were"
    " assumed.",
    "equal_minutes": "All minutes are the same: they were not used.",
    "repeated_line": "Line {line} repeats line {first} word for word. Such lines: {count}; all were"
    " used.",
    "missing_differences": "Of the {kind} differences these are missing: {names:names}.",
    "taken_as_twelve": "These names were taken as max and min relative to the isotropic posture; a"
    " single-posture file also has dz_x0 or dz_y0.",
    # Of a printer's file.
    "byte_order_mark": "The file begins with a byte order mark: Klipper does not read it. Save it"
    " as UTF-8 without it.",
    "stray_saved": "Because of line {line}, above its heading, Klipper drops what SAVE_CONFIG"
    " wrote. Delete the line.",
    "not_in_force": "Line {line}, {option} of [{section}], which SAVE_CONFIG wrote, is not in"
    " force: line {other} says otherwise, and Klipper obeys that one. Delete one of the two.",
    "unsaved_calibration": "SAVE_CONFIG does not follow the calibration of line {line}: the"
    " settings before it are in force and are used.",
    "settings_beside": "The settings are those of {names:and} in the same folder.",
    "other_settings": "{files:and}: other {settings:names} in force.",
    "arms_differ": "Arms: the machine file says {stated:lengths} mm, the firmware {used:lengths}"
    " mm. The result holds with the firmware's; U includes the difference, {apart_mm:.2g} mm. Enter"
    " the measured arms in both (arm_length), calibrate and probe again.",
    "arms_freed": "The distances also determine the arms, as in Klipper: {arms:freed} mm (U);"
    " export and apply write them, too.",
    "doubted_leg_length": "Arms of {lengths_mm[0]:.1f}, {lengths_mm[1]:.1f} and"
    " {lengths_mm[2]:.1f} mm are stored; printers of this kind have equal arms. Their difference,"
    " {spread_mm:.1f} mm, is taken as their tolerance. Measure them from joint centre to joint"
    " centre.",
    "probe_z_unknown": f"The probe's z offset is not known: {_ZERO_UNKNOWN}",
    "probe_offset_unknown": "The probe's offset from the nozzle is not known: x and y of it are"
    " taken as 0.",
    "offset_not_stated": "{options:and} of [{sensor}] taken as 0: the file does not state it. If an"
    " included file does, copy its [{sensor}] into this one.",
    "m851_unknown": "M851 is not known and is taken as 0: do not add it to H again.",
    "nozzle_raised": _NOZZLE.format("lower", "raises"),
    "nozzle_lowered": _NOZZLE.format("higher", "lowers"),
    "other_meshes": "Of {count} stored meshes, {mesh!r} was taken. To take another, name it"
    " [bed_mesh default] in a copy of the file.",
    "padded": "{count} points of the mesh {mesh!r} were not probed: they repeat a neighbour and are"
    " left out.",
    "mesh_zero": "By line {line}, {option}, the mesh counts from one of its own places:"
    f" {_ZERO_UNKNOWN}",
    "map_from_place": "If G30 was sent before G29, the map counts from that place:"
    f" {_ZERO_UNKNOWN}",
    "map_height_unknown": f"The map counts from a height that it does not state: {_ZERO_UNKNOWN}",
    "stale_mesh": "{order:stale}",
    "unused_data": "The {data} in the same file was not used. {what} {remedy}",
    "marlin_reach": "{name} does not print where it probed. Marlin's usual reach is assumed:"
    " {reach_mm:g} mm from the middle ({margin_mm:g} mm from the edge).",
    "converted": "The heights of {name} were probed before G33 changed the settings (line {line});"
    " they are converted to those in force after it.",
    "averaged_places": "G33 with P4 to P10 prints averages around seven places: take P3.",
}
