"""Settings of every test: no network, one thread, no colours."""

import os
import socket
from typing import Any

os.environ.update(
    HF_HUB_OFFLINE="1",
    MLFLOW_DISABLE_TELEMETRY="true",
    DO_NOT_TRACK="true",
    OMP_NUM_THREADS="1",
    NO_COLOR="1",
    MPLBACKEND="Agg",
)

_HERE = ("127.", "::1", "localhost", "0.0.0.0")
_connect, _connect_ex = socket.socket.connect, socket.socket.connect_ex


def _checked(address: Any) -> None:
    """Refuse what is neither this computer nor a file: no test may need a network."""
    if isinstance(address, tuple) and not str(address[0]).startswith(_HERE):
        raise RuntimeError(f"A test asked for {address[0]}: tests use the loopback alone.")


def _only_here(self: socket.socket, address: Any) -> None:
    _checked(address)
    _connect(self, address)


def _only_here_ex(self: socket.socket, address: Any) -> int:
    _checked(address)
    return _connect_ex(self, address)


socket.socket.connect = _only_here  # type: ignore[method-assign]
socket.socket.connect_ex = _only_here_ex  # type: ignore[method-assign]
