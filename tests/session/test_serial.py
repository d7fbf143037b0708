"""Serial gauges that err, lose their cable, share a line or have to be asked."""

from pathlib import Path

from .terminal import SerialLine, Terminal


def test_return_asks_a_gauge_and_an_error_is_no_reading(tmp_path: Path, line: SerialLine) -> None:
    with Terminal(tmp_path, "s.yaml", "--gauge", f"sylvac:{line.path}") as terminal:
        assert terminal.step() == 1
        terminal.type("")
        assert line.received() == b"?\r"
        for error in (b"ERR6\r", b"\xff\xfe\r"):
            line.send(error)
            terminal.expect("nothing is recorded")
            assert terminal.step() == 1
        line.send(b"-0.64\r")
        terminal.expect("saved -0.640")


def test_unplugging_pauses_and_plugging_in_goes_on(tmp_path: Path, line: SerialLine) -> None:
    with Terminal(tmp_path, "s.yaml", "--gauge", f"plain:{line.path}") as terminal:
        assert terminal.step() == 1
        line.send(b"-0.64\r")
        assert terminal.step() == 2
        for value in ("0.41", "-0.95"):
            line.unplug()
            terminal.expect(r"does\s+not\s+answer")
            terminal.expect(r"Plug\s+it\s+in\s+again")
            terminal.step()
            line.plug_in()
            terminal.expect("The gauge is back")
            terminal.step()
            line.send(f"{value}\r".encode())
            terminal.expect(f"saved {float(value):+.3f}".replace("+", r"\+"))
            terminal.step()
        terminal.type("q")
        assert terminal.finish() == 130
        assert "Traceback" not in terminal.seen


def test_two_gauges_on_a_multiplexer(tmp_path: Path, line: SerialLine) -> None:
    with Terminal(tmp_path, "s.yaml", "--gauge", f"mitutoyo:{line.path}#1,2") as terminal:
        assert terminal.step() == 1
        line.send(b"02A+0000.410\r")
        terminal.expect("That was channel 02; channel 1 is next")
        assert terminal.step() == 1
        line.send(b"01A-0000.640\r")
        terminal.expect("saved -0.640")
        assert terminal.step() == 2
        line.send(b"02A+0000.410\r")
        terminal.expect(r"saved \+0\.410")
