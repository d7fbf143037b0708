"""The posture program, run by an independent controller and compared with an independent machine.

The controller is a small machine that runs G-code, and knows nothing of what wrote it. It obeys
straight moves (G0, G1) in absolute mm, feeds, dwells, programmed stops and the end; whatever else
stands in the text makes it stop with an error. Where the carriages belong and where the tool then
is comes from `tests.truth`. As a table, as CSV and as G-code, with templates of one's own.
"""

import csv
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

from orthoglide_cal.errors import InputError, PostureError
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.planning.program import posture_program, program_text
from orthoglide_cal.planning.steps import GuidedSession, MeasuringProtocol, Order, SessionStep
from tests.cli.program import done, refusals, run
from tests.machines import NOMINAL, PROTOTYPE, ROOT, both_models
from tests.truth.forward import tool_from_carriages
from tests.truth.plan import joints_at

_WORD = re.compile(r"([A-Z])\s*([+-]?(?:\d+\.?\d*|\.\d+))")
# What is left of one that does not end, or has another one in it, is not understood.
_COMMENT = re.compile(r"\(([^()]*)\)")
# Those that LinuxCNC and others obey.
_OBEYED = re.compile(
    r"\s*(MSG|DEBUG|PRINT|PY|AXIS|LOG|LOGOPEN|LOGAPPEND|LOGCLOSE|PROBEOPEN|PROBECLOSE)\b", re.I
)


@dataclass(frozen=True)
class Move:
    """A straight move of all axes; lengths in mm, feed in mm/min."""

    start: Floats
    end: Floats
    feed: float


@dataclass(frozen=True)
class Wait:
    """A stop, until a button is pressed (seconds None) or for a time."""

    block: int | None
    at: Floats
    arrival: Move
    seconds: float | None


@dataclass
class Controller:
    """State of the machine; begins at `at`, knowing no mode at all."""

    at: Floats
    modes: set[str] = field(default_factory=set)
    feed: float | None = None
    block: int | None = None
    ended: bool = False
    moves: list[Move] = field(default_factory=list)
    waits: list[Wait] = field(default_factory=list)

    @property
    def readings(self) -> list[Wait]:
        """Waits of numbered blocks; at the others gauges are set up."""
        return [wait for wait in self.waits if wait.block is not None]

    @property
    def set_ups(self) -> list[Wait]:
        return [wait for wait in self.waits if wait.block is None]

    def run(self, text: str) -> None:
        """Obey every line; the text must end the program itself."""
        for line in text.splitlines():
            assert len(line) <= 80, line
            for inside in _COMMENT.findall(line):
                assert not _OBEYED.match(inside), f"a comment that some controllers obey: {line}"
            code = _COMMENT.sub("", line).upper().strip()
            if code:
                assert not self.ended, f"after the end: {line}"
                self._line(code)
        assert self.ended

    def _line(self, code: str) -> None:
        words = _WORD.findall(code)
        assert "".join(a + b for a, b in words) == code.replace(" ", ""), f"not understood: {code}"
        places = dict.fromkeys("XYZ", None) | {a: float(b) for a, b in words if a in "XYZ"}
        codes = {a + b.lstrip("0").rjust(1, "0") for a, b in words if a in "GM"}
        others = {a: float(b) for a, b in words if a not in "GMXYZ"}
        known = {"G0", "G1", "G4", "G21", "G90", "G94", "M0", "M1", "M2", "M30"}
        assert codes <= known, codes - known
        assert set(others) <= {"N", "F", "P"}
        if "N" in others:
            self.block = int(others["N"])
        self.modes |= codes
        self.feed = others.get("F", self.feed)
        if any(value is not None for value in places.values()):
            assert codes & {"G0", "G1"}
            self._move(list(places.values()))
        if codes & {"M0", "M1", "G4"}:
            seconds = others["P"] if "G4" in codes else None
            self.waits.append(Wait(self.block, self.at, self.moves[-1], seconds))
            self.block = None
        self.ended = self.ended or bool(codes & {"M2", "M30"})

    def _move(self, wanted: list[float | None]) -> None:
        assert self.modes >= {"G21", "G90"}, "no unit, or not absolute"
        assert self.feed, "no feed"
        end = self.at.copy()
        for axis, value in enumerate(wanted):
            if value is not None:
                end[axis] = value
        self.moves.append(Move(self.at, end, self.feed))
        self.at = end


