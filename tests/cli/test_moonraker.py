"""A printer behind a Moonraker server: read, written, restarted; and servers that are none."""

import json
import socket
import threading
import time
from contextlib import suppress
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pytest

from tests.printer_files import OFF, printer_cfg
from tests.truth.delta import Delta

from .program import answer, done, refused, run, words

# With all digits that Klipper writes.
GOOD = printer_cfg(Delta(), OFF).replace("= 161.8\n", "= 161.800449\n").encode()
INFO = {"result": {"klippy_state": "ready"}}
NONE: dict = {"result": {"status": {}}}


class StandIn(ThreadingHTTPServer):
    """A server that answers what it is told to, and keeps what was asked of it."""

    def __init__(self, **answers: Any) -> None:
        class Handler(BaseHTTPRequestHandler):
            server: ClassVar[StandIn]

            def do_GET(self) -> None:
                self.server.answer(self)

            do_POST = do_GET

            def log_message(self, *_: object) -> None:
                pass

        super().__init__(("127.0.0.1", 0), Handler)
        self.answers, self.asked = answers, list[tuple[str, str | None]]()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"

    def answer(self, asked: BaseHTTPRequestHandler) -> None:
        self.asked.append((asked.path, asked.headers.get("X-Api-Key")))
        name = asked.path.partition("?")[0].rpartition("/")[2].removesuffix(".cfg")
        found = self.answers.get(name, 404)
        if callable(found):
            found(self, asked)
            return
        if isinstance(found, int):
            asked.send_error(found)
            return
        body = found if isinstance(found, bytes) else json.dumps(found).encode()
        asked.send_response(200)
        asked.send_header("Content-Length", str(len(body) + self.answers.get("cut", 0)))
        asked.end_headers()
        asked.wfile.write(body)


def of_state(state: object) -> dict:
    return {"result": {"status": {"print_stats": {"state": state}}}}


def test_a_server_is_read_like_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MOONRAKER_API_KEY", "s3cret")
    Path("printer.cfg").write_bytes(GOOD)
    server = StandIn(info=INFO, printer=GOOD)
    both = [answer("solve", source)["parameters"] for source in ("printer.cfg", server.address)]
    assert both[0] == both[1]
    assert {key for _, key in server.asked} == {"s3cret"}


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        ({"info": b"<html>router</html>"}, "not Moonraker"),
        ({"info": {"result": {}}}, "not Moonraker"),
        ({"info": json.dumps(INFO).encode().ljust(5_000_001)}, "not Moonraker"),
        ({}, "404"),
        ({"info": 401}, "MOONRAKER_API_KEY"),
        ({"info": INFO}, "no printer.cfg"),
        ({"info": INFO, "printer": b"[printer]\nkinematics: del", "cut": 50}, "cannot be read"),
        ({"info": INFO, "printer": b"\xff\xfe\x00"}, "UTF-16"),
    ],
)
def test_servers_that_are_of_no_use(answers: dict, said: str) -> None:
    assert said in refused(3, "solve", StandIn(**answers).address)


@pytest.mark.parametrize("state", [of_state("printing"), of_state(None), NONE])
def test_only_a_printer_that_says_that_it_is_idle_is_written_to(state: dict) -> None:
    server = StandIn(info=INFO, printer=GOOD, query=state)
    result = run("apply", server.address, "--to", server.address, "--yes")
    assert result.exit_code in (2, 3)
    assert not any(path.endswith("/upload") for path, _ in server.asked)


def test_a_server_that_does_not_keep_what_it_takes_is_not_restarted() -> None:
    """It is idle, answers that all is well, and holds the old file."""
    taken = {"upload": {}, "firmware_restart": {}}
    server = StandIn(info=INFO, printer=GOOD, query=of_state("standby"), **taken)
    said = words(run("apply", server.address, "--to", server.address, "--yes").stderr)
    assert "another printer.cfg than the one just sent" in said
    asked = [path for path, _ in server.asked]
    assert "/server/files/upload" in asked
    assert "/printer/firmware_restart" not in asked


def keep_and_break_off(server: StandIn, asked: BaseHTTPRequestHandler) -> None:
    """Store what was sent, and say so in half a sentence."""
    body = asked.rfile.read(int(asked.headers["Content-Length"]))
    server.answers["printer"] = body.split(b"\r\n\r\n", 2)[2].rpartition(b"\r\n--")[0]
    asked.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\n{")


def test_what_was_stored_stays_recorded_though_the_answer_was_lost() -> None:
    late = {"upload": keep_and_break_off, "firmware_restart": {}}
    server = StandIn(info=INFO, printer=GOOD, query=of_state("standby"), **late)
    done("apply", server.address, "--to", server.address, "--yes")
    assert server.answers["printer"] != GOOD
    (record,) = Path().glob("*.yaml")
    assert server.address in record.read_text(encoding="utf-8")
    done("apply", "--undo", "--to", server.address, "--yes")
    assert server.answers["printer"] == GOOD


def refuse(_: StandIn, asked: BaseHTTPRequestHandler) -> None:
    asked.send_response(403)
    asked.end_headers()
    asked.wfile.write(b'{"error": {"message": "File is loaded, upload not permitted"}}')


def test_a_refusal_says_what_the_server_says_and_leaves_no_file() -> None:
    server = StandIn(info=INFO, printer=GOOD, query=of_state("standby"), upload=refuse)
    result = run("apply", server.address, "--to", server.address, "--yes")
    assert result.exit_code == 3
    assert "File is loaded, upload not permitted" in words(result.stderr)
    assert "API" not in result.stderr
    assert list(Path().glob("*.yaml")) == []


def test_two_printers_in_one_folder_have_two_machine_files() -> None:
    other = printer_cfg(Delta(), replace(OFF, radius=0.1))
    for name, text in (("one.cfg", GOOD.decode()), ("two.cfg", other)):
        Path(name).write_text(text, encoding="utf-8")
        done("apply", name, "--to", name, "--yes")
    for name in ("one", "two"):
        assert f"{name}.cfg" in Path(f"{name}.yaml").read_text(encoding="utf-8")
    done("apply", "--undo", "--to", "one.cfg", "--yes")
    assert Path("one.cfg").read_bytes() == GOOD
    assert Path("two.cfg").read_text(encoding="utf-8") != other
    # What is taken back leaves a machine file that is of no other printer.
    Path("three.cfg").write_bytes(GOOD)
    done("apply", "three.cfg", "--to", "three.cfg", "--yes")
    assert "three.cfg" in Path("three.yaml").read_text(encoding="utf-8")


def test_how_the_nozzle_moves_is_said_before_it_is_entered() -> None:
    Path("printer.cfg").write_bytes(GOOD)
    assert "Or write it: orthocal apply printer.cfg --to" in refused(
        2, "apply", "printer.cfg", "--yes"
    )
    stands = "For the same Z the nozzle stands 0."
    assert words(run("report", "printer.cfg").stdout).count(stands) == 1
    said = done("apply", "printer.cfg", "--to", "printer.cfg", "--yes")
    assert "orthocal verify BEFORE AFTER" in said, "the file itself is another afterwards"
    assert stands in words(said)
    assert words(said).index(stands) < words(said).index("1. Restart the firmware")


def test_a_server_that_never_comes_to_an_end_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """A byte now and then, in the head or in the body: there is always something to wait for."""
    monkeypatch.setattr("orthoglide_cal.files.moonraker.WHOLE_S", 0.3)
    for beginning in (b"", b"HTTP/1.0 200 A\r\n\r\n", b"HTTP/1.1 200 A\nContent-Length: 99\n\n"):
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
