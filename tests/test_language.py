"""Code and pages use the terms of docs/glossary.md: none of the words that it replaces is left."""

import re
from pathlib import Path

import pytest

from pipelines._imports import ROOT

FOLDERS = ("src", "pipelines", "studies", "examples", "benchmarks", "tests", "docs", "models", "profiles")
SUFFIXES = {".py", ".md", ".toml", ".yaml", ".html", ".css", ".js"}
# The glossary lists the words, licences.md names packages, and this file has the pattern.
EXEMPT = {
    ROOT / "docs/glossary.md",
    ROOT / "docs/licences.md",
    ROOT / "studies/blind/counterfactuals.py",  # a word that seeds published worlds
    Path(__file__),
}
REPLACED = re.compile(
    r"foretell\w*|foretold|habits?|imprint\w*|sealed|searched|imitat\w*|kin|told_by|in_doubt|nameless|misnamed|echoes"
    r"|wander\w*|own_part|taken_up|carried_paint|elsewhere|twins?|judged|easel|sitting|mishaps?|likeness|slack"
    r"|(?<!at_)least_(?!squares)\w+|anew|whoever|asking|caution|made_up",
    re.IGNORECASE,
)


def words(text: str) -> set[str]:
    """Words of prose and parts of identifiers: `test_foretold_ink` holds `foretold` and, as a whole, itself."""
    parts = re.findall(r"[A-Z]?[a-z]+", text)
    return {
        *parts,
        *re.findall(r"\w+", text),
        *re.findall(r"(?:own_part|taken_up|in_doubt|told_by|carried_paint)", text),
    }


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_replaced_word_is_left(folder: str) -> None:
    files = [file for file in (ROOT / folder).rglob("*") if file.suffix in SUFFIXES and "weights" not in file.parts]
    found = {
        f"{file.relative_to(ROOT)}: {word}"
        for file in files
        if file not in EXEMPT
        for word in words(file.read_text(encoding="utf-8"))
        if REPLACED.fullmatch(word)
    }
    assert not found, "docs/glossary.md names the terms to use instead"
