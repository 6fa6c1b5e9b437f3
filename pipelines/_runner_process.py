"""The lean runner in a process of its own: paints one picture in the studio, and must end without PyTorch."""

import argparse
import sys
from pathlib import Path

from pentimento.runner.commission import Wanted
from pentimento.runner.control import Control
from pentimento.runner.progress import Progress
from pentimento.runner.run import commission_of, run

HEAVY = ("torch", "sklearn", "skimage", "diffusers", "transformers")
"""What a robot's computer has not. SciPy is not among them: where it is installed, Numba looks at it."""


def paint(arguments: argparse.Namespace) -> None:
    """Paint into `--out`, as `pentimento run` does."""
    wanted = Wanted("words", arguments.words) if arguments.picture is None else Wanted("picture", arguments.picture)
    commission = commission_of(
        arguments.bundle, arguments.setting, "virtual", False, wanted, arguments.strokes, None, arguments.seed
    )
    run(commission, arguments.out, False, arguments.out, _nobody, None, Control(), Progress())
    loaded = sorted(set(HEAVY) & set(sys.modules))
    if loaded:
        sys.exit(f"The runner loaded {', '.join(loaded)}, which a robot's computer has not.")


def _nobody(request: str) -> None:
    raise RuntimeError(f"In the studio nobody is asked: {request}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bundle", required=True, type=Path)
    parser.add_argument("--setting", required=True)
    parser.add_argument("--picture")
    parser.add_argument("--words", default="")
    parser.add_argument("--strokes", required=True, type=int)
    parser.add_argument("--seed", required=True, type=int)
    parser.add_argument("--out", required=True, type=Path)
    paint(parser.parse_args())
