"""Source and licence of the data that a run reads, as the data themselves state them."""

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.tables import parquet_files

SOURCE, LICENCE = "source:", "licence:"
"""Prefixes of a run's tags, by the name of what it read."""
_COLUMNS = ["source", "licence"]
_MAX_LETTERS = 1000  # of a tag
_FRONT_MATTER = re.compile(r"---\n(.*?)^---\s*", re.DOTALL | re.MULTILINE)
_LISTED = re.compile(r"^- (?P<amount>\d+ \w+): (?P<source>.+), (?P<licence>[^,\n]+)$", re.MULTILINE)


class Origin(NamedTuple):
    """Source and licence of a data set or of a part of it; unknown ones are empty."""

    source: str
    licence: str
    amount: str = ""
    """The size of the part, such as ``180 scenes``."""


def origin_tags(inputs: Mapping[str, Path]) -> dict[str, str]:
    """Return tags ``source:<name>`` and ``licence:<name>`` of inputs by name, without unknown ones."""
    tags: dict[str, str] = {}
    for name, path in inputs.items():
        origins = origins_of(path)
        sources = [each.source + (f" ({each.amount})" if each.amount else "") for each in origins if each.source]
        licences = {each.licence: each.source for each in origins if each.licence}
        by_source = [licence if len(licences) == 1 else f"{licence} ({source})" for licence, source in licences.items()]
        tags |= {f"{SOURCE}{name}": "; ".join(sources), f"{LICENCE}{name}": "; ".join(by_source)}
    return {name: value[:_MAX_LETTERS] for name, value in tags.items() if value}


def described_origin(tags: Mapping[str, str], name: str) -> str:
    """Return source and licence of an input from a run's tags, as text; empty where they are unknown."""
    source, licence = tags.get(f"{SOURCE}{name}", ""), tags.get(f"{LICENCE}{name}", "not recorded")
    return f"{source.rstrip('.')}; licence {licence}" if source else ""


def origins_of(path: Path) -> list[Origin]:
    """Return the origins of a data set (a Parquet file or a folder), from its rows or from README.md.

    A README states them in lines ``- 180 scenes: source, licence``, or the source in its first paragraph and the
    licence in its front matter. Unreadable data have no known origin; the stage that reads them reports the error.
    """
    try:
        return _of_rows(path) or _of_card(path / "README.md")
    except (OSError, ValueError, pa.ArrowException):
        return []


def _of_rows(path: Path) -> list[Origin]:
    files = parquet_files(path)
    counted: Counter[tuple[str, str]] = Counter()
    for file in files:
        if file.suffix != ".parquet" or not set(_COLUMNS) <= set(pq.read_schema(file).names):
            return []
        rows = pq.read_table(file, columns=_COLUMNS)
        counted.update(zip(*([str(value or "") for value in rows[name].to_pylist()] for name in _COLUMNS), strict=True))
    return [Origin(*origin, f"{count} rows") for origin, count in sorted(counted.items())]


def _of_card(card: Path) -> list[Origin]:
    if not card.is_file():
        return []
    text = card.read_text(encoding="utf-8")
    listed = [Origin(each["source"], each["licence"], each["amount"]) for each in _LISTED.finditer(text)]
    if listed:
        return listed
    front = _FRONT_MATTER.match(text)
    licence = re.search(r"^licen[cs]e: *(.+?) *$", front[1], re.MULTILINE) if front else None
    paragraphs = [each for each in re.split(r"\n\s*\n", text[front.end() if front else 0 :]) if each.strip()]
    first = next((each for each in paragraphs if not each.lstrip().startswith(("#", "|"))), "")
    return [Origin(" ".join(first.split()), licence[1] if licence else "")]
