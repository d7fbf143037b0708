"""An independent linear delta: three upright rails that lean, three arms, a bed and a probe.

Positions come from Newton's method on the sphere equations, a touch from the equation "the tip of
the probe is on the surface": nothing is linearised, and nothing is taken from the package.

Frame: x, y as the controller has them, z up from the bed. Tower i stands at angle a_i and radius
r_i; its carriage at height h is at foot + h * u, u the unit vector of the (leaning) rail. Lengths
are in mm, angles in degrees (towers) or mrad (leans), times in minutes.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from .effects import USUAL, sizes
from .forward import tool_from_carriages
from .machines import machine_file
from .plan import Floats, Ints, frozen

FILE, TOLERANCES = machine_file("linear_delta")
"""One standard deviation of each cause: mrad, mm, 1e-3, mm at the bed's edge, mm/h."""

CALIBRATED = {"endstops": 0.5, "radius": 0.5, "angles": 0.1}
"""How far a machine is off before its calibration, one standard deviation: mm, mm, deg."""

PULLEY = 40.0
"""Way of a carriage in one turn of its pulley [mm]."""


@dataclass(frozen=True)
class Delta:
    """What the controller believes, and the probe."""

    name: str = "v400"
    arms: tuple[float, float, float] = (344.1, 344.1, 344.1)
    radius: float = 161.8
    angles: tuple[float, float, float] = (210.0, 330.0, 90.0)
    endstops: tuple[float, float, float] = (420.0, 420.0, 420.0)
    bed: float = 150.0  # radius of the bed
    noise: float = 0.013  # standard deviation of one touch
    resolution: float = 0.0  # to which a touch is rounded; 0 for not at all
    calliper: float = 0.03  # standard deviation of a measured distance
    texture: float = 0.02  # standard deviation of the local shape of its bed, as its file states it

    @property
    def home(self) -> Floats:
        """Joint positions at the endstops, shape (3,)."""
        return np.array(self.endstops) + np.sqrt(np.array(self.arms) ** 2 - self.radius**2)


V400 = Delta()
KOSSEL = Delta("kossel", (265.0, 265.0, 265.0), 130.0, endstops=(290.0, 290.0, 290.0), bed=115.0)


@dataclass(frozen=True, eq=False)
class Surface:
    """A bed: z = sum of c_jk (x / R)^j (y / R)^k, and waves that make its local shape."""

    radius: float
    terms: Mapping[tuple[int, int], float] = field(default_factory=dict)
    """(power of x, power of y) -> height at the edge."""
    waves: Floats = field(default_factory=lambda: frozen(np.zeros((0, 4))))
    """Rows of (amplitude, wave number along x, along y, phase)."""

    def height(self, x: Floats, y: Floats) -> Floats:
        """z at places, of their shape."""
        u, v = x / self.radius, y / self.radius
        z = sum((c * u**j * v**k for (j, k), c in self.terms.items()), np.zeros(np.shape(x)))
        amplitude, along, across, phase = self.waves.T
        return z + np.cos(x[..., None] * along + y[..., None] * across + phase) @ amplitude


def grain(rng: np.random.Generator, sd: float, length: float) -> Floats:
    """Waves whose sum has a standard deviation and the correlation exp(-d / length)."""
    # The spectrum of that correlation in the plane is a Cauchy distribution of wave numbers.
    numbers = rng.normal(size=(2, 600)) / np.abs(rng.normal(size=600)) / length
    phases = rng.uniform(0.0, 2.0 * np.pi, 600)
    return frozen(np.stack((np.full(600, sd * np.sqrt(2.0 / 600)), *numbers, phases), axis=1))


@dataclass(frozen=True, eq=False)
class Truth:
    """How a machine differs from what its controller believes; all zero for a perfect one."""

    endstops: Floats = field(default_factory=lambda: frozen(np.zeros(3)))
    """True height of a carriage less the indicated one, shape (3,)."""
    radius: float = 0.0
    angles: Floats = field(default_factory=lambda: frozen(np.zeros(3)))
    """Excess of the tower angles, shape (3,), [deg]; the third is 0 by convention."""
    radii: Floats = field(default_factory=lambda: frozen(np.zeros(3)))
    """Excess of each tower's radius over the common one, shape (3,)."""
    leans: Floats = field(default_factory=lambda: frozen(np.zeros((3, 2))))
    """Lean of each rail away from the centre, and in the sense of growing angles, [mrad]."""
    arms: Floats = field(default_factory=lambda: frozen(np.zeros(3)))
    scales: Floats = field(default_factory=lambda: frozen(np.zeros(3)))
    """Way of a carriage from its endstop, excess [1e-3]."""
    lost: Floats = field(default_factory=lambda: frozen(np.zeros(3)))
    """Lost motion: after a way upwards a carriage stands half of it too low, else too high."""
    rates: Floats = field(default_factory=lambda: frozen(np.zeros(3)))
    """What the endstops' heights gain with time [mm/h]."""
    bed: Surface | None = None  # flat and level if None
    tilt: Surface | None = None  # height of the probe's tip over its nominal one, by place
    drift: float = 0.0  # what the tip's height loses, so that a reading gains, with time [mm/h]
    pulleys: Floats = field(default_factory=lambda: frozen(np.zeros((3, 2))))
    """How far out of true each turns: what its carriage gains [mm], and the phase."""