SESSION = "orthocal measure --cycles 2"


def steps_of(
    model: Model,
    protocol: MeasuringProtocol = MeasuringProtocol.DOUBLE,
    order: Order = Order.PAPER,
    stands: int = 2,
) -> tuple[SessionStep, ...]:
    return GuidedSession(protocol=protocol, cycles=2, order=order, stands=stands).steps(
        model.machine
    )


def ran(text: str, home: float) -> Controller:
    """What a controller did, the axes being the carriages."""
    controller = Controller(np.full(3, float(home)))
    controller.run(text)
    return controller


def gcode(
    folder: Path,
    model: Model = NOMINAL,
    steps: Sequence[SessionStep] | None = None,
    template: str | None = None,
) -> str:
    """The program as it is written to a file, in a folder of its own."""
    chosen = steps_of(model) if steps is None else steps
    own = Path(mkdtemp(dir=folder))
    path = None
    if template is not None:
        path = own / "template.nc"
        path.write_text(template, encoding="utf-8")
    return program_text(posture_program(model, chosen, SESSION), Path("made.nc"), path)


def default_template() -> str:
    return done("template", "gcode")


def true_tool(length: float, joints: Floats) -> Floats:
    """Where the tool is, shape (3, n), for joints of shape (n, 3)."""
    carriages = np.zeros((3, 3, len(joints)))
    carriages[range(3), range(3)] = joints.T
    legs = np.full((3, 1), length)
    return tool_from_carriages(carriages, legs, joints.T - length)


def visits_of(steps: Sequence[SessionStep]) -> list[SessionStep]:
    """The first step of each visit."""
    return [steps[0], *(b for a, b in pairwise(steps) if a.visit != b.visit)]


protocols = pytest.mark.parametrize(
    ("protocol", "order", "stands"),
    [
        # Its postures need not begin at the isotropic one, where the gauges are put up.
        (MeasuringProtocol.BEST, Order.PAPER, 2),
        (MeasuringProtocol.DOUBLE, Order.PAPER, 2),
        (MeasuringProtocol.DOUBLE, Order.PAPER, 1),
        (MeasuringProtocol.SINGLE, Order.PAPER, 1),
        (MeasuringProtocol.SINGLE, Order.FEWEST_MOVES, 1),
    ],
)


def assert_near(found: Floats, wanted: Floats | float) -> None:
    """To a micrometre."""
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-3)


@both_models
@protocols
def test_every_block_stops_at_its_posture(
    model: Model, protocol: MeasuringProtocol, order: Order, stands: int, tmp_path: Path
) -> None:
    steps = steps_of(model, protocol, order, stands)
    length = model.machine.leg_length_mm
    done = ran(gcode(tmp_path, model, steps), length)
    visits = visits_of(steps)
    assert [wait.block for wait in done.readings] == [10 * k + 10 for k in range(len(visits))]
    assert [step.block for step in visits] == [wait.block for wait in done.readings]
    for wait, step in zip(done.readings, visits, strict=True):
        wanted = joints_at(length, step.leg, step.cell.displacement)
        assert_near(wait.at, wanted)
        assert wait.seconds is None
    # The gauges are put up at the isotropic posture.
    assert len(done.set_ups) == len({step.setup for step in steps})
    for wait in done.set_ups:
        assert_near(wait.at, length)


@both_models
def test_carriages_arrive_slowly_from_below(model: Model, tmp_path: Path) -> None:
    """All of them but the one at its lower limit."""
    length, low = model.machine.leg_length_mm, model.machine.joint_limits_mm[0]
    text = gcode(tmp_path, model)
    done = ran(text, length)
    for wait in done.readings:
        at_limit = np.isclose(wait.at - length, low)
        assert_near(wait.arrival.end - wait.arrival.start, np.where(at_limit, -1.0, 1.0))
        assert wait.arrival.feed == 100.0
    assert "(N30: leg X, MIN, cycle 1. Read steps 5-6, gauges Y Z. Carriage X arrives" in text
    assert {move.feed for move in done.moves} == {100.0, 1000.0}


