"""Lines over a pseudo-terminal: whole, in pieces, late, and lost."""

import os
import pty
import time
import tty
from collections.abc import Iterator

import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.robots.machine import MachineError
from pentimento.robots.serial_line import SerialLine


@pytest.fixture
def ends() -> Iterator[tuple[int, SerialLine]]:
    """The controller's end, and ours."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    line = SerialLine(os.ttyname(slave), 115200)
    yield master, line
    line.close()
    os.close(slave)
    os.close(master)


def test_lines_are_put_together_and_taken_apart(ends: tuple[int, SerialLine]) -> None:
    master, line = ends
    os.write(master, b"ok\r\nALARM:1\r\n<Id")
    assert line.receive(1.0) == "ok" and line.receive(1.0) == "ALARM:1"
    assert line.receive(0.01) is None
    os.write(master, b"le>\r\n")
    assert line.receive(1.0) == "<Idle>"


def test_waiting_ends_in_time(ends: tuple[int, SerialLine]) -> None:
    begun_s = time.monotonic()
    assert ends[1].receive(0.1) is None
    assert 0.09 < time.monotonic() - begun_s < 1


def test_what_is_sent_arrives_as_it_is(ends: tuple[int, SerialLine]) -> None:
    """No echo, no translation: \\x18 and ! are not eaten by the terminal."""
    master, line = ends
    line.send("G1 X1.000 F100.0")
    line.send_byte(b"\x18")
    line.send_byte(b"!")
    wanted = b"G1 X1.000 F100.0\n\x18!"
    arrived = b""
    while len(arrived) < len(wanted):
        arrived += os.read(master, 100)
    assert arrived == wanted
    assert line.receive(0.02) is None


def test_serial_noise_is_decoded_with_replacement(ends: tuple[int, SerialLine]) -> None:
    os.write(ends[0], b"\xff\xfe\x00ok\n")
    assert "ok" in (ends[1].receive(1.0) or "")


def test_a_port_is_used_by_one_program_at_a_time(ends: tuple[int, SerialLine]) -> None:
    with pytest.raises(MachineError, match="used by another program"):
        SerialLine(ends[1].port, 115200)


def test_closed_port_raises_machine_error() -> None:
    master, slave = pty.openpty()
    line = SerialLine(os.ttyname(slave), 57600)
    os.close(slave)
    os.close(master)
    with pytest.raises(MachineError, match="is lost"):
        line.receive(1.0)
    with pytest.raises(MachineError, match="is lost"):
        line.send("?")
    line.close()


def test_a_rate_that_is_unknown_is_refused() -> None:
    with pytest.raises(ConfigError, match="rate 12345 is not known"):
        SerialLine("/dev/null", 12345)