def feet(machine: Delta, truth: Truth) -> Floats:
    """Where the rails meet the plane z = 0, shape (3 towers, 3)."""
    angle = np.radians(np.array(machine.angles) + truth.angles)
    radius = machine.radius + truth.radius + truth.radii
    return np.stack((radius * np.cos(angle), radius * np.sin(angle), np.zeros(3)), axis=1)


def rails(machine: Delta, truth: Truth) -> Floats:
    """Unit vectors along the rails, shape (3 towers, 3)."""
    angle = np.radians(np.array(machine.angles) + truth.angles)
    out = np.stack((np.cos(angle), np.sin(angle), np.zeros(3)), axis=1)
    along = np.stack((-np.sin(angle), np.cos(angle), np.zeros(3)), axis=1)
    lean = 1e-3 * truth.leans
    up = np.array([0.0, 0.0, 1.0]) + lean[:, :1] * out + lean[:, 1:] * along
    return up / np.linalg.norm(up, axis=1, keepdims=True)


def indicated(machine: Delta, places: Floats) -> Floats:
    """Joint positions to which the controller drives for tool places, shape (n, 3) -> (n, 3)."""
    tower = feet(machine, Truth())
    apart = places[:, None, :2] - tower[None, :, :2]
    below = np.array(machine.arms) ** 2 - (apart**2).sum(axis=2)
    return places[:, 2:] + np.sqrt(below)


def tool(
    machine: Delta,
    truth: Truth,
    joints: Floats,
    hours: Floats | float = 0.0,
    ways: Floats | float = 0.0,
) -> Floats:
    """Where the tool truly is, shape (n, 3).

    Args:
        joints: indicated positions, shape (n, 3).
        hours: since the endstops were found, shape (n,).
        ways: 1 for a carriage that came up, -1 for one that came down, shape (n, 3).
    """
    home = machine.home
    growth = np.broadcast_to(hours, joints.shape[:1])[:, None] * truth.rates
    height = home - (home - joints) * (1.0 + 1e-3 * truth.scales) + truth.endstops + growth
    height = height - 0.5 * truth.lost * ways
    turns = joints / PULLEY
    height = height + truth.pulleys[:, 0] * np.sin(2.0 * np.pi * turns + truth.pulleys[:, 1])
    carriages = feet(machine, truth)[None] + height[:, :, None] * rails(machine, truth)[None]
    arms = (np.array(machine.arms) + truth.arms)[:, None]
    centre = carriages[:, :, :2].mean(axis=1)
    below = carriages[:, :, 2].mean(axis=1) - np.mean(machine.arms) * 0.9
    start = np.concatenate((centre, below[:, None]), axis=1)
    found = tool_from_carriages(carriages.transpose(1, 2, 0), arms, start.T, steps=12).T
    return np.ascontiguousarray(found)


def ways_between(machine: Delta, x: Floats, y: Floats) -> Floats:
    """Which way each carriage came from the last place: 1 up, -1 down, shape (n, 3).

    The way is level; to the first place, all come down from their endstops.
    """
    joints = indicated(machine, np.stack((x, y, np.zeros(len(x))), axis=1))
    return np.concatenate((-np.ones((1, 3)), np.sign(np.diff(joints, axis=0))))


def touches(
    machine: Delta, truth: Truth, x: Floats, y: Floats, block: Floats, hours: Floats
) -> Floats:
    """Commanded height at which the probe triggers, shape (n,).

    Args:
        x, y: commanded places, shape (n,).
        block: height of what lies on the bed under the probe, shape (n,).
        hours: since the endstops were found, shape (n,).

    Lost motion stays as the way from the last place left it: the descent does not take it up.
    The gap between tip and surface changes as much as the commanded height, within a few per cent:
    each step takes the gap off, and what remains is a few per cent of it.
    """

    ways = ways_between(machine, x, y)

    def gap(z: Floats) -> Floats:
        at = tool(machine, truth, indicated(machine, np.stack((x, y, z), axis=1)), hours, ways)
        bed = truth.bed.height(at[:, 0], at[:, 1]) if truth.bed else 0.0
        tip = truth.tilt.height(at[:, 0], at[:, 1]) if truth.tilt else 0.0
        return at[:, 2] + tip - truth.drift * hours - bed - block

    z = np.array(block, dtype=float)
    for _ in range(12):
        over = gap(z)
        z = z - over
        if np.abs(over).max() < 1e-12:
            break
    return z