def test_no_carriage_is_driven_beyond_its_limits() -> None:
    """Where x goes to +60 mm the other two carriages go to -5.9 mm; the last 1 mm needs room."""
    too_far = {
        (-5.0, 60.0): r"N20: carriage Y .* -5.*-5 and \+60",
        (-0.4, 0.6): r"N10: carriage X .* \+1 mm",
    }
    for limits, refusal in too_far.items():
        narrow = Model(PROTOTYPE.changed(joint_limits_mm=limits))
        with pytest.raises(PostureError, match=refusal):
            posture_program(narrow, steps_of(narrow), SESSION)


@both_models
def test_the_leg_stays_under_the_plunger_on_the_way(model: Model, tmp_path: Path) -> None:
    """Joints that move evenly over the whole travel would take the tool 10 mm off the axis."""
    length = model.machine.leg_length_mm
    shares = np.linspace(0.0, 1.0, 9)[:, None]
    for move in ran(gcode(tmp_path, model), length).moves:
        joints = move.start + shares * (move.end - move.start)
        tool = np.sort(np.abs(true_tool(length, joints)), axis=0)
        assert tool[1].max() < 0.25 + 1.5  # half as much again as the approach


@pytest.mark.parametrize(("values", "at_iso"), [("joints", 310.25), ("tool", 0.0)])
def test_the_template_chooses_values_and_pause(values: str, at_iso: float, tmp_path: Path) -> None:
    template = (
        f"( Orthocal VALUES : {values})\n(orthocal pause: g4 p2.5)\n(orthocal feed: 300)\n"
        "(orthocal slow: 20.5)\n(orthocal axes: X Y Z)\nG21 G90 G94\n(orthocal blocks)\nM30\n"
    )
    steps = steps_of(NOMINAL)
    text = gcode(tmp_path, NOMINAL, steps, template)
    done = ran(text, at_iso)
    assert {wait.seconds for wait in done.readings} == {2.5}
    assert {wait.seconds for wait in done.set_ups} == {None}
    assert {wait.arrival.feed for wait in done.readings} == {20.5}
    at = np.array([wait.at for wait in done.readings])
    visits = visits_of(steps)
    length = PROTOTYPE.leg_length_mm
    joints = np.array([joints_at(length, step.leg, step.cell.displacement) for step in visits])
    assert_near(at, true_tool(length, joints).T if values == "tool" else joints)
    if values == "tool":
        # The tool's approach is where the carriages are 1 mm lower.
        begin = np.array([wait.arrival.start for wait in done.readings[:2]])
        lower = true_tool(length, joints[:2] - 1.0).T
        assert_near(begin, lower)


def test_the_text_around_the_marker_is_copied(tmp_path: Path) -> None:
    text = gcode(
        tmp_path, template="(Werk (1\nT1 M6\n(orthocal blocks)\nN5 M5\nM2 (bye)\n"
    ).splitlines()
    assert text[:2] == ["(Werk (1", "T1 M6"]
    assert text[-2:] == ["N5 M5", "M2 (bye)"]


def test_the_default_template_is_the_one_that_is_printed(tmp_path: Path) -> None:
    assert gcode(tmp_path) == gcode(tmp_path, template=default_template())


@pytest.mark.parametrize(
    "name",
    [
        "a) M3 S9000 (",
        "line\nG0 X0",
        "; M30",
        "% end",
        "MSG, LOGCLOSE",
        "x" * 62 + " LOGOPEN,passwd " + "y" * 90,
        "Müller #5 [1/0] ⟨\u202e⟩",
    ],
)
def test_no_name_breaks_the_program(name: str, tmp_path: Path) -> None:
    foreign = replace(NOMINAL, machine=PROTOTYPE.changed(name=name))
    text = gcode(tmp_path, foreign)
    assert text.isascii()
    assert "%" not in text
    named, plain = (
        [(move.end.tolist(), move.feed) for move in ran(each, PROTOTYPE.leg_length_mm).moves]
        for each in (text, gcode(tmp_path))
    )
    assert named == plain


