"""Whether strangers recognise what the runner draws: contact sheets without captions, and the scores of their answers.

    python -m studies.blind_naming draw --bundle models/bundle --out docs/blind_naming
    python -m studies.blind_naming draw_begun --models models --out docs/blind_naming/begun
    python -m studies.blind_naming score --out docs/blind_naming

`draw` writes `<setting>.png` and `key.json` for each setting: 24 nouns, drawn by the lean runner in the studio from the
words alone. `draw_begun` does so for canvases that somebody else began: of 24 drawings, 12 stand beside the other
drawing and 12 on a canvas that it fills; they are planned in the workshop and drawn in the studio. Each viewer sees the
two sheets only, and writes what every drawing shows into `answers_<viewer>.json`, as `{"<setting>": ["...", ...]}`;
several things in one drawing are separated by semicolons. `score` writes `scores.json`.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.images import read_image, write_png
from pentimento.contracts.scenes import phrase
from pentimento.copainting.drawings.sources import vocabulary
from pentimento.copainting.evaluation.cases import begun_by_others
from pentimento.copainting.evaluation.codraw import one_turn_each
from pentimento.copainting.evaluation.goal_plans import load_paint_context
from pentimento.deploy.words import taught_vocabulary
from pipelines._config import load_section
from pipelines._io import single_threaded, write_json
from pipelines._play import play
from pipelines.evaluate_copainting import EvaluateCopainting

SETTINGS: Final = ("marker", "colour12")
_NOUNS: Final = 24  # of each setting
_SEED: Final = 58
_AT_A_TIME: Final = 2
_SIDE_PX: Final = 128  # of the goals
_COLUMNS: Final = 6
_CELL_PX: Final = 200
_BAND_PX: Final = 24  # above each drawing, for its number
_ARTICLES: Final = ("a ", "an ", "the ", "some ", "two ", "pair of ")


def nouns_of_settings(seed: int) -> dict[str, list[str]]:
    """Different nouns for each setting, drawn at random."""
    names = list(vocabulary())
    order = np.random.default_rng(seed).permutation(len(names)).tolist()
    return {
        setting: [names[index] for index in order[number * _NOUNS : (number + 1) * _NOUNS]]
        for number, setting in enumerate(SETTINGS)
    }


def draw(bundle: Path, out: Path) -> None:
    """Draw every noun with the runner, in processes without PyTorch, and write the sheets and the key."""
    chosen = nouns_of_settings(_SEED)
    out.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(_AT_A_TIME) as pool:
        for setting, nouns in chosen.items():
            write_png(out / f"{setting}.png", sheet([*pool.map(partial(_drawing, bundle, setting), nouns)]))
    write_json(out / "key.json", chosen)


def draw_begun(models: Path, out: Path) -> None:
    """Draw nouns on canvases that others began, and write the sheets and the key."""
    config = load_section(Path("params.yaml"), "evaluate_copainting", EvaluateCopainting)
    single_threaded()
    turn = replace(
        config.codrawing, person_strokes=config.strokes.begun, robot_strokes=config.strokes.added, largest=1.0
    )
    key = {}
    out.mkdir(parents=True, exist_ok=True)
    for number, setting in enumerate(SETTINGS):
        asked = config.settings[setting]
        context = load_paint_context(asked.medium, models / f"stroke_{asked.medium.tool}" / "weights")
        has_ink = context.tool.color_srgb is not None
        cases = [
            case
            for overlapping in (False, True)
            for case in begun_by_others(
                _NOUNS // 2, "marker" if has_ink else "colour", side_px=_SIDE_PX, overlapping=overlapping,
                seed=_SEED + 2 * number + overlapping,
            )
        ]  # fmt: skip
        drawings = [
            play(
                models / "goal_planner" / "weights", story, context, world=asked.world, sampling=config.sampling,
                codrawing=turn, vocabulary=taught_vocabulary("named"), seed=_SEED,
            )[0].after
            for story in one_turn_each(cases)
        ]  # fmt: skip
        write_png(out / f"{setting}.png", sheet(drawings))
        key[setting] = [case.objects[0] for case in cases]
    write_json(out / "key.json", key)


def _drawing(bundle: Path, setting: str, noun: str) -> NDArray[np.uint8]:
    with tempfile.TemporaryDirectory() as scratch:
        command = [sys.executable, "-m", "pipelines._runner_process", "--bundle", str(bundle), "--setting", setting]
        command += ["--words", phrase(noun), "--seed", str(_SEED), "--out", f"{scratch}/painting"]
        subprocess.run(command, check=True)
        return read_image(Path(scratch) / "painting" / "canvas.png")


def sheet(drawings: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Numbered drawings in rows, uint8 [H, W, 3]."""
    cells = []
    for number, drawing in enumerate(drawings, 1):
        cell = np.full((_BAND_PX + _CELL_PX, _CELL_PX, 3), 255, np.uint8)
        cell[_BAND_PX:] = cv2.resize(drawing, (_CELL_PX, _CELL_PX), interpolation=cv2.INTER_CUBIC)
        cv2.putText(cell, str(number), (4, _BAND_PX - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (0, 0, 0), 1, cv2.LINE_AA)
        cells.append(cv2.copyMakeBorder(cell, 0, 6, 0, 6, cv2.BORDER_CONSTANT, value=(255, 255, 255)))
    cells += [np.full_like(cells[0], 255)] * (-len(cells) % _COLUMNS)
    return np.vstack([np.hstack(cells[start : start + _COLUMNS]) for start in range(0, len(cells), _COLUMNS)])


def accepted(noun: str) -> set[str]:
    """The answers that name a noun rightly."""
    extra = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    taught = taught_vocabulary("named").nouns[noun]
    return {*taught.words, *taught.plurals, *taught.nearest, *extra.get(noun, ())}


def is_right(answer: str, noun: str) -> bool:
    """Whether an answer, with or without an article, names the noun; one of several answers, with semicolons."""
    return any(_without_article(part) in accepted(noun) for part in answer.split(";"))


def _without_article(answer: str) -> str:
    words = " ".join(answer.lower().strip(" .").split())
    for article in _ARTICLES:
        words = words.removeprefix(article)
    return words


def score(out: Path) -> None:
    """Write the number of nouns that most viewers, and each viewer, named rightly."""
    key = json.loads((out / "key.json").read_text(encoding="utf-8"))
    viewers = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(out.glob("answers_*.json"))]
    found: dict[str, dict[str, object]] = {}
    for setting, nouns in key.items():
        right = np.array([[is_right(a, noun) for a, noun in zip(v[setting], nouns, strict=True)] for v in viewers])
        majority = right.sum(0) * 2 > len(viewers)
        found[setting] = {
            "nouns": len(nouns),
            "by_majority": int(majority.sum()),
            "by_viewer": right.sum(1).tolist(),
            "missed": [noun for noun, known in zip(nouns, majority, strict=True) if not known],
        }
    write_json(out / "scores.json", found)
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="blind_naming", description=__doc__)
    parser.add_argument("what", choices=("draw", "draw_begun", "score"))
    parser.add_argument("--bundle", type=Path, default=Path("models/bundle"), help="for draw")
    parser.add_argument("--models", type=Path, default=Path("models"), help="for draw_begun")
    parser.add_argument("--out", type=Path, default=Path("docs/blind_naming"))
    chosen = parser.parse_args()
    if chosen.what == "draw":
        draw(chosen.bundle, chosen.out)
    elif chosen.what == "draw_begun":
        draw_begun(chosen.models, chosen.out)
    else:
        score(chosen.out)
