"""The page of the blind table of pushes, Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from studies.blind.binomial import interval, standing
from studies.blind.score_card import Row, exact, hidden, judged_lines, named
from studies.blind_pushes.score_card import covariate_found, rows
from studies.blind_pushes.series import SERIES

Line = dict[str, Any]

_INTRODUCTION = """\
Written by `python -m studies.blind_pushes.table`; do not edit. A clay world is drawn by seed in the virtual studio,
whose physics shares no functional form with the vocabulary of causes: material, slab, arm, scanner and tool are
perturbed, half of the tools have another shape than a ball's, and all tables have decoy columns. What it hides is
sealed by its hash; a process of its own gets the table (96 single actions and 24 three times, 168 rows of 64 × 64
pixels about the push) alone; the truth is opened after the verdict. q is the energy of the effect, on the same surface
with and without it, that the base cannot absorb, over the noise floor.

*95 %* is the exact interval (Clopper–Pearson). A row *falls short* where an exact one-sided binomial test rejects its
bar at 5 %, and is *undecided* where it misses its bar by less. *Constant* is what is reached by naming in every world
the cause (or pair) that is hidden most often in the row's worlds. A world that led to no verdict counts as missed."""


def page(lines: Sequence[Line], commit: str) -> str:
    """The whole file, from the lines of one commit's worlds."""
    whole = sum(series.worlds for series in SERIES)
    made = sum(map(len, judged_lines(lines).values()))
    share = f"This is the whole table, {whole} worlds."
    if made < whole:
        share = f"**This is a share of the table**: {made} of its {whole} worlds."
    versions = sorted({line["code"] for line in lines})
    origin = f"Seeds: sha256 of the commit `{commit}`, the series and a number."
    if len(versions) > 1:
        origin += f" **The worlds were judged by {len(versions)} versions of the code ({', '.join(versions)}).**"
    sections = [
        "# Blind tests of the gap finder on pushes",
        _INTRODUCTION,
        share,
        origin,
        _table(rows(lines)),
        "## Worlds",
        _worlds(lines),
        "## By cause",
        _by_cause(lines),
        "## Missed",
        _missed(lines),
    ]
    return "\n\n".join(sections) + "\n"


def _table(found: Sequence[Row]) -> str:
    head = ["| | count | share | 95 % | bar | | constant | |", "|---|---|---|---|---|---|---|---|"]
    return "\n".join([*head, *(_row(row) for row in found)])


def _row(row: Row) -> str:
    low, high = interval(row.hits, row.of)
    bar = "" if row.bar is None else str(row.bar)
    said = "" if row.bar is None else standing(row.hits, row.of, row.bar).replace("falls short", "**falls short**")
    constant = "–" if row.constant is None else f"{100 * row.constant:.3g} %"
    cells = [
        row.what, f"{row.hits}/{row.of}", f"{100 * row.hits / row.of:.3g} %", f"{100 * low:.3g} – {100 * high:.3g} %",
        bar, said, constant, row.note,
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def _worlds(lines: Sequence[Line]) -> str:
    by = judged_lines(lines)
    redrawn = Counter(line["series"] for line in lines if "redrawn" in line)
    table = ["| series | of the table | judged | drawn again, as the effect cannot be so strong |", "|---|---|---|---|"]
    table += [f"| {s.name} | {s.worlds} | {len(by.get(s.name, []))} | {redrawn[s.name]} |" for s in SERIES]
    return "\n".join(table)


def _by_cause(lines: Sequence[Line]) -> str:
    by = judged_lines(lines)
    single = [line for name in ("one cause", "shuffled", "doubled", "deleted") for line in by.get(name, [])]
    table = ["| one cause is hidden | exact set | named instead or beside |", "|---|---|---|"]
    for cause in sorted({hidden(line)[0] for line in single}):
        own = [line for line in single if hidden(line) == (cause,)]
        beside = Counter(name for line in own for name in named(line.get("verdict")) if name != cause)
        others = ", ".join(f"{name} {count}" for name, count in beside.most_common())
        table.append(f"| {cause} | {sum(map(exact, own))}/{len(own)} | {others} |")
    return "\n".join(table)


def _missed(lines: Sequence[Line]) -> str:
    table = ["| series | index | seed | tool | hidden (q) | verdict |", "|---|---|---|---|---|---|"]
    for line in lines:
        if "redrawn" in line or not (why := _miss(line)):
            continue
        truth = line["truth"]
        strengths = ", ".join(f"{s['q']:.2f}" for s in truth["strengths"])
        outside = truth["outside"]
        told = " + ".join(truth["causes"]) or (f"{outside['mode']} by {outside['column']}" if outside else "nothing")
        told += f" ({strengths})" if strengths else ""
        cells = [line["series"], str(line["index"]), str(line["seed"]), truth["tool"], told, why]
        table.append(f"| {' | '.join(cells)} |")
    return "\n".join(table) if len(table) > 2 else "None."


def _miss(line: Line) -> str:
    """What a world's verdicts say where one is not right; else nothing."""
    if "failed" in line:
        return "no verdict: " + " ".join(line["failed"].split())[-200:].replace("|", "/")
    said = line["verdict"]
    match line["series"]:
        case "outside":
            right = covariate_found(line) and not named(said)
        case "deleted":
            return "without the candidate: " + _told(line["second"]) if named(line["second"]) else ""
        case "shuffled":
            gone = not set(hidden(line)) & set(named(line["second"]))
            return "" if gone and exact(line) else f"{_told(said)}; shuffled: {_told(line['second'])}"
        case _:
            right = exact(line)
    return "" if right else _told(said)


def _told(verdict: dict[str, Any]) -> str:
    said = " + ".join(entry["cause"] for entry in verdict["established"]) or "nothing named"
    if verdict["suspected"]:
        said += "; suspected " + ", ".join(entry["cause"] for entry in verdict["suspected"])
    if verdict["unexplained"]:
        said += f"; {verdict['unexplained'][0]['mode']} by {verdict['unexplained'][0]['covariate']} unexplained"
    return said