def distances(machine: Delta, truth: Truth, first: Floats, second: Floats) -> Floats:
    """True distances between the places where a print was laid down, shape (n,).

    Args:
        first, second: commanded places, shape (n, 3).
    """
    ends = [tool(machine, truth, indicated(machine, places)) for places in (first, second)]
    return np.linalg.norm(ends[0] - ends[1], axis=1)


@dataclass(frozen=True)
class Layout:
    """Where and in which order the bed is touched."""

    places: int = 121
    heights: tuple[float, ...] = (0.0,)
    """Of blocks under the probe; all places at one height, then at the next."""
    cycles: int = 1
    reach: float = 0.95  # outermost place, of the bed's radius
    pace: float = 0.1  # minutes per touch


def places_of(layout: Layout, bed: float) -> Floats:
    """Places, shape (n, 2): the centre and six around it, or evenly over the disc, row by row."""
    radius = layout.reach * bed
    if layout.places == 7:
        turn = np.radians(30.0 + 60.0 * np.arange(6))
        ring = radius * np.stack((np.cos(turn), np.sin(turn)), axis=1)
        return np.concatenate((np.zeros((1, 2)), ring))
    number = np.arange(layout.places)
    away = radius * np.sqrt((number + 0.5) / layout.places)
    turn = number * np.pi * (3.0 - np.sqrt(5.0))
    at = np.round(np.stack((away * np.cos(turn), away * np.sin(turn)), axis=1), 2)
    rows = max(round(np.sqrt(layout.places)), 1)
    row = np.clip(((at[:, 1] + radius) / (2.0 * radius) * rows).astype(int), 0, rows - 1)
    forth = np.where(row % 2 == 0, at[:, 0], -at[:, 0])
    return at[np.lexsort((forth, row))]


@dataclass(frozen=True, eq=False)
class DeltaSession:
    """Touches of a bed, and the truth behind them; N touches in the order of time."""

    machine: Delta
    truth: Truth
    causes: tuple[str, ...]  # hidden cause ids
    layout: Layout
    x: Floats
    y: Floats
    block: Floats
    minutes: Floats
    cycle: Ints
    contact: Floats
    """What was added to the touches: a wrong one, or an effect outside the list; shape (N,)."""
    clean: Floats  # trigger heights without noise and rounding, shape (N,)
    readings: Floats  # shape (N,)
    outside: str | None = None  # an effect outside the list

    @property
    def label(self) -> str:
        """`healthy`, an id, `id+id`, or what is outside the list."""
        return self.outside or "+".join(self.causes) or "healthy"


Disturb = Callable[[Truth, Floats, np.random.Generator], tuple[Truth, Floats]]
"""Truth and minutes (N,) -> the truth with an effect outside the list, and what it adds (N,)."""


Change = Callable[[Truth, Floats], Truth]
BENT = ((0, 2), (0, 3), (1, 1), (1, 2), (2, 0), (2, 1), (3, 0))
TILTED = ((2, 0), (1, 1), (0, 2))
SLOPED = ((1, 0), (0, 1), *TILTED)


def _surface(radius: float, powers: tuple[tuple[int, int], ...], sizes: Floats) -> Surface:
    return Surface(radius, dict(zip(powers, sizes.tolist(), strict=True)))


def changes(radius: float) -> dict[str, tuple[int, Change]]:
    """Of each cause of the machine or the contact: number of parameters, and what they change.

    The calibration takes the slope of a tilt, which is not counted here.
    """
    return {
        "tower_lean": (6, lambda t, v: replace(t, leans=frozen(v.reshape(3, 2)))),
        "tower_radius": (3, lambda t, v: replace(t, radii=frozen(v))),
        "leg_length": (3, lambda t, v: replace(t, arms=frozen(v))),
        "encoder_scale": (3, lambda t, v: replace(t, scales=frozen(v))),
        "backlash": (3, lambda t, v: replace(t, lost=frozen(v))),
        "thermal_drift": (3, lambda t, v: replace(t, rates=frozen(v))),
        "bed_shape": (7, lambda t, v: replace(t, bed=_surface(radius, BENT, v))),
        "probe_tilt": (3, lambda t, v: replace(t, tilt=_surface(radius, TILTED, v))),
        "probe_drift": (1, lambda t, v: replace(t, drift=float(v[0]))),
    }


