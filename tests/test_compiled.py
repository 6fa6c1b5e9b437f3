"""Compiled functions on computers on which nothing can be written but temporary files."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pentimento._compiled import ensure_cache

READ_ONLY = """
import os
os.access = lambda *_: False
import pentimento
from numba.core import caching
usual = caching._CacheLocator.ensure_cache_path
def temporary_only(self):
    if not self.get_cache_path().startswith(os.environ["TMPDIR"]):
        raise OSError(30, "Read-only file system")
    usual(self)
caching._CacheLocator.ensure_cache_path = temporary_only
from pentimento.goals3d.sources import top_of
import numpy as np
print(os.environ["NUMBA_CACHE_DIR"], top_of(np.array([[[0, 0, 3.0], [1, 0, 3.0], [0, 1, 3.0]]]), 4).max())
"""


def test_a_read_only_installation_without_a_home_compiles(tmp_path: Path) -> None:
    """As on a robot's computer whose system is read-only, or in a container with another user."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", READ_ONLY],
        env=environment | {"TMPDIR": str(tmp_path)}, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    folder, highest = done.stdout.split()
    assert float(highest) == 3.0 and folder.startswith(str(tmp_path)), done.stderr
    assert not Path(folder).exists()


def test_a_usual_computer_keeps_what_is_compiled(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "not/made"))
    monkeypatch.setattr(os, "access", lambda place, _: Path(place) == tmp_path)
    ensure_cache()
    assert "NUMBA_CACHE_DIR" not in os.environ
