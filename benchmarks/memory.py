"""How much memory a process holds, and held at most since it was last asked: Linux's own count."""

from pathlib import Path

_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_RESET_PEAK = "5"


def forget_peak() -> int | None:
    """Start a new peak from what is held now, and return that [bytes]; None where the system cannot."""
    try:
        _CLEAR.write_text(_RESET_PEAK)
    except OSError:
        return None
    return _status("VmRSS")


def peak() -> int:
    """The most that was held since ``forget_peak`` [bytes]."""
    return _status("VmHWM")


def _status(field: str) -> int:
    line = next(line for line in _STATUS.read_text().splitlines() if line.startswith(f"{field}:"))
    return int(line.split()[1]) * 1024
