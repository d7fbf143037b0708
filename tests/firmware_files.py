"""Files of other firmwares, and what consoles print, of a printer whose truth is known.

Written after the firmwares' documents, not after the program that reads them.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.printer_files import OFF, printer_cfg
from tests.truth.delta import Delta, Floats, Truth, touches

UNEVEN = Delta(
    "uneven", (300.0, 301.5, 299.25), 150.0, (209.0, 331.5, 90.0), (380.0, 381.0, 379.5), 100.0
)
EQUAL = replace(UNEVEN, name="equal", arms=(300.0, 300.0, 300.0))
# Of the probe: where it is, and the nozzle's height when it triggers [mm].
OFFSET = (-12.0, 7.5, 2.35)
USUAL = (210.0, 330.0, 90.0)


def towers(values: Floats | list[float], names: str = "XYZ") -> str:
    return " ".join(f"{name}{value:.5f}" for name, value in zip(names, values, strict=True))


def filled(name: str, **values: object) -> str:
    """A file of the folder beside this one, with these values."""
    text = Path(__file__).with_name("firmware").joinpath(name).read_text(encoding="utf-8")
    return text.format(**values, offset=OFFSET)


def config_g(machine: Delta) -> str:
    height = 379.0
    return filled(
        "config.g",
        machine=machine,
        height=height,
        arms=":".join(f"{arm:.3f}" for arm in machine.arms),
        turned=towers(np.subtract(machine.angles, USUAL)),
        ends=towers(np.subtract(machine.endstops, height)),
    )


def heights(machine: Delta, truth: Truth, x: Floats, y: Floats, noise: float = 0.0) -> Floats:
    """How much higher than its offset the nozzle stood when the probe triggered over (x, y)."""
    above = np.full(len(x), OFFSET[2])
    high = touches(machine, truth, x - OFFSET[0], y - OFFSET[1], above, 0.0 * above) - above
    return high + noise * np.random.default_rng(1).normal(size=len(x))


def height_map(machine: Delta, truth: Truth, version: int = 2, noise: float = 0.0) -> str:
    """A round map of nine by nine places, 20 mm apart."""
    side = np.arange(-80.0, 81.0, 20.0)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    reached = np.hypot(x, y) <= 90.0
    cells = np.full(len(x), "      0", dtype=object)
    found = heights(machine, truth, x[reached], y[reached], noise)
    cells[reached] = [f"{high:7.4f}" for high in found]
    rows = [",".join(row) for row in cells.reshape(9, 9)]
    title = "RepRapFirmware height map file v2 generated at 2024-03-05 17:21, min error -0.123"
    head = ["xmin,xmax,ymin,ymax,radius,xspacing,yspacing,xnum,ynum"]
    head += ["-80.00,80.00,-80.00,80.00,90.00,20.00,20.00,9,9"]
    if version == 3:
        head = ["axis0,axis1,min0,max0,min1,max1,radius,spacing0,spacing1,num0,num1"]
        head += ["X,Y,-80.00,80.00,-80.00,80.00,90.00,20.00,20.00,9,9"]
    return "\n".join((title, *head, *rows)) + "\n"


def disc(count: int = 37) -> tuple[Floats, Floats]:
    turn, away = np.arange(count) * 2.4, 80.0 * np.sqrt((np.arange(count) + 0.5) / count)
    return (away * np.cos(turn)).round(2), (away * np.sin(turn)).round(2)


def klipper_console(machine: Delta, truth: Truth, new: bool = False, noise: float = 0.0) -> str:
    """Each place twice, as with `samples: 2`."""
    x, y = (np.repeat(axis, 2) for axis in disc())
    high = heights(machine, truth, x, y, noise)
    if new:
        lines = [
            f"Recv: // probe: at {a:.3f},{b:.3f} bed will contact at z={z:.6f}"
            for a, b, z in zip(x, y, high, strict=True)
        ]
    else:
        lines = [
            f"17:21:05  // probe at {a:.3f},{b:.3f} is z={z + OFFSET[2]:.6f}"
            for a, b, z in zip(x - OFFSET[0], y - OFFSET[1], high, strict=True)
        ]
    return "\n".join(("Send: BED_MESH_CALIBRATE", *lines, "Mesh Bed Leveling Complete")) + "\n"


def m503(machine: Delta) -> str:
    return filled(
        "m503.txt",
        machine=machine,
        height=min(machine.endstops) - OFFSET[2],
        arms=towers(np.subtract(machine.arms, 300.0), "ABC"),
        turned=towers(np.subtract(machine.angles, USUAL)),
        ends=towers(min(machine.endstops) - np.array(machine.endstops)),
    )


def g29(machine: Delta, truth: Truth, noise: float = 0.0) -> str:
    """Verbose: a line for each touch."""
    x, y = disc()
    high = heights(machine, truth, x, y, noise)
    lines = [f"Recv: Bed X: {a} Y: {b} Z: {z:.4f}" for a, b, z in zip(x, y, high, strict=True)]
    return "\n".join(("Send: G29 V4", *lines, "Recv: ok", ""))


def g33(machine: Delta, truth: Truth, radius: float = 90.0, results: bool = True) -> str:
    """A dry run; the nozzle stands at the places."""
    turn = np.radians([210.0, 330.0, 90.0, 30.0, 150.0, 270.0])
    x, y = (radius * np.append(0.0, function(turn)) for function in (np.cos, np.sin))
    above = np.full(7, OFFSET[2])
    low = min(machine.endstops)
    text = filled(
        "g33.txt",
        machine=machine,
        radius=radius,
        height=low - OFFSET[2],
        turned=np.subtract(machine.angles, USUAL),
        ends=low - np.array(machine.endstops),
        z=touches(machine, truth, x, y, above, 0.0 * above) - above,
    )
    return text if results else re.sub(r"^\. +(c|yz):.*\n", "", text, flags=re.MULTILINE)


def klippy_log(machine: Delta, truth: Truth, saved: bool = False, noise: float = 0.0) -> str:
    """The configuration, then a calibration with three distances, then perhaps SAVE_CONFIG."""
    cfg = printer_cfg(machine, truth, noise=noise, sections="cm", surface=0.0)
    plain = re.sub(r"^#\*# ?", "", cfg, flags=re.MULTILINE)
    plain = re.sub(r"^(<-.*|DO NOT.*)$\n", "", plain, flags=re.MULTILINE)
    stored = plain.index("[delta_calibrate]")
    mesh = plain.index("[bed_mesh default]")
    without = plain[:stored] + plain[mesh:]

    def calculated(name: str, *ends: str) -> str:
        entries = []
        for k in range(7):
            parts = [re.search(rf"^{name}{k}{end} = (.*)$", plain, re.M) for end in ("", *ends)]
            if parts[0]:
                texts = [part[1].replace(",", ", ") for part in parts if part]
                entries.append(f"({texts[0]}, " + ", ".join(f"({t})" for t in texts[1:]) + ")")
        return f"[{', '.join(entries)}]"

    heights = calculated("height", "_pos")
    distances = calculated("distance", "_pos1", "_pos2")
    calibrated = filled("calibrated.log", heights=heights, distances=distances)
    before, after = (filled("klippy.log", configuration=text) for text in (without, plain))
    return before + calibrated + (after if saved else "")


FILES = {
    "heightmap.csv": height_map(EQUAL, OFF, noise=0.01),
    "console.txt": klipper_console(EQUAL, OFF, noise=0.01),
    "g29.txt": m503(EQUAL) + g29(EQUAL, OFF, noise=0.01) + g33(EQUAL, OFF),
    "klippy.log": klippy_log(EQUAL, OFF, noise=0.01),
    "config.g": config_g(EQUAL),
}
# Settings of Klipper in the folder of its console's lines.
CONFIGURATION = printer_cfg(EQUAL, Truth(), sections="")
