"""Where compiled functions are kept, on computers on which neither the package nor a home can be written to."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path


def ensure_cache() -> None:
    """Give Numba a folder of this process alone where it has none, since it then refuses to compile.

    To be called before Numba is imported. The folder is nobody else's and goes at the end, because what lies in it is
    executed.
    """
    if "NUMBA_CACHE_DIR" in os.environ or any(os.access(place, os.W_OK) for place in _usual_places()):
        return
    folder = tempfile.mkdtemp(prefix="pentimento-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = folder


def _usual_places() -> list[Path]:
    """The package, and the place for caches of the user, or the folder in which it can be made."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "numba"
    return [Path(__file__).parent, next(place for place in (cache, *cache.parents) if place.exists())]
