"""The benchmark's page, Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from studies.blind.binomial import interval, standing
from studies.blind.calibration import calibration
from studies.blind.kinds import Kind
from studies.blind.rivals import METHODS
from studies.blind.score_card import (
    Row,
    by_series,
    covariate_found,
    exact,
    hidden,
    in_rival_set,
    named,
    outside_found,
    rows,
    unique_and_right,
    wrong_unique,
)

Line = dict[str, Any]

_METHOD = """\
The hidden truth is committed to by its SHA-256 hash; a separate process diagnoses the table alone; the truth is read
after the verdict. q is the energy of the effect that the base model cannot absorb, over the noise floor.

*95 %* is the exact interval (Clopper–Pearson). A row *falls short* where an exact one-sided binomial test rejects its
bar at 5 %, and is *undecided* where it misses its bar by less; a bar on a quantile is tested by how many worlds reach
it. *Constant* is a baseline that always answers with the most frequent truth of the row's worlds. False names are
counted over all worlds of a randomised design. A world without a verdict counts as missed."""


def page(kind: Kind, lines: Sequence[Line], commit: str) -> str:
    """The whole file, from the lines of one commit's worlds."""
    sections = [
        f"# {kind.title}",
        f"Written by `python -m studies.blind.table {kind.name}`; do not edit.",
        kind.introduction,
        _METHOD,
        _share(kind, lines),
        _origin(lines, commit),
        _table(rows(kind, lines)),
        "## Stated probability and frequency",
        calibration(lines),
        "## Simpler methods on the same rows",
        simpler_methods(lines),
        "## Worlds",
        _worlds(kind, lines),
        "## By cause",
        _by_cause(kind, lines),
        "## Missed",
        _missed(kind, lines),
    ]
    return "\n\n".join(sections) + "\n"


def _share(kind: Kind, lines: Sequence[Line]) -> str:
    whole = sum(series.worlds for series in kind.series)
    known = sum(map(len, by_series(lines).values()))
    if known >= whole:
        return f"This is the whole benchmark, {whole} worlds."
    return f"**This is a share of the benchmark**: {known} of its {whole} worlds; `make studies` makes the rest."


def _origin(lines: Sequence[Line], commit: str) -> str:
    versions = sorted({line["code"] for line in lines})
    text = f"Seeds: sha256 of the commit `{commit}`, the series and a number."
    if len(versions) > 1:
        text += f" **The verdicts are of {len(versions)} versions of the code ({', '.join(versions)}).**"
    return text


def _table(found: Sequence[Row]) -> str:
    head = ["| | count | share | 95 % | bar | | constant | pixels | |", "|---|---|---|---|---|---|---|---|---|"]
    return "\n".join([*head, *(_row(row) for row in found)])


def _row(row: Row) -> str:
    low, high = interval(row.hits, row.of)
    bar, result = "", ""
    if row.bar is not None:
        bar, result = str(row.bar), standing(row.hits, row.of, row.bar).replace("falls short", "**falls short**")
    cells = [
        row.what, f"{row.hits}/{row.of}", _percent(row.hits / row.of), f"{_percent(low)} – {_percent(high)}", bar,
        result, _percent(row.constant), _percent(row.pixelwise), row.note,
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.3g} %"


