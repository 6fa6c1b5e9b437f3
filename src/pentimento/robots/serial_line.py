"""Lines of text over a serial port, by pyserial (extra `grbl`): a real tty, or a pseudo-terminal in a test."""

from __future__ import annotations

import termios
import time

from pentimento.contracts.errors import ConfigError
from pentimento.robots.machine import MachineError

_RATES = (9600, 57600, 115200, 230400)
_POLL_S = 0.01  # between two looks at the port
_WRITE_S = 1.0  # for the port to take a line


class SerialLine:
    """A serial port in raw mode, 8 bits, no parity, one stop bit. Any thread may send."""

    def __init__(self, port: str, baud: int) -> None:
        """Raises ConfigError for an unknown rate or a missing extra, MachineError if the port cannot be opened."""
        if baud not in _RATES:
            raise ConfigError(f"The rate {baud} is not known; use one of {list(_RATES)}.")
        try:
            import serial
        except ImportError as error:
            raise ConfigError(
                "A plotter on a serial port needs pyserial; install it with: pip install 'pentimento[grbl]'."
            ) from error
        self._port, self._received = port, b""
        try:
            self._serial = serial.Serial(port, baud, timeout=_POLL_S, write_timeout=_WRITE_S, exclusive=True)
        except serial.SerialException as error:
            if "exclusively lock" in str(error):
                raise MachineError(f"The port {port} is used by another program; end it first.") from error
            if "configure" in str(error):
                raise MachineError(f"The port {port} is no serial port ({error}); check its name.") from error
            raise MachineError(
                f"The port {port} cannot be opened ({error}); check the cable, the name and your permission."
            ) from error

    @property
    def port(self) -> str:
        """Name of the port."""
        return self._port

    def send(self, line: str) -> None:
        """Send one line."""
        self.send_byte(line.encode("ascii") + b"\n")

    def send_byte(self, byte: bytes) -> None:
        """Send one byte that the controller executes at once, past its queue."""
        try:
            self._serial.write(byte)
        except OSError as error:  # pyserial's errors are OSErrors
            raise MachineError(f"The link over {self._port} is lost or takes no more data ({error}).") from error

    def keep_board_awake(self) -> None:
        """Let the board run on when the port is closed and opened again; most boards reset by default (HUPCL)."""
        try:
            settings = termios.tcgetattr(self._serial.fileno())
            settings[2] &= ~termios.HUPCL
            termios.tcsetattr(self._serial.fileno(), termios.TCSANOW, settings)
        except (OSError, termios.error) as error:
            raise MachineError(f"The link over {self._port} is lost ({error}).") from error

    def receive(self, within_s: float) -> str | None:
        """The next line, without its end; None if none is complete within that time."""
        deadline_s = time.monotonic() + within_s
        while b"\n" not in self._received:
            try:
                self._received += self._serial.read(max(1, self._serial.in_waiting))
            except OSError as error:
                raise MachineError(f"The link over {self._port} is lost ({error}).") from error
            if b"\n" not in self._received and time.monotonic() >= deadline_s:
                return None
        line, _, self._received = self._received.partition(b"\n")
        return line.decode("ascii", errors="replace").strip()

    def close(self) -> None:
        """Close the port."""
        self._serial.close()
