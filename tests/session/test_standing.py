"""A machine that is followed: waited for, recorded, doubted, and lost."""

import socket
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.errors import UsageError
from orthoglide_cal.session.dialogue import Dialogue, Quit
from orthoglide_cal.session.events import Doubt
from orthoglide_cal.session.gauges import Standing
from tests.linuxcnc import LinuxCnc, missing

from .virtual import Screen, a_dialogue


class Rsh(threading.Thread):
    """Answers as linuxcncrsh does; `joints` in inches, so that a unit that is lost shows."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.server = socket.create_server(("127.0.0.1", 0))
        self.joints, self.asked = list[tuple[float, ...] | None](), list[str]()
        self.said = {
            "hello": "HELLO ACK EMCNETSVR 1.1",
            "get user_linear_units": "USER_LINEAR_UNITS INCH",
            "get kinematics_type": "KINEMATICS_TYPE 3",
            "get joint_homed": "JOINT_HOMED YES YES YES NO NO NO",
        }
        self.start()

    @property
    def address(self) -> str:
        return f"linuxcnc:127.0.0.1:{self.server.getsockname()[1]}"

    def run(self) -> None:
        connection, _ = self.server.accept()
        with connection, connection.makefile("r") as lines:
            while (text := lines.readline().strip()) and (reply := self.reply(text)):
                connection.sendall(reply.encode() + b"\r\n")

    def reply(self, text: str) -> str | None:
        """What it answers; None if it goes away."""
        self.asked.append(text)
        if text not in ("get joint_pos", "get abs_act_pos"):
            return next((v for k, v in self.said.items() if text.startswith(k)), text)
        now = self.joints.pop(0) if len(self.joints) > 1 else self.joints[0]
        if now and text == "get abs_act_pos":
            now = now[::-1]
        name = text.removeprefix("get ").upper()
        return now and f"{name} " + " ".join(f"{value:.6f}" for value in (*now, 0, 0, 0))

    def stop(self) -> None:
        """Close what the client left open."""
        self.join(5.0)
        self.server.close()


@pytest.fixture
def rsh() -> Iterator[Rsh]:
    server = Rsh()
    yield server
    server.stop()


def followed(
    path: Path, server: Rsh, *lines: str, later: dict[str, str] | None = None
) -> tuple[Dialogue, Screen]:
    """A session that follows the server, answered by these lines."""
    dialogue, screen, stack = a_dialogue(path / "s.journal", lines)
    dialogue.standing = Standing(server.address)
    server.said |= later or {}
    with stack, closing(dialogue.standing), pytest.raises(Quit):
        dialogue.run()
    return dialogue, screen


def inches(*joints_mm: float) -> tuple[float, ...]:
    return tuple(value / 25.4 for value in joints_mm)


ISO = inches(310.25, 310.25, 310.25)


def test_it_is_waited_for_and_where_it_stood_is_recorded(tmp_path: Path, rsh: Rsh) -> None:
    rsh.joints = [inches(300, 310, 310), inches(309, 310, 310), ISO]
    dialogue, screen = followed(tmp_path, rsh, "0.10", "q")
    assert "waiting until the machine stands there" in screen.text
    (taken,) = (item.take for item in dialogue.state.accepted.values())
    assert taken.remark == "the controller stood at X 310.250 Y 310.250 Z 310.250"
    assert dialogue.so_far.session.readings[0].note == taken.remark
    assert all(text.startswith(("hello", "get", "set echo")) for text in rsh.asked)


def test_a_reading_taken_elsewhere_is_questioned_and_kept_only_if_wanted(
    tmp_path: Path, rsh: Rsh
) -> None:
    # The same again, or k without a reason, keeps nothing.
    away = inches(313.25, 310.25, 310.25)
    rsh.joints = [ISO, away, away, ISO]
    answers = ("0.10", "0.10", "k", "", "k a shim is under it", "q")
    dialogue, screen = followed(tmp_path, rsh, *answers)
    (taken,) = (item.take for item in dialogue.state.accepted.values())
    assert "a shim is under it" in (dialogue.so_far.session.readings[0].note or "")
    assert "Why is it kept?" in screen.text
    assert taken.doubt is Doubt.PLACE
    assert "3.00 mm" in taken.question
    assert "m the stand moved" not in screen.text


def test_a_connection_that_is_lost_is_said_once_and_the_session_goes_on(
    tmp_path: Path, rsh: Rsh
) -> None:
    rsh.joints = [ISO, None]
    dialogue, screen = followed(tmp_path, rsh, "0.10", "0.12", "q")
    assert screen.text.count("does not answer any more: it has closed.") == 1
    assert len(dialogue.state.accepted) == 2


def test_without_kinematics_places_have_the_axes_letters_whatever_joint_moves_them(
    rsh: Rsh,
) -> None:
    rsh.said["get kinematics_type"] = "KINEMATICS_TYPE 1"  # trivkins coordinates=ZYX
    rsh.joints = [inches(-5.0, 7.0, 60.0)]
    with closing(Standing(rsh.address)) as standing:
        away, place = standing.at(np.full(3, 310.0), np.array([60.0, 7.0, -5.0]), 310.0)
    assert away < 1e-3
    assert place == "the controller stood at X 60.000 Y 7.000 Z -5.000"


@pytest.mark.parametrize(
    "address", ["emc", "linuxcnc:", "linuxcnc:h:0", "linuxcnc:h:x", "linuxcnc:127.0.0.1:9"]
)
def test_what_cannot_be_followed(address: str) -> None:
    with pytest.raises(UsageError) as caught:
        Standing(address)
    assert "Errno" not in str(caught.value)


@pytest.mark.parametrize(
    ("asked", "told", "refusal"),
    [
        *(("get joint_homed", f"JOINT_HOMED {homed}", "is not homed")
          for homed in ("NO NO NO", "YES YES NO", "YES YES")),
        ("get user_linear_units", "USER_LINEAR_UNITS CUSTOM", "CUSTOM"),
    ],
)  # fmt: skip
def test_it_is_not_followed_until_it_is_homed_nor_in_an_unknown_unit(
    rsh: Rsh, asked: str, told: str, refusal: str
) -> None:
    rsh.said[asked] = told
    with pytest.raises(UsageError, match=refusal):
        Standing(rsh.address)


def test_what_loses_its_home_is_followed_no_more(tmp_path: Path, rsh: Rsh) -> None:
    rsh.joints = [ISO]
    lost = {"get joint_homed": "JOINT_HOMED NO NO NO"}
    _, screen = followed(tmp_path, rsh, "0.10", "q", later=lost)
    assert "it is not homed any more" in screen.text


@pytest.mark.skipif(missing() is not None, reason=str(missing()))
def test_a_real_linuxcnc_says_where_it_stands() -> None:
    with LinuxCnc() as machine, closing(Standing("linuxcnc")) as standing:
        machine.drive(60.0, 0.0, -5.0)
        near, place = standing.at(np.full(3, 310.0), np.array([60.0, 0.0, -5.0]), 310.0)
        assert near < 1e-3
        assert place == "the controller stood at X 60.000 Y 0.000 Z -5.000"
        far, _ = standing.at(np.array([370.0, 304.0, 304.0]), np.zeros(3), 310.0)
        assert far == pytest.approx(6.0, abs=1e-3)
