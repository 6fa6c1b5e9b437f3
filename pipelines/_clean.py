"""`make clean`: remove what the pipeline of dvc.yaml makes, with its comparisons and timings.

    python -m pipelines._clean

What else lies in data/ and models/, such as imported recordings, stays.
"""

import shutil
from pathlib import Path

from pipelines._tracking.dvc_files import outputs
from pipelines._tracking.timings import COMPARISONS, TIMINGS


def clean(root: Path) -> None:
    """Remove the outputs in a repository's root, and the folders around them that are empty then."""
    for name in [*outputs(root), str(TIMINGS), str(COMPARISONS)]:
        path = root / name
        if path.is_symlink() or path.is_file():
            path.unlink()
        elif path.is_dir():
            shutil.rmtree(path)
        for parent in path.parents:
            if parent == root or not parent.is_dir() or any(parent.iterdir()):
                break
            parent.rmdir()


if __name__ == "__main__":
    clean(Path.cwd())
