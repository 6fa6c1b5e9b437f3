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
from numba.core import caching
usual = (caching._InTreeCacheLocator, caching._UserWideCacheLocator)
for locator in usual:
    locator.ensure_cache_path = lambda self: (_ for _ in ()).throw(OSError(30, "Read-only file system"))
"""


def test_a_read_only_installation_without_a_home_compiles(tmp_path: Path) -> None:
    """As on a robot's computer whose system is read-only, or in a container with another user."""
    use = "from pentimento.goals3d.sources import top_of; import numpy as np, os; print(os.environ['NUMBA_CACHE_DIR'])"
    use += "; print(top_of(np.array([[[0, 0, 3.0], [1, 0, 3.0], [0, 1, 3.0]]]), 4).max())"
    # Numba reads the variable when it is imported, and so the package comes first.
    code = f"import os; os.access = lambda *_: False; import pentimento; {READ_ONLY}{use}"
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", code],
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