def test_the_csv_has_the_rows_of_the_program() -> None:
    steps = steps_of(NOMINAL)
    foreign = replace(NOMINAL, machine=PROTOTYPE.changed(name='=1+1,"x"'))
    text = program_text(posture_program(foreign, steps, SESSION), Path("program.csv"), None)
    rows = list(csv.DictReader(text.splitlines()))
    visits = visits_of(steps)
    assert [row["block"] for row in rows] == [f"N{step.block}" for step in visits]
    assert " ".join(row["steps"] for row in rows).split() == [str(s.number) for s in steps]
    for row, step in zip(rows, visits, strict=True):
        joints = [float(row[f"joint_{axis}_mm"]) for axis in "xyz"]
        tool = [float(row[f"tool_{axis}_mm"]) for axis in "xyz"]
        wanted = joints_at(PROTOTYPE.leg_length_mm, step.leg, step.cell.displacement)
        assert_near(joints, wanted)
        assert_near(tool, step.cell.displacement * np.eye(3)[step.leg])
        approach = [float(row[f"approach_joint_{axis}_mm"]) for axis in "xyz"]
        side = [1.0 if axis in row["from_above"].split() else -1.0 for axis in "xyz"]
        assert_near(approach, wanted + side)
        assert row["posture"] == step.posture
        assert row["session"] == SESSION
        assert row["machine"] == '\'=1+1,"x"'


@pytest.mark.parametrize("fault", refusals(Path(__file__).with_name("templates.txt")))
def test_a_template_that_cannot_be_used_is_refused(fault: str, tmp_path: Path) -> None:
    old, new, line, said = (part.strip().replace(r"\n", "\n") for part in fault.split("|"))
    template = default_template()
    assert old in template
    with pytest.raises(InputError, match=said) as caught:
        gcode(tmp_path, template=template.replace(old, new))
    assert str(caught.value.file).endswith("template.nc")
    assert not line or caught.value.line == int(line)
    assert caught.value.remedy
    assert not [*tmp_path.rglob("made.nc")]


def test_a_code_that_is_taken_back_or_only_looks_wrong_is_no_fault(tmp_path: Path) -> None:
    """Arc centres (G91.1) and what stands in comments or behind the blocks do no harm."""
    template = "G20 G91\nG21 G90 G91.1 (G20; G91)\n(orthocal blocks)\nG91\nN7 M2\n"
    assert "N10 G1" in gcode(tmp_path, template=template)


def test_the_command_writes_the_program_of_measure(tmp_path: Path) -> None:
    """The blocks and steps are those of a session with the same options."""
    target = tmp_path / "made.nc"
    common = ("--protocol", "single", "--cycles", "2", "--order", "fewest-moves")
    shown = run("plan", *common, "--program", str(target))
    assert shown.exit_code == 0, shown.stderr
    assert shown.stdout == ""
    assert f"blocks written to {target}" in shown.stderr
    steps = steps_of(NOMINAL, MeasuringProtocol.SINGLE, Order.FEWEST_MOVES, 1)
    done = ran(target.read_text(encoding="utf-8"), PROTOTYPE.leg_length_mm)
    assert [wait.block for wait in done.readings] == [step.block for step in visits_of(steps)]
    table = tmp_path / "made.csv"
    assert run("plan", *common, "--program", str(table)).exit_code == 0
    shown = run("plan", *common, "--program", "-")
    assert shown.stdout == table.read_text(encoding="utf-8")
    shown = run("plan", *common, "--program", str(table))
    assert (shown.exit_code, "exists and is not overwritten" in shown.stderr) == (2, True)


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--cycles", "2", "--gauges", "1"),
        ("--protocol", "single", "--cycles", "1", "--order", "fewest-moves"),
        ("--design", "best", "--cycles", "4"),
        ("--machine", "my_large-one.yaml", "--cycles", "1"),
    ],
)
def test_a_program_names_the_session_that_it_belongs_to(
    options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    large = ROOT / "configs" / "orthoglide_large.yaml"
    (tmp_path / "my_large-one.yaml").write_bytes(large.read_bytes())
    monkeypatch.chdir(tmp_path)
    assert run("plan", *options, "--program", "made.nc").exit_code == 0
    assert run("plan", *options, "--program", "made.csv").exit_code == 0
    text = Path("made.nc").read_text(encoding="utf-8")
    (told,) = re.findall(r"^\((orthocal measure.*)\)$", text, re.M)
    told_options = shlex.split(told)[2:]
    wanted = dict(zip(options[::2], options[1::2], strict=True))
    assert dict(zip(told_options[::2], told_options[1::2], strict=True)) == wanted
    with Path("made.csv").open(encoding="utf-8", newline="") as file:
        assert {row["session"] for row in csv.DictReader(file)} == {told}
