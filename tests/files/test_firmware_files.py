"""heightmap.csv, klippy.log, and what consoles of Klipper and Marlin print."""

import re
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.errors import UnusableResultError, UsageError
from orthoglide_cal.files.input import printer_settings, read_input, together
from orthoglide_cal.files.machine_file import default_machine
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.model.model import Model
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.documents.answer import decision_notice
from orthoglide_cal.results.making import answer_to
from tests import firmware_files as made
from tests.cli.program import run
from tests.printer_files import OFF, printer_cfg
from tests.printers import printer, true_values
from tests.sentences import sentences

from .helpers import MODEL, problems, saved

PRINTER = Model(printer(made.UNEVEN))
MAP, CONSOLE = made.height_map(made.UNEVEN, OFF), made.klipper_console(made.UNEVEN, OFF)
M503, G29 = made.m503(made.UNEVEN), made.g29(made.UNEVEN, OFF)
# Of each format, what a printer wrote; without noise.
TEXTS = {
    "heightmap.csv": MAP,
    "klipper.txt": CONSOLE,
    "new.txt": made.klipper_console(made.UNEVEN, OFF, new=True),
    "g29.txt": M503 + G29,
    "g33.txt": M503 + made.g33(made.UNEVEN, OFF),
    "klippy.log": made.klippy_log(made.UNEVEN, OFF),
}


def with_settings(folder: Path) -> None:
    """config.g, and a printer.cfg with the probe's offsets."""
    saved(folder, made.config_g(made.UNEVEN), "config.g")
    cfg = printer_cfg(made.UNEVEN, made.Truth(), sections="")
    x, y, z = made.OFFSET
    probe = f"[probe]\nx_offset: {x}\ny_offset: {y}\nz_offset: {z}\n"
    saved(folder, cfg.replace("[bed_mesh]", probe + "[bed_mesh]"), "printer.cfg")


def found(given) -> np.ndarray:
    """The six parameters by the readings [mm, deg]."""
    return np.array(given.model.machine.active) + solve(given.measured, given.model).offsets_mm


def remarks(*given) -> str:
    return " ".join(sentences(read_input(*given).measured.remarks))