def draw_truth(hidden: tuple[str, ...], bed: float, rng: np.random.Generator) -> Truth:
    """A machine before its calibration, with so many tolerances of each hidden cause."""

    def sized(cause: str, count: int) -> Floats:
        return sizes(rng, count, TOLERANCES[cause], USUAL)

    angles = np.append(rng.normal(scale=CALIBRATED["angles"], size=2), 0.0)
    truth = Truth(
        endstops=frozen(rng.normal(scale=CALIBRATED["endstops"], size=3)),
        radius=float(rng.normal(scale=CALIBRATED["radius"])),
        angles=frozen(angles),
    )
    families = changes(bed)
    for cause in hidden:
        if cause == "misread":
            continue
        count, change = families[cause]
        if cause == "tower_radius":
            first, second = sized(cause, 2)
            truth = change(truth, np.array([first, second, -first - second]))
        elif cause == "probe_tilt":
            truth = replace(truth, tilt=_surface(bed, SLOPED, sized(cause, 5)))
        elif cause == "backlash":
            truth = change(truth, np.abs(sized(cause, count)))
        elif cause == "bed_shape":
            truth = change(truth, sized(cause, count) * np.sqrt(count / 3.0))
        else:
            truth = change(truth, sized(cause, count))
    return truth


def make_delta_session(
    seed: int,
    machine: Delta = V400,
    hidden: tuple[str, ...] = (),
    layout: Layout | None = None,
    bumps: tuple[float, float] = (0.0, 30.0),
    outside: tuple[str, Disturb] | None = None,
) -> DeltaSession:
    """Draw one session. The same arguments give the same session.

    Args:
        seed: any integer >= 0.
        hidden: cause ids; empty for a sound machine, which is not calibrated yet, either.
        layout: 121 places on the flat bed if None.
        bumps: standard deviation [mm] and correlation length [mm] of the bed's local shape.
        outside: an effect outside the list.
    """
    layout = layout or Layout()
    words = "|".join((machine.name, *hidden, *(outside or ())[:1], str(layout)))
    rng = np.random.default_rng([seed, zlib.crc32(words.encode())])
    truth = draw_truth(hidden, machine.bed, rng)
    if bumps[0]:
        terms = truth.bed.terms if truth.bed else {}
        truth = replace(truth, bed=Surface(machine.bed, terms, grain(rng, *bumps)))
    return probe_bed(machine, truth, hidden, layout, rng, outside)


def probe_bed(
    machine: Delta,
    truth: Truth,
    hidden: tuple[str, ...],
    layout: Layout,
    rng: np.random.Generator,
    outside: tuple[str, Disturb] | None = None,
) -> DeltaSession:
    """Touch the bed of a machine; a second call is another day at the same one."""
    at = places_of(layout, machine.bed)
    heights, cycles = len(layout.heights), layout.cycles
    x, y = (np.tile(at[:, k], heights * cycles) for k in range(2))
    block = np.tile(np.repeat(layout.heights, len(at)), cycles)
    cycle = np.repeat(np.arange(1, cycles + 1), len(at) * heights)
    steps = rng.gamma(25.0, layout.pace / 25.0, size=len(x))
    minutes = np.round(np.cumsum(steps) - steps[0], 2)
    contact = np.zeros(len(x))
    if outside:
        truth, contact = outside[1](truth, minutes, rng)
    clean = touches(machine, truth, x, y, block, minutes / 60.0)
    shown = clean + rng.normal(scale=machine.noise, size=len(x))
    if machine.resolution:
        shown = np.round(shown / machine.resolution) * machine.resolution
    if "misread" in hidden:
        size = rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 4.0) * TOLERANCES["misread"]
        contact[rng.integers(len(x))] += size
    return DeltaSession(
        machine, truth, hidden, layout, frozen(x), frozen(y), frozen(block), frozen(minutes),
        frozen(cycle, np.int64), frozen(contact), frozen(clean),
        frozen(np.round(shown + contact, 6)), outside[0] if outside else None,
    )  # fmt: skip


def delta_csv(session: DeltaSession) -> str:
    """The record as a file of the contract; z_mm is the height of what lies under the probe."""
    names = "cycle", "minutes", "x", "y", "block", "readings"
    columns = zip(*(getattr(session, name) for name in names), strict=True)
    rows = [
        f"{n},{cycle},{minutes:.2f},{x:.2f},{y:.2f},{block:g},{reading:.6f}"
        for n, (cycle, minutes, x, y, block, reading) in enumerate(columns, 1)
    ]
    return "\n".join(("seq,cycle,minutes,x_mm,y_mm,z_mm,reading_mm", *rows)) + "\n"


def delta_yaml(machine: Delta) -> str:
    """The machine file of the contract that states this machine, its probe and the tolerances."""
    lists = {"arms": list(machine.arms), "angles": list(machine.angles)}
    ends = dict(zip("abc", machine.endstops, strict=True))
    return FILE.substitute(vars(machine) | lists | ends)