def simpler_methods(lines: Sequence[Line]) -> str:
    """Names of the diagnosis and of each method of `rivals.py`."""
    by = by_series(lines)
    hiding = {name: by.get(name, []) for name in ("one cause", "one faint cause", "two causes")}
    hiding = {name: own for name, own in hiding.items() if own}
    columns = [*(f"{name}: exact set" for name in hiding), "none: nothing named", "false names among names"]
    table = [f"| method | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    for method in (None, *METHODS):
        told = [(line, _names(line, method)) for own in by.values() for line in own]
        names = [(line, name) for line, own in told for name in own]
        false = sum(name not in hidden(line) for line, name in names)
        exactly = [(sum(_names(line, method) == hidden(line) for line in own), len(own)) for own in hiding.values()]
        quiet = by.get("none", [])
        cells = [*exactly, (sum(not _names(line, method) for line in quiet), len(quiet)), (false, len(names))]
        table.append(f"| {method or 'the diagnosis'} | {' | '.join(f'{hits}/{of}' for hits, of in cells)} |")
    return "\n".join(table)


def _names(line: Line, method: str | None) -> tuple[str, ...]:
    """The causes that a method names; those of the verdict for None."""
    return named(line.get("verdict")) if method is None else tuple(sorted(line.get("rivals", {}).get(method, ())))


def _worlds(kind: Kind, lines: Sequence[Line]) -> str:
    by = by_series(lines)
    redrawn = Counter(line["series"] for line in lines if "redrawn" in line)
    table = ["| series | in the benchmark | diagnosed | drawn again (effect not attainable) |", "|---|---|---|---|"]
    table += [f"| {s.name} | {s.worlds} | {len(by.get(s.name, []))} | {redrawn[s.name]} |" for s in kind.series]
    return "\n".join(table)


def _by_cause(kind: Kind, lines: Sequence[Line]) -> str:
    by = by_series(lines)
    single = [line for name in kind.single_cause_series for line in by.get(name, [])]
    table = ["| hidden cause | exact set | other causes named |", "|---|---|---|"]
    for cause in sorted({hidden(line)[0] for line in single}):
        own = [line for line in single if hidden(line) == (cause,)]
        others = Counter(name for line in own for name in named(line.get("verdict")) if name != cause)
        listed = ", ".join(f"{name} {count}" for name, count in others.most_common())
        table.append(f"| {cause} | {sum(map(exact, own))}/{len(own)} | {listed} |")
    return "\n".join(table)


def _missed(kind: Kind, lines: Sequence[Line]) -> str:
    table = ["| series | index | seed | tool | hidden (q) | verdict |", "|---|---|---|---|---|---|"]
    for line in lines:
        if "redrawn" in line or not (why := _miss(kind, line)):
            continue
        truth = line["truth"]
        strengths = ", ".join(f"{s['q']:.2f}" for s in truth["strengths"])
        outside = truth["outside"]
        content = " + ".join(truth["causes"]) or (f"{outside['mode']} by {outside['column']}" if outside else "nothing")
        content += f" ({strengths})" if strengths else ""
        cells = [line["series"], str(line["index"]), str(line["seed"]), truth["tool"], content, why]
        table.append(f"| {' | '.join(cells)} |")
    return "\n".join(table) if len(table) > 2 else "None."


def _miss(kind: Kind, line: Line) -> str:
    """The verdicts of a world in words where one is wrong; otherwise an empty string."""
    if "failed" in line:
        return "no verdict: " + " ".join(line["failed"].split())[-200:].replace("|", "/")
    verdict = line["verdict"]
    match line["series"]:
        case "outside":
            right = (outside_found if kind.name == "strokes" else covariate_found)(line) and not named(verdict)
        case "raster":
            right = in_rival_set(line) and not wrong_unique(line)
            if right and not unique_and_right(line["second"], line):
                return "with more actions: " + _in_words(line["second"])
        case "deleted":
            return "without the candidate: " + _in_words(line["second"]) if named(line["second"]) else ""
        case "shuffled":
            gone = not set(hidden(line)) & set(named(line["second"]))
            right = gone and exact(line)
            if not right:
                return f"{_in_words(verdict)}; shuffled: {_in_words(line['second'])}"
        case _:
            right = exact(line)
    return "" if right else _in_words(verdict)


def _in_words(verdict: dict[str, Any]) -> str:
    entries = [
        entry["cause"] + (f" (or {', '.join(entry['rivals'])})" if entry["rivals"] else "")
        for entry in verdict["established"]
    ]
    text = " + ".join(entries) or "nothing named"
    if verdict["suspected"]:
        text += "; suspected " + ", ".join(entry["cause"] for entry in verdict["suspected"])
    if verdict["unexplained"]:
        text += f"; {verdict['unexplained'][0]['mode']} by {verdict['unexplained'][0]['covariate']} unexplained"
    return text
