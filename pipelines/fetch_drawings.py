"""Fetch the archives with drawings that are no Python packages: `npm pack` downloads them."""

import argparse
import shutil
import subprocess
from pathlib import Path

from pentimento.contracts.errors import PentimentoError
from pentimento.copainting.drawings.sources import ARCHIVES
from pipelines._io import output_folder, stage_main


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: one archive for each package."""
    if shutil.which("npm") is None:
        raise PentimentoError("npm is not installed; install Node.js, whose npm fetches the drawings of the judge.")
    with output_folder(arguments.out) as out:
        for package in ARCHIVES.values():
            fetched = subprocess.run(
                ["npm", "pack", "--silent", package], cwd=out, capture_output=True, text=True, check=False
            )
            if fetched.returncode != 0:
                raise PentimentoError(f"npm cannot fetch {package}: {' '.join(fetched.stderr.split())[:300]}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="fetch_drawings", description=__doc__)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
