"""The answers that raters saved, checked against the key of their pages."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pentimento.contracts.codec import from_plain
from pentimento.contracts.errors import ContractError
from pentimento.rating.page import Hidden, Key

COLUMNS: Final = ("rater", "item", "question", "shown", "right", "answer", "comment")


@dataclass(frozen=True)
class Saved:
    """A file that a page saved."""

    page: str
    rater: str
    comment: str
    answers: dict[str, dict[str, str]]
    """By trial and question."""


@dataclass(frozen=True)
class Answer:
    """One answer, with what the page hid."""

    rater: str
    item: str
    question: str
    shown: tuple[str, ...]
    """Conditions, from left to right."""
    right: str | None
    """The condition that the reference belongs to; form match."""
    value: str
    """The chosen condition, the word of a tie, or the point of a scale."""
    comment: str
    """How the rater decided, of the whole page."""


def read_key(path: Path) -> Key:
    """The key that was written beside the pages.

    Raises:
        ContractError: the file is no such key.
    """
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ContractError(
            f"{path} is no key ({error}); give the key.json that was written with the pages."
        ) from error
    return from_plain(Key, plain, str(path))


def read_answers(paths: Sequence[Path], key: Key) -> list[Answer]:
    """Every answer in the files that raters saved.

    Raises:
        ContractError: a file is no file of answers, belongs to another page, holds an answer that its page does not
            offer, or is the second one of its rater.
    """
    found: list[Answer] = []
    files: dict[str, Path] = {}
    for path in paths:
        saved = _saved(path)
        if saved.page not in key.pages:
            raise ContractError(
                f"{path} was saved from page {saved.page!r}, which is not in this key; give its own key."
            )
        if saved.rater in files:
            raise ContractError(
                f"{path} and {files[saved.rater]} are both of {saved.rater!r}; give one file for each rater."
            )
        files[saved.rater] = path
        found += _checked(saved, key, path)
    return found


def _saved(path: Path) -> Saved:
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ContractError(f"{path} is no file of answers ({error}); save it from the page again.") from error
    saved = from_plain(Saved, plain, str(path))
    if not saved.rater.strip():
        raise ContractError(f"{path} has no rater's name or number; save it from the page again, with one.")
    return saved


def _checked(saved: Saved, key: Key, path: Path) -> Iterable[Answer]:
    for trial, by_question in saved.answers.items():
        hidden = key.pages[saved.page].get(trial)
        if hidden is None:
            raise ContractError(f"{path} answers {trial!r}, which its page does not have; save it from the page again.")
        offered = key.study.choices(len(hidden.shown))
        for question, value in by_question.items():
            if question not in key.study.questions or value not in offered:
                raise ContractError(
                    f"{path} answers {question!r} by {value!r}, which its page does not offer; save it from the page "
                    "again."
                )
            meant = _meant(value, hidden, key)
            yield Answer(saved.rater, hidden.item, question, hidden.shown, hidden.right, meant, saved.comment)


def _meant(value: str, hidden: Hidden, key: Key) -> str:
    """A condition in place of a side."""
    return value if key.study.form == "panel" or not value.isdigit() else hidden.shown[int(value) - 1]


def table(answers: Iterable[Answer]) -> str:
    """The answers as CSV, a row each."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(COLUMNS)
    for one in answers:
        writer.writerow(
            (one.rater, one.item, one.question, " | ".join(one.shown), one.right or "", one.value, one.comment)
        )
    return text.getvalue()