@pytest.fixture
def own(tmp_path: Path) -> Path:
    with_settings(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", TEXTS)
def test_each_format_tells_what_the_machine_is(own: Path, name: str) -> None:
    """The files state settings and heights; what the truth is neither states."""
    given = read_input(saved(own, TEXTS[name], name))
    assert np.abs(found(given) - true_parameters()).max() < 3e-4


def true_parameters() -> np.ndarray:
    """Of UNEVEN with OFF."""
    return np.array(printer(made.UNEVEN).active) + true_values(made.UNEVEN, OFF)


def test_a_height_map_of_either_version_without_what_was_not_probed(own: Path) -> None:
    text = MAP
    given = read_input(saved(own, text, "two.csv"))
    two = given.measured
    assert given.conditions.started == "2024-03-05 17:21"
    three = read_input(
        saved(own, made.height_map(made.UNEVEN, OFF, version=3), "three.csv")
    ).measured
    np.testing.assert_array_equal(two.plan.place, three.plan.place)
    np.testing.assert_array_equal(two.value, three.value)
    assert len(two) == 69  # of 81 places, those in a circle of 90 mm
    np.testing.assert_allclose(two.plan.place[0, :2], [-40.0 + 12.0, -80.0 - 7.5])
    assert two.plan.order[:5].tolist() == [0, 1, 2, 3, 4]
    # The second line goes back, from its right end.
    assert two.plan.order[5:12].tolist() == [11, 10, 9, 8, 7, 6, 5]
    assert two.line[:6].tolist() == [4, 4, 4, 4, 4, 5]
    # A place that reads zero was probed: it has decimals.
    first = text.split("\n")[3].split(",")[2]
    zero = read_input(saved(own, text.replace(first, "  0.000", 1), "zero.csv")).measured
    assert (len(zero), zero.value[0]) == (69, 0.0)


def test_an_override_counts_where_it_is_loaded_and_tells_the_age_of_a_map(own: Path) -> None:
    path = saved(own, MAP, "heightmap.csv")
    head = "; config-override.g file generated in response to M500 at 2024-03-05 17:2{}\n"
    line = "M665 L310.000:310.500:311.000 R151.5 H379.000 B95.0 X0.100 Y0.200 Z0.000\n"
    saved(own, head.format(0) + line, "config-override.g")
    assert read_input(path).model.machine.delta_radius_mm == made.UNEVEN.radius
    named = 'M550 P"Rostock"; its name\n'
    saved(own, made.config_g(made.UNEVEN) + named + "M501 ; load it\n", "config.g")
    machine = read_input(path).model.machine
    assert machine.name == "Rostock"
    assert (machine.delta_radius_mm, machine.bed_radius_mm) == (151.5, 95.0)
    assert machine.arm_length_mm == (310.0, 310.5, 311.0)
    assert machine.tower_angles_deg == (210.1, 330.2, 90.0)
    assert machine.endstops_mm == pytest.approx(made.UNEVEN.endstops)  # M666 of config.g
    assert "is older" not in remarks(path)
    saved(own, head.format(2) + line, "config-override.g")
    assert "older than the calibration in force (config-override.g, 2024" in remarks(path)
    saved(own, "; nothing but\nif true\n  M501\n", "config.g")
    assert printer_settings(own / "config.g")
    assert not printer_settings(own / "heightmap.csv")  # they are beside it


def test_the_settings_may_be_named(tmp_path: Path) -> None:
    elsewhere = tmp_path / "printer"
    elsewhere.mkdir()
    with_settings(elsewhere)
    for name, settings in (("heightmap.csv", "config.g"), ("klipper.txt", "printer.cfg")):
        path = saved(tmp_path, TEXTS[name], name)
        given = read_input(path, printer_settings(elsewhere / settings))
        assert np.abs(found(given) - true_parameters()).max() < 3e-4
        [fault] = problems(read_input, path)
        assert "does not say which printer it is from." in fault.what
        assert f"--machine {settings}" in fault.remedy
    # A machine file does not tell where the probe is.
    given = read_input(path, PRINTER)
    assert "z offset is not known" in " ".join(sentences(given.measured.remarks))
    assert abs(np.median(given.measured.value)) < 1e-9


def test_what_was_probed_before_g33_changed_the_settings_counts_from_those_after(
    tmp_path: Path,
) -> None:
    before, after = made.UNEVEN, made.Delta(**{**vars(made.UNEVEN), "radius": 151.0})
    text = made.m503(before) + made.g29(before, OFF) + made.g33(after, OFF, results=False)
    given = read_input(saved(tmp_path, text, "c.txt"))
    assert given.model.machine.delta_radius_mm == 151.0
    line = text[: text.index("\n.Height")].count("\n") + 2
    told = " ".join(sentences(given.measured.remarks))
    assert f"before G33 changed the settings (line {line})" in told
    assert given.measured.source.excerpt.data == "mesh"
    # The carriages are where they were: the nozzle is believed elsewhere, by 150 -> 151 mm.
    arms = np.array(before.arms)
    foot = np.sqrt(arms**2 - 150.0**2) - np.sqrt(arms**2 - 151.0**2)
    true = true_parameters()
    assert np.abs(found(given) - true).max() < 3e-4
    assert foot.min() > 0.5


def test_a_log_has_the_calibration_that_was_saved_last_or_says_that_none_was(own: Path) -> None:
    log = made.klippy_log(made.UNEVEN, OFF, saved=True)
    last = read_input(saved(own, log, "klippy.log")).measured
    assert last.source.excerpt.words == "7 heights and 3 distances"
    assert last.line[0] == log[: log.index("height0")].count("\n") + 1
    assert "unsaved_calibration" not in [remark.code for remark in last.remarks]
    mesh = read_input(str(own / "klippy.log"), stored="mesh").measured
    assert mesh.source.excerpt.data == "mesh"
    log = made.klippy_log(made.UNEVEN, OFF)
    open_ = read_input(saved(own, log, "open.log")).measured
    np.testing.assert_allclose(open_.plan.place, last.plan.place, atol=1e-9)
    assert "unsaved_calibration" in [remark.code for remark in open_.remarks]
    assert open_.line[0] == log[: log.index("Calculating")].count("\n") + 2
    [fault] = problems(read_input, saved(own, log[log.index("Calculating") :], "cut.log"))
    assert "beginning is missing" in fault.what
    [fault] = problems(read_input, saved(own, log.replace("[(0.0, (", "[(0.0, "), "cut.log"))
    assert (fault.what, fault.line) == (
        "This is not a list of heights with stepper positions.", open_.line[0]
    )  # fmt: skip


def test_of_several_dates_each_says_what_is_older_or_was_not_used(own: Path) -> None:
    cfg = printer_cfg(made.UNEVEN, OFF)
    parts = [cfg.index(f"#*# [{name}]") for name in ("delta_calibrate", "bed_mesh default")]
    turned = cfg[: parts[0]] + cfg[parts[1] :] + cfg[parts[0] : parts[1]]
    far = printer_cfg(made.UNEVEN, OFF, seed=2).replace("#*# height0 = ", "#*# height0 = 9")
    paths = [saved(own, text, f"{name}.cfg") for name, text in (("one", turned), ("two", far))]
    both = together([read_input(path, None, default_machine, "mesh") for path in paths])
    stale, unused = (text for text in sentences(both.measured.remarks) if ".cfg: " in text)
    assert stale.startswith("one.cfg: The calibration")
    assert unused.startswith("two.cfg: The calibration in the same file was not used.")


def test_faults_of_settings_have_their_line_and_their_file(own: Path) -> None:
    path = saved(own, MAP, "heightmap.csv")
    saved(own, made.config_g(made.UNEVEN).replace("H379.0", "H{global.high}"), "config.g")
    [fault] = problems(read_input, path)
    assert (fault.file, fault.line, fault.column) == (str(own / "config.g"), 4, "H of M665")
    saved(own, made.config_g(made.UNEVEN).replace(" H379.0", ""), "config.g")
    [fault] = problems(read_input, path)
    assert "M665 with H is missing" in fault.what
    saved(own, made.config_g(made.UNEVEN).replace("R150.0", "R299.5"), "config.g")
    [fault] = problems(read_input, path)
    assert "not between 0 and the arms' length" in fault.what


def test_a_printers_file_is_no_machine_file_of_an_orthoglide(own: Path) -> None:
    with pytest.raises(UsageError, match="Leave --machine out"):
        read_input(saved(own, MAP, "heightmap.csv"), MODEL)


def test_without_its_override_nothing_is_known_to_be_active(own: Path) -> None:
    path = saved(own, MAP, "heightmap.csv")
    saved(own, made.config_g(made.UNEVEN) + "M501\n", "config.g")
    given = read_input(path)
    with pytest.raises(UnusableResultError, match=r"loads config-override.g \(M501\)"):
        solve(given.measured, given.model)
    answer = answer_to(given)
    assert (answer.parameters, answer.release.usable) == ((), False)
    assert answer.release.codes == ("settings_unknown",)
    title = decision_notice(Case(given, answer)).title
    assert title.startswith("The settings in force are not known: config.g loads")
    assert run("diagnose", path).exit_code == 4, "it has no diagnosis"
    # The numbers of a machine file that is named are.
    assert answer_to(read_input(path, PRINTER)).parameters


def test_a_height_map_beside_another_kind_of_printer_is_said_to_be_of_it(own: Path) -> None:
    path = saved(own, MAP, "heightmap.csv")
    text = re.sub("(?m)^m665.*$", "", made.config_g(made.UNEVEN))
    saved(own, text.replace("M669 K3", "M669 K1"), "config.g")
    [fault] = problems(read_input, path)
    assert fault.what.startswith("This printer is not a delta: config.g")
    assert "(M669 K1)" in fault.what


def listed(firmware: str) -> str:
    """The heights of one disc as other consoles print them; Repetier's from a height of its own."""
    x, y = made.disc(19)
    high = made.heights(made.UNEVEN, OFF, x, y)
    if firmware == "repetier":
        rows = zip(np.append(x, 99.0), np.append(y, 99.0), np.append(high, 7.0) + 0.5, strict=True)
        return "\n".join(f"12:00:01 : G33 X{a:.2f} Y{b:.2f} Z{z:.4f}" for a, b, z in rows)
    values = " ".join(f"{z:.4f}" for z in high)
    places = "\n".join(
        f"G30 P{k} X{a:.2f} Y{b:.2f} Z-99999" for k, (a, b) in enumerate(zip(x, y, strict=True))
    )
    return f"{places}\nG32 bed probe heights: {values}, mean 0.1, deviation from mean 0.2\n"


@pytest.mark.parametrize("firmware", ["repetier", "reprapfirmware"])
def test_lines_of_other_consoles_are_read_where_the_machine_is_known(
    own: Path, tmp_path: Path, firmware: str
) -> None:
    path = saved(own, listed(firmware), "console.txt")
    given = read_input(path, settings := printer_settings(own / "config.g"))
    [fault] = problems(read_input, path, settings, None, "calibration")
    assert "Leave out --data, or run G" in fault.remedy
    assert len(given.measured) == 19
    off = found(given) - true_parameters()
    off[:3] += 0.5 * (firmware == "repetier")
    assert np.abs(off).max() < 2e-3
    if firmware == "repetier":
        path = saved(own, "G33 X99 Y99 Z7.5\n", "corner.txt")
        [fault] = problems(read_input, path, settings)
        assert fault.what == "No place of the map is on the bed."
    (own / "config.g").unlink()
    [fault] = problems(read_input, path)
    assert {"repetier": "a map of Repetier", "reprapfirmware": "RepRapFirmware's console"}[
        firmware
    ] in fault.what


def test_heights_without_places_and_marlins_output_are_named(own: Path) -> None:
    heights = listed("reprapfirmware").split("\n")[-2]
    [fault] = problems(read_input, saved(own, heights, "console.txt"))
    assert "prints 19 heights without their places" in fault.what
    assert "bed.g" in fault.remedy
    settings = "CFG:  M666 A0 B0 C0 I0 J0 K0 U0 V0 W0 R150.00 D300.00 H379.00\n"
    [fault] = problems(read_input, saved(own, settings + G29, "mk.txt"))
    assert "what Marlin or MarlinKimbra prints" in fault.what
    probed = "12:00:01.123 : Z-probe:0.120 X:0.00 Y:50.00\n"
    [fault] = problems(read_input, saved(own, probed, "probed.txt"))
    assert (fault.what.split(",")[0], fault.remedy) == (
        "This is what Repetier prints while it probes",
        "Give its map: what G33 L0 prints.",
    )


def test_b_of_m665_is_the_probe_radius_of_marlin_1_1(tmp_path: Path) -> None:
    text = re.sub(r" A\S+ B\S+ C\S+", "", made.m503(made.EQUAL)).replace(
        " S160.00", " S160.00 B80.0"
    )
    g33 = re.sub(r"at radius:\S+ ", "", made.g33(made.EQUAL, OFF, radius=80.0))
    given = read_input(saved(tmp_path, text + g33, "c.txt"))
    assert np.hypot(*given.measured.plan.place[1:, :2].T) == pytest.approx(80.0)
