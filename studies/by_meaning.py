"""Paintings by meaning on many pictures and words, after execution in the studio, by the judge.

    PYTHONPATH=src python -m studies.by_meaning pictures OUT.json    # semantic beside print, with the marker
    PYTHONPATH=src python -m studies.by_meaning words OUT.json       # words alone beside the pictures they start from

In the repository's root, after `make repro`. The settings are those of params.yaml. Pictures and words are fixed here;
those of the development split were looked at while the settings were chosen. Results are written after each painting,
and a run that was interrupted goes on.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from pentimento.contracts.colour import linear_to_srgb, to_uint8
from pentimento.contracts.images import read_image, write_png
from pentimento.contracts.scenes import CONTRACT, phrase
from pentimento.contracts.tables import read_table
from pentimento.copainting.drawings.sources import vocabulary
from pentimento.copainting.evaluation.by_meaning import (
    SUM,
    MeaningSetting,
    Networks,
    Picture,
    nearest_picture,
    paint_by_meaning,
    rank_of_words,
    similarity,
)
from pentimento.dynamics.strokes.extended import read_stroke_model
from pentimento.semantics.encoder import Encoder
from pipelines._config import load_section
from pipelines._io import single_threaded
from pipelines.paint_by_meaning import PaintByMeaning

DEVELOPMENT: Final = (
    "chelsea.png", "coffee.png", "flower.jpg", "motorcycle_left.png", "rocket.jpg", "horse.png", "astronaut.png",
)  # fmt: skip
HELD_OUT: Final = (
    "retina.jpg", "hubble_deep_field.jpg", "china.jpg", "ihc.png", "moon.png", "camera.png", "coins.png", "color.png",
    "logo.png", "cell.png", "microaneurysms.png", "clock_motion.png",
)  # fmt: skip
"""Photographs inside the packages scikit-image and scikit-learn."""
WORDS: Final = 96
_SEED: Final = 11
_SHOWN: Final = ("print", SUM)


def _photograph(name: str) -> Picture:
    folders = (("skimage", "data"), ("sklearn", "datasets/images"))
    for package, folder in folders:
        found = find_spec(package)
        assert found is not None and found.origin is not None
        path = Path(found.origin).parent / folder / name
        if path.is_file():
            return read_image(path)
    raise FileNotFoundError(f"Neither scikit-image nor scikit-learn ships {name}.")


def _pictures(settings: dict[str, MeaningSetting], _scenes: Path, _guide: Encoder) -> Iterator[tuple[str, Any, Any]]:
    """Each picture's name, setting and start."""
    for name in (*DEVELOPMENT, *HELD_OUT):
        # Only the sum and the print objective are compared.
        yield name, settings["semantic"], lambda name=name: _photograph(name)


def _words(settings: dict[str, MeaningSetting], scenes: Path, guide: Encoder) -> Iterator[tuple[str, Any, Any]]:
    """Each thing's name, setting and start: the nearest picture of the scenes."""
    rows = read_table(scenes, CONTRACT).table.to_pylist()
    names = sorted(np.random.default_rng(_SEED).choice(sorted(vocabulary()), WORDS, replace=False))
    for name in map(str, names):
        setting = settings["words"]
        text = setting.planner.objectives.text
        assert text is not None
        objectives = replace(setting.planner.objectives, text=replace(text, words=phrase(name)))
        asked = replace(setting, planner=replace(setting.planner, objectives=objectives))
        yield name, asked, lambda name=name: nearest_picture(phrase(name), rows, guide)


KINDS: Final[dict[str, Callable[[dict[str, MeaningSetting], Path, Encoder], Iterator[tuple[str, Any, Any]]]]] = {
    "pictures": _pictures,
    "words": _words,
}


def main() -> None:
    """Paint, judge and write; then print the table."""
    parser = argparse.ArgumentParser(prog="studies.by_meaning", description=__doc__)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("out", type=Path)
    parser.add_argument("--root", type=Path, default=Path(), help="folder of data/ and models/")
    arguments = parser.parse_args()
    single_threaded()
    config, models = load_section(Path("params.yaml"), "paint_by_meaning", PaintByMeaning), arguments.root / "models"
    networks = Networks(
        Encoder.load(models / "semantics/weights"), Encoder.load(models / "judge/weights"), config.views
    )
    scenes, pictures = arguments.root / "data/scenes", arguments.out.with_suffix("")
    found: dict[str, Any] = json.loads(arguments.out.read_text()) if arguments.out.exists() else {}
    pictures.mkdir(parents=True, exist_ok=True)
    for name, setting, start in KINDS[arguments.kind](config.settings, scenes, networks.guide):
        if name in found:
            continue
        model = read_stroke_model(models / f"stroke_{setting.tool}" / "weights")
        target, painted = paint_by_meaning(setting, start(), model, networks, studio_seed=config.seed, names=_SHOWN)
        picture, text = to_uint8(linear_to_srgb(np.clip(target, 0.0, 1.0))), setting.planner.objectives.text
        found[name] = {
            kind: {"similarity": similarity(networks.judge, painting.painted, picture)}
            | ({} if text is None else {"rank": rank_of_words(networks.judge, painting.painted, text.words)})
            for kind, painting in painted.items()
        }
        write_png(pictures / f"{Path(name).stem}.png", np.hstack([picture, *(p.painted for p in painted.values())]))
        arguments.out.write_text(json.dumps(found, indent=1))
        print(name, found[name], flush=True)
    _print_table(found)


def _print_table(found: dict[str, Any]) -> None:
    splits = {"development": DEVELOPMENT, "held out": HELD_OUT} if set(DEVELOPMENT) & set(found) else {"words": found}
    for split, names in splits.items():
        rows = [found[name] for name in names if name in found]
        more = sum(row[SUM]["similarity"] > row["print"]["similarity"] for row in rows)
        means = {kind: float(np.mean([row[kind]["similarity"] for row in rows])) for kind in _SHOWN}
        print(f"{split}: similarity {means}, higher with the sum on {more} of {len(rows)}")
        if "rank" in rows[0][SUM]:
            for kind in _SHOWN:
                ranks = np.array([row[kind]["rank"] for row in rows])
                print(f"  {kind}: first {np.mean(ranks == 1):.2f}, among five {np.mean(ranks <= 5):.2f}, "
                      f"mean rank {ranks.mean():.1f}")  # fmt: skip


if __name__ == "__main__":
    main()
