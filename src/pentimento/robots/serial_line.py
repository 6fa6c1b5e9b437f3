"""Lines of text over a serial port, by the standard library alone: a real tty, or a pseudo-terminal in a test."""

from __future__ import annotations

import fcntl
import os
import select
import termios
import time
import tty

from pentimento.contracts.errors import ConfigError
from pentimento.robots.machine import MachineError

_SPEEDS = {9600: termios.B9600, 57600: termios.B57600, 115200: termios.B115200, 230400: termios.B230400}


class SerialLine:
    """A serial port in raw mode, 8 bits, no parity, one stop bit. Any thread may send."""

    def __init__(self, port: str, baud: int) -> None:
        """Raises ConfigError for a rate that is not known, MachineError if the port cannot be opened."""
        if baud not in _SPEEDS:
            raise ConfigError(f"The rate {baud} is not known; use one of {sorted(_SPEEDS)}.")
        self._port = port
        try:
            self._handle = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise MachineError(
                f"The port {port} cannot be opened ({error.strerror}); check the cable, the name and your permission."
            ) from error
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self._handle)
            raise MachineError(f"The port {port} is used by another program; end it first.") from error
        try:
            tty.setraw(self._handle)
            settings = termios.tcgetattr(self._handle)
            settings[2] |= termios.CLOCAL | termios.CREAD
            settings[4] = settings[5] = _SPEEDS[baud]
            termios.tcsetattr(self._handle, termios.TCSANOW, settings)
        except termios.error as error:
            os.close(self._handle)
            raise MachineError(f"The port {port} is no serial port ({error}); check its name.") from error
        self._received = b""

    @property
    def port(self) -> str:
        """Name of the port."""
        return self._port

    def send(self, line: str) -> None:
        """Send one line."""
        self._write(line.encode("ascii") + b"\n")

    def send_byte(self, byte: bytes) -> None:
        """Send one byte that the controller acts on at once, past its queue."""
        self._write(byte)

    def receive(self, within_s: float) -> str | None:
        """The next line, without its end; None if none is complete within that time."""
        deadline_s = time.monotonic() + within_s
        while b"\n" not in self._received:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0 or not select.select([self._handle], [], [], left_s)[0]:
                return None
            try:
                part = os.read(self._handle, 4096)
            except OSError as error:
                raise MachineError(f"The link over {self._port} is lost ({error.strerror}).") from error
            if not part:
                raise MachineError(f"The link over {self._port} is lost: the other side closed it.")
            self._received += part
        line, _, self._received = self._received.partition(b"\n")
        return line.decode("ascii", errors="replace").strip()

    def close(self) -> None:
        """Close the port."""
        os.close(self._handle)

    def _write(self, data: bytes) -> None:
        while data:
            try:
                if not select.select([], [self._handle], [], 1.0)[1]:
                    raise MachineError(f"The link over {self._port} takes no more data; check the cable.")
                data = data[os.write(self._handle, data) :]
            except OSError as error:
                raise MachineError(f"The link over {self._port} is lost ({error.strerror}).") from error
