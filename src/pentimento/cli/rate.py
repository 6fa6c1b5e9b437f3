"""`pentimento rate`: blind pages for people who rate pictures, and what their answers say; see docs/rating.md."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from pentimento.cli import Command, count, option, seed, workshop

_COMMAND = "pentimento rate pages"


def _pages(arguments: argparse.Namespace) -> None:
    from pentimento.contracts.atomic import command_folder
    from pentimento.contracts.codec import to_plain
    from pentimento.contracts.errors import ConfigError

    with workshop("write pages"):
        from pentimento.rating.folders import read_items, read_references, telling_shapes
        from pentimento.rating.page import pages, trials_of
        from pentimento.rating.study import read_study
    study, conditions = read_study(arguments.study), dict(arguments.condition)
    if len(conditions) < 2 and study.form != "panel":
        raise ConfigError("This study compares conditions; give --condition NAME=FOLDER two times or more.")
    items = read_items(conditions)
    references = read_references(study, arguments.references, conditions if study.form == "match" else items)
    trials = trials_of(study, items, references)
    for item in telling_shapes(items):
        print(f"The pictures of {item} differ in shape, by which a rater could tell the conditions.", file=sys.stderr)
    texts, key = pages(study, trials, raters=arguments.raters, per_rater=arguments.per_rater, seed=arguments.seed)
    with command_folder(arguments.out, _COMMAND) as folder:
        (folder / "pages").mkdir()
        for number, text in enumerate(texts.values(), 1):
            (folder / "pages" / f"rater_{number:02d}.html").write_text(text, encoding="utf-8")
        (folder / "key.json").write_text(json.dumps(to_plain(key), indent=1) + "\n", encoding="utf-8")
    each = min(arguments.per_rater or len(trials), len(trials))
    print(
        f"{arguments.raters} pages of {each} of {len(trials)} parts are in {arguments.out / 'pages'}: one for each "
        f"rater, who sends back a file of answers. Keep {arguments.out / 'key.json'}: it says what the pages hide."
    )


def _pages_problem(arguments: argparse.Namespace) -> str | None:
    names = [name for name, _ in arguments.condition]
    return "every --condition needs a name of its own" if len(set(names)) < len(names) else None


def _results(arguments: argparse.Namespace) -> None:
    from pentimento.contracts.atomic import atomic_write
    from pentimento.contracts.errors import ConfigError

    with workshop("evaluate answers"):
        from pentimento.rating.answers import read_answers, read_key, table
        from pentimento.rating.wording import result_lines
    if arguments.table is not None and arguments.table.exists():
        raise ConfigError(f"{arguments.table} exists, and would be replaced; name a new file.")
    key = read_key(arguments.key)
    answers = read_answers(arguments.answers, key)
    lines = result_lines(answers, key)
    if arguments.table is not None:
        atomic_write(arguments.table, table(answers).encode())
    print("\n".join(lines))


def _condition(text: str) -> tuple[str, Path]:
    name, equals, folder = text.partition("=")
    if not (name and equals and folder) or name.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=FOLDER, with a name that is no number")
    return name, Path(folder)


COMMAND = Command(
    "rate",
    "let people rate pictures blindly: write their pages, evaluate their answers",
    subcommands=(
        Command(
            "pages",
            "write a page for each rater, and the key that says what the pages hide",
            (
                option("--study", required=True, metavar="STUDY",
                       help="better, replication, high_level, drawings, style, text, panel, or a .toml file"),
                option("--condition", required=True, action="append", type=_condition, metavar="NAME=FOLDER",
                       help="a folder of pictures, once for each condition; the first is compared with the others"),
                option("--references", type=Path, metavar="FOLDER",
                       help="what most studies show beside: pictures or .txt of items; for style, of conditions"),
                option("--raters", type=count, required=True, metavar="N", help="number of pages"),
                option("--per-rater", type=count, metavar="N",
                       help="maximum number of parts on a page; all by default"),
                option("--seed", type=seed, default=0, metavar="N", help="of orders and sides"),
                option("--out", required=True, type=Path, metavar="FOLDER", help="for the pages and the key"),
            ),
            _pages,
            _pages_problem,
        ),
        Command(
            "results",
            "collect answers into a table, and test them",
            (
                option("key", type=Path, metavar="KEY", help="key.json of the pages"),
                option("answers", type=Path, nargs="+", metavar="ANSWERS", help="files that raters saved"),
                option("--table", type=Path, metavar="FILE", help="a new .csv file for the answers, a row each"),
            ),
            _results,
        ),
    ),
)  # fmt: skip
