"""A printer behind a Moonraker server: read, written, restarted; and servers that are none."""

import socket
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.moonraker import MISSING, Moonraker, StandIn
from tests.printer_files import OFF, printer_cfg
from tests.truth.delta import Delta

from .program import answer, done, refused, run, words

GOOD = printer_cfg(Delta(), OFF).encode()
INFO = {"result": {"klippy_state": "ready"}}


def of_state(state: object) -> dict:
    return {"result": {"status": {"print_stats": {"state": state}}}}


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MOONRAKER_API_KEY", "http_proxy"):
        monkeypatch.delenv(name, raising=False)


def test_a_server_is_read_like_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MOONRAKER_API_KEY", "s3cret")
    Path("printer.cfg").write_bytes(GOOD)
    server = StandIn(info=INFO, printer=GOOD)
    both = [answer("solve", each)["parameters"] for each in ("printer.cfg", server.address)]
    assert both[0] == both[1]
    assert {key for _, key in server.asked} == {"s3cret"}


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        ({"info": b"<html>router</html>"}, "not Moonraker"),
        ({"info": [1]}, "not Moonraker"),
        ({"info": {"result": {}}}, "not Moonraker"),
        ({}, "404"),
        ({"info": 401}, "MOONRAKER_API_KEY"),
        ({"info": INFO}, "no printer.cfg"),
        ({"info": INFO, "printer": b"[printer]\nkinematics: del", "cut": 50}, "cannot be read"),
        ({"info": INFO, "printer": b"\xff\xfe\x00"}, "UTF-16"),
    ],
)
def test_servers_that_are_of_no_use(answers: dict, said: str) -> None:
    assert said in refused(3, "solve", StandIn(**answers).address)


def test_a_server_that_sends_more_than_any_printer_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("orthoglide_cal.files.moonraker._LARGEST", 10)
    server = StandIn(info=INFO, printer=GOOD)
    assert "The server there is not Moonraker." in refused(3, "solve", server.address)


@pytest.mark.parametrize(
    "address", ["http://127.0.0.1:9", "http://:80", "http://a:b", "http://a/b"]
)
def test_addresses_that_are_of_no_use(address: str) -> None:
    result = run("solve", address)
    assert result.exit_code in (2, 3)
    assert "ddress" in result.stderr
    assert "Errno" not in result.stderr


@pytest.mark.parametrize(
    ("state", "asked"),
    [(of_state("standby"), True), (of_state(None), False), ({"result": {"status": {}}}, False)],
)
def test_only_a_printer_that_says_that_it_is_idle_is_written_to(state: dict, asked: bool) -> None:
    server = StandIn(info=INFO, printer=GOOD, query=state)
    result = run("apply", server.address, "--to", server.address, "--yes")
    assert result.exit_code in (2, 3)  # this server takes nothing
    assert any(path.endswith("/upload") for path, _ in server.asked) == asked


def test_a_server_that_does_not_keep_what_it_takes_is_not_restarted() -> None:
    """It answers that all is well, and holds the old file."""
    taken = {"upload": {}, "firmware_restart": {}}
    server = StandIn(info=INFO, printer=GOOD, query=of_state("standby"), **taken)
    result = run("apply", server.address, "--to", server.address, "--yes")
    assert result.exit_code == 3
    assert "another printer.cfg than the one just sent" in words(result.stderr)
    asked = [path for path, _ in server.asked]
    assert "/server/files/upload" in asked
    assert "/printer/firmware_restart" not in asked


@pytest.mark.skipif(MISSING is not None, reason=str(MISSING))
def test_a_real_server_is_written_and_restored_and_never_while_it_prints(tmp_path: Path) -> None:
    server = Moonraker(tmp_path, GOOD)
    try:
        server.klipper.state = "printing"
        result = run("apply", server.address, "--to", server.address, "--yes")
        assert result.exit_code == 2
        assert "is printing" in words(result.stderr)
        assert server.file.read_bytes() == GOOD
        assert "gcode/script" not in server.klipper.asked
        server.klipper.state = "standby"
        done("apply", server.address, "--to", server.address, "--yes")
        assert server.file.read_bytes() != GOOD
        assert server.klipper.asked.count("gcode/script") == 1
        done("apply", "--undo", "--to", server.address, "--yes")
        assert server.file.read_bytes() == GOOD
        assert server.klipper.asked.count("gcode/script") == 2
    finally:
        server.stop()


def test_a_server_that_never_comes_to_an_end_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """A byte now and then, in the head or in the body: there is always something to wait for."""
    monkeypatch.setattr("orthoglide_cal.files.moonraker.WHOLE_S", 0.3)
    for beginning in (b"", b"HTTP/1.0 200 OK\r\n\r\n"):
        with socket.create_server(("127.0.0.1", 0)) as server:

            def drip(server: socket.socket = server, beginning: bytes = beginning) -> None:
                connection, _ = server.accept()
                with connection, suppress(OSError):
                    connection.sendall(beginning)
                    for _ in range(100):
                        connection.sendall(b"x")
                        time.sleep(0.05)

            threading.Thread(target=drip, daemon=True).start()
            begun = time.monotonic()
            said = refused(3, "solve", f"http://127.0.0.1:{server.getsockname()[1]}")
            assert "no answer in time" in said
            assert time.monotonic() - begun < 3.0
