"""Files of a printer whose truth is known: touches as a CSV, and what Klipper saves."""

from dataclasses import replace

import numpy as np

from tests.truth.delta import (
    Delta,
    Floats,
    Layout,
    Truth,
    delta_csv,
    distances,
    indicated,
    probe_bed,
    touches,
)

STEP = 40.0 / (200 * 16)
GRID = 9  # points of the mesh along each side
# Off in every parameter, and differently.
OFF = Truth(
    endstops=np.array([0.31, -0.22, 0.17]), radius=0.24, angles=np.array([0.11, -0.07, 0.0])
)


def exact(machine: Delta, truth: Truth, layout: Layout) -> str:
    """A CSV of touches without noise."""
    session = probe_bed(machine, truth, (), layout, np.random.default_rng(1))
    return delta_csv(replace(session, readings=session.clean))


def printer_cfg(
    machine: Delta,
    truth: Truth,
    seed: int = 1,
    noise: float = 0.012,
    sections: str = "cm",
    surface: float = 0.0,
    many: bool = False,
) -> str:
    """What Klipper saves: parameters, seven heights and three distances ("c"), a round mesh ("m").

    With `many` there are nine distances.

    Without noise it is what the truth reads, to the digits of the file; what is touched lies at
    the height `surface` [mm].
    """
    rng = np.random.default_rng(seed)

    def steps(places: Floats) -> list[str]:
        joints = indicated(machine, places)
        counts = ((machine.home - joints) / STEP).round(0 if noise else 3)
        return [",".join(f"{v:.3f}" for v in row) for row in counts]

    turn = np.radians(30.0 + 60.0 * np.arange(6))
    ring = 0.9 * machine.bed * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    at = np.concatenate((np.zeros((1, 2)), ring))
    flat = np.full(len(at), surface)
    high = touches(machine, truth, *at.T, flat, 0.0 * flat) + noise * rng.normal(size=len(at))
    lines = ["", "[delta_calibrate]"]
    for k, position in enumerate(steps(np.column_stack((at, high)))):
        lines += [f"height{k} = {surface}", f"height{k}_pos = {position}"]
    pairs = [(0, 3), (1, 4), (2, 5), *((k, (k + 1) % 6) for k in range(6) if many)]
    ends = [np.column_stack((ring[i], ring[j])).T for i, j in pairs]
    first, second = (np.array([np.append(end[k], 0.2) for end in ends]) for k in range(2))
    apart = distances(machine, truth, first, second)
    apart += (0.05 if noise else 0.0) * rng.normal(size=len(pairs))
    for k, (one, other) in enumerate(zip(steps(first), steps(second), strict=True)):
        lines += [f"distance{k} = {apart[k]:.{4 if noise else 6}f}", f"distance{k}_pos1 = {one}"]
        lines += [f"distance{k}_pos2 = {other}"]
    side = np.linspace(10.0 - machine.bed, machine.bed - 10.0, GRID)
    places = np.stack([along.ravel() for along in np.meshgrid(side, side)], axis=1)
    inside = np.hypot(*places.T) <= machine.bed - 10.0
    still = np.full(inside.sum(), surface)
    # What lies outside was not probed; it repeats what lies next to it.
    height = np.zeros(len(places))
    height[inside] = touches(machine, truth, *places[inside].T, still, 0.0 * still) - surface
    height[inside] += noise * rng.normal(size=len(still))
    rows, reached = height.reshape(GRID, GRID), inside.reshape(GRID, GRID)
    for row, own in zip(rows, reached, strict=True):
        first, last = np.flatnonzero(own)[[0, -1]]
        row[:first], row[last + 1 :] = row[first], row[last]
    calibration, lines = lines, ["", "[bed_mesh default]", "version = 1", "points ="]
    lines += ["\t  " + ", ".join(f"{v:.6f}" for v in row) for row in rows]
    low, side = f"{-machine.bed + 10.0:.2f}", f"{machine.bed - 10.0:.2f}"
    for axis in "xy":
        lines += [f"{axis}_count = {GRID}", f"min_{axis} = {low}", f"max_{axis} = {side}"]
    parts = [f"[printer]\ndelta_radius = {machine.radius}"]
    for k, tower in enumerate("abc"):
        parts.append(
            f"\n[stepper_{tower}]\nangle = {machine.angles[k]}\narm_length = {machine.arms[k]}\n"
            f"position_endstop = {machine.endstops[k]}"
        )
    kept = [*calibration * ("c" in sections), *lines * ("m" in sections)]
    block = "\n".join(("\n".join(parts), *kept)).split("\n")
    head = ["[printer]", "kinematics: delta", f"print_radius: {machine.bed}"]
    for tower in "abc":
        head += [f"[stepper_{tower}]", "microsteps: 16", "rotation_distance: 40"]
    head += ["[probe]", f"z_offset: {surface}"] if surface else []
    head += ["[bed_mesh]", f"mesh_radius: {machine.bed - 10.0}"]
    mark = "#*# <---------------------- SAVE_CONFIG ---------------------->"
    note = "#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated."
    saved = (f"#*# {line}".strip() for line in ("", *block))
    return "\n".join((*head, "", mark, note, *saved)) + "\n"
