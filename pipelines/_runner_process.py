"""The lean runner in a separate process: paints or sculpts in the studio, and must not load PyTorch."""

import argparse
import sys
from pathlib import Path

from pentimento.contracts.errors import PentimentoError
from pentimento.control.commission import ClayGoal, Wanted
from pentimento.control.person import Control, Progress
from pentimento.control.run import commission_of, run
from pentimento.control.run_sculpture import clay_commission_of, run_sculpture

HEAVY = ("torch", "sklearn", "skimage", "diffusers", "transformers")
"""What a robot's computer has not."""


def paint(arguments: argparse.Namespace) -> None:
    """Paint into `--out`, as `pentimento run` does."""
    wanted = Wanted("words", arguments.words) if arguments.picture is None else Wanted("picture", arguments.picture)
    commission = commission_of(
        arguments.bundle,
        wanted,
        tell=print,
        setting=arguments.setting,
        strokes=arguments.strokes,
        seed=arguments.seed,
    )
    run(
        commission,
        arguments.out,
        resume=False,
        calibration=arguments.out,
        ask=_nobody,
        page=None,
        control=Control(),
        progress=Progress(),
    )


def sculpt(arguments: argparse.Namespace) -> None:
    """Sculpt into `--out`, likewise."""
    commission = clay_commission_of(
        arguments.bundle,
        arguments.material,
        ClayGoal("letter", arguments.letter),
        actions=arguments.pushes,
        seed=arguments.seed,
    )
    run_sculpture(commission, arguments.out, resume=False, control=Control(), progress=Progress())


def end_lean() -> None:
    """Exit with an error if a package of the workshop was loaded."""
    loaded = sorted(set(HEAVY) & set(sys.modules))
    if loaded:
        sys.exit(f"The runner loaded {', '.join(loaded)}, which a robot's computer does not have.")


def _nobody(request: str) -> None:
    raise RuntimeError(f"In the studio nobody is asked: {request}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bundle", required=True, type=Path)
    parser.add_argument("--setting")
    parser.add_argument("--picture")
    parser.add_argument("--words", default="")
    parser.add_argument("--strokes", type=int)
    parser.add_argument("--material", help="sculpt this instead")
    parser.add_argument("--letter")
    parser.add_argument("--pushes", type=int)
    parser.add_argument("--seed", required=True, type=int)
    parser.add_argument("--out", required=True, type=Path)
    chosen = parser.parse_args()
    try:
        if chosen.material is None:
            paint(chosen)
        else:
            sculpt(chosen)
    except PentimentoError as error:
        sys.exit(str(error))
    end_lean()
