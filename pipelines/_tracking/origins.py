"""Whose the data are that a run reads, and under which licence: as the data themselves say it."""

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

SOURCE, LICENCE = "source:", "licence:"
"""Prefixes of a run's tags, by the name of what it read."""
_COLUMNS = ["source", "licence"]
_LONGEST = 1000  # letters of a tag
_FRONT_MATTER = re.compile(r"---\n(.*?)^---\s*", re.DOTALL | re.MULTILINE)
_LISTED = re.compile(r"^- (?P<amount>\d+ \w+): (?P<source>.+), (?P<licence>[^,\n]+)$", re.MULTILINE)


class Origin(NamedTuple):
    """Of a part of a data set, or of the whole; what is not known is empty."""

    source: str
    licence: str
    amount: str = ""
    """How much of the data set, such as ``180 scenes``."""


def origin_tags(inputs: Mapping[str, Path]) -> dict[str, str]:
    """Tags ``source:<name>`` and ``licence:<name>`` of data by their names; none of what the data do not say."""
    tags: dict[str, str] = {}
    for name, path in inputs.items():
        origins = origins_of(path)
        sources = [each.source + (f" ({each.amount})" if each.amount else "") for each in origins if each.source]
        licences = {each.licence: each.source for each in origins if each.licence}
        whose = [licence if len(licences) == 1 else f"{licence} ({source})" for licence, source in licences.items()]
        tags |= {f"{SOURCE}{name}": "; ".join(sources), f"{LICENCE}{name}": "; ".join(whose)}
    return {name: value[:_LONGEST] for name, value in tags.items() if value}


def told_origin(tags: Mapping[str, str], name: str) -> str:
    """What a run's tags say of the data of that name, in words; empty where they say nothing."""
    source, licence = tags.get(f"{SOURCE}{name}", ""), tags.get(f"{LICENCE}{name}", "not recorded")
    return f"{source.rstrip('.')}; licence {licence}" if source else ""


def origins_of(path: Path) -> list[Origin]:
    """Where a data set (a Parquet file, or a folder) comes from: each row may say it for itself, or README.md for all.

    A card says it in lines ``- 180 scenes: source, licence``, or in its first paragraph, and the licence in its front
    matter. What cannot be read is not known: the stage that reads it will say what is wrong.
    """
    try:
        return _of_rows(path) or _of_card(path / "README.md")
    except (OSError, ValueError, pa.ArrowException):
        return []


def _of_rows(path: Path) -> list[Origin]:
    files = sorted(path.glob("*.parquet")) if path.is_dir() else [path]
    counted: Counter[tuple[str, str]] = Counter()
    for file in files:
        if file.suffix != ".parquet" or not set(_COLUMNS) <= set(pq.read_schema(file).names):
            return []
        rows = pq.read_table(file, columns=_COLUMNS)
        counted.update(zip(*([str(said or "") for said in rows[name].to_pylist()] for name in _COLUMNS), strict=True))
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
    said = next((each for each in paragraphs if not each.lstrip().startswith(("#", "|"))), "")
    return [Origin(" ".join(said.split()), licence[1] if licence else "")]
