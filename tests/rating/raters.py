"""Test support: pictures of two conditions, pages of them, and raters who answer as they are told."""

import json
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np

from pentimento.rating.page import Hidden, Key, Picture, pages, trials_of
from pentimento.rating.study import Study, read_study

FIRST, OTHER = "brushwise", "plainline"
Choose = Callable[[Hidden], str]
"""The value that a rater chooses, of a trial whose conditions this rater knows."""


def picture(item: int, condition: int, side_px: int = 8) -> Picture:
    return np.random.default_rng([item, condition]).integers(0, 255, (side_px, side_px, 3), dtype=np.uint8)


def items(count: int, conditions: tuple[str, ...] = (FIRST, OTHER)) -> dict[str, dict[str, Picture]]:
    return {f"item{i:02d}": {name: picture(i, n) for n, name in enumerate(conditions)} for i in range(count)}


def written(
    study: str | Study, count: int, raters: int, *, conditions: tuple[str, ...] = (FIRST, OTHER), seed: int = 0,
    per_rater: int | None = None,
) -> tuple[dict[str, str], Key]:  # fmt: skip
    """Pages and key of a shipped study with so many items."""
    asked = read_study(study) if isinstance(study, str) else study
    shown = items(count, conditions)
    names = conditions if asked.form == "match" else tuple(shown)
    beside = {name: picture(n, 99) if asked.reference == "picture" else f"a <cup> {n}" for n, name in enumerate(names)}
    trials = trials_of(asked, shown, {} if asked.reference == "none" else beside)
    return pages(asked, trials, raters=raters, per_rater=per_rater, seed=seed)


def save(folder: Path, key: Key, choose: Choose) -> list[Path]:
    """A file of answers for each page, as the page saves it."""
    files = []
    for number, (page, parts) in enumerate(key.pages.items()):
        chosen = {trial: {q: choose(hidden) for q in key.study.questions} for trial, hidden in parts.items()}
        files.append(folder / f"answers_{page}.json")
        saved = {"page": page, "rater": f"rater {number}", "comment": "by the lines", "answers": chosen}
        files[-1].write_text(json.dumps(saved), encoding="utf-8")
    return files


def preferring(condition: str, probability: float, rng: np.random.Generator) -> Choose:
    """Choose a condition's side with a probability, else the other side."""

    def choose(hidden: Hidden) -> str:
        side = hidden.shown.index(condition)
        return str(1 + (side if rng.random() < probability else 1 - side))

    return choose


class Reader(HTMLParser):
    """The tags of a page, with their attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def each(self, tag: str, attribute: str) -> list[str]:
        return [str(attrs[attribute]) for name, attrs in self.tags if name == tag and attribute in attrs]
