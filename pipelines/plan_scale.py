"""Plan time, price and space of many co-paintings on several machines, from the rates that this checkout measured.

python -m pipelines.plan_scale --paintings 20000 --machines 8
python -m pipelines.plan_scale --paintings 20000 --machines 8 --cores 16 --price 0.5 --profile full
"""

import argparse
import os
from pathlib import Path

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import PentimentoError
from pipelines._config import entry_of
from pipelines._io import stage_main
from pipelines._params import overlaid, resolved
from pipelines._review.scale import PUBLISHED_PX, STAGE, FineTuning, Plan, Sizes, fine_tunings, read_rates, sizes_of
from pipelines._review.scale_page import page, text
from pipelines._tracking.dvc_files import flatten
from pipelines._tracking.store import store_errors


def main(arguments: argparse.Namespace) -> None:
    """Print the plan and write its page."""
    for name in ("paintings", "machines", "cores"):
        if getattr(arguments, name) < 1:
            raise PentimentoError(f"--{name} is {getattr(arguments, name)}; give 1 or more.")
    with store_errors():
        rates = read_rates(Path(), arguments.setting)
    profile = arguments.profile
    sizes = rates.sizes if profile is None else sizes_in(profile, arguments.setting)
    tunings = None if profile is None else fine_tunings_in(profile, sizes)
    plan = Plan(
        rates, arguments.paintings, arguments.machines, arguments.cores, arguments.price, sizes, profile, tunings
    )
    file = arguments.out / "index.html"
    atomic_write(file, page(plan).encode())
    print(text(plan))
    print(f"\nThe page:  {file}")


def sizes_in(profile: str, setting: str) -> Sizes:
    """Return the sizes at which a profile paints a setting."""
    settings = resolved(overlaid(Path(), profile))[STAGE]["settings"]
    return sizes_of(flatten(entry_of(settings, setting, f"{STAGE}.settings")))


def fine_tunings_in(profile: str, sizes: Sizes) -> tuple[FineTuning, ...] | None:
    """Return what fine-tuning takes in a profile that trains a published planner; None for others."""
    params = resolved(overlaid(Path(), profile))
    published = params["pretrain_goal_planner"]["from_pretrained"] not in (None, "base")
    if not published or sizes.picture_pixels != PUBLISHED_PX**2:
        return None
    return fine_tunings(Path(), params["finetune_goal_planner"]["training"])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="plan_scale", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--paintings", type=int, required=True)
    parser.add_argument("--machines", type=int, required=True)
    parser.add_argument("--cores", type=int, default=os.cpu_count() or 1, help="of each machine; as many as here")
    parser.add_argument("--price", type=float, help="of a machine for an hour, in any currency")
    parser.add_argument("--setting", default="marker", help="whose measured rates")
    parser.add_argument("--profile", help="whose sizes, of profiles/; as they were measured")
    parser.add_argument("--out", type=Path, default=Path("data/scale"), help="folder for the page")
    stage_main(main, parser)
