"""The documentation tells the truth: its commands, options, links, paths and names are there."""

import argparse
import ast
import importlib
import re
import shlex
from collections.abc import Iterator
from fnmatch import fnmatch
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from pentimento.cli import main as cli
from pipelines._imports import ROOT
from pipelines._params import read_yaml

PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")] + sorted((ROOT / "docs").glob("*.md"))
CODE = ("src", "pipelines", "studies", "examples", "benchmarks", "tests")
OUTPUTS = ("data", "models")
OURS = re.compile(
    r"(?:\.venv/bin/)?(?:pentimento|make|dvc repro|"
    r"python -m (?:pentimento|pipelines|studies|examples|benchmarks)\b\S*)(?= |$)"
)
PLACEHOLDER = re.compile(r"<[^>]*>|\$\{[^}]*\}|\b[A-Z]{2,}\b")

page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


class Command(NamedTuple):
    """A command as a page tells it."""

    words: list[str]
    whole: bool
    """To be copied and run. A sentence may also speak of a command without any of its options."""


def blocks_and_spans(text: str) -> tuple[str, list[str]]:
    """The lines of all fenced blocks, and what stands in `backticks` outside of them."""
    fence = re.compile(r"^ *```.*?\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
    return "".join(fence.findall(text)), re.findall(r"`([^`\n]+)`", fence.sub("", text))


def commands(text: str) -> Iterator[Command]:
    blocks, spans = blocks_and_spans(text)
    for line in re.split(r"\n| && ", blocks.replace("\\\n", " ")):
        if OURS.match(line):
            yield Command(shlex.split(line, comments=True), True)
    for span in spans:
        if OURS.match(span):
            words = shlex.split(span)
            yield Command(words, any(word.startswith("--") for word in words))


@cache
def pentimentos() -> argparse.ArgumentParser:
    """The parser of the command `pentimento`."""
    found: list[argparse.ArgumentParser] = []

    def keep(parser: argparse.ArgumentParser, *_: Any) -> None:
        found.append(parser)
        raise StopIteration

    with pytest.MonkeyPatch.context() as patched, pytest.raises(StopIteration):
        patched.setattr(argparse.ArgumentParser, "parse_args", keep)
        cli.main([])
    return found[0]


def subcommands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    return next((dict(action.choices) for action in parser._actions if isinstance(action.choices, dict)), {})


def options_of(parser: argparse.ArgumentParser) -> set[str]:
    return {option for action in parser._actions for option in action.option_strings}


def module_file(module: str) -> Path:
    """Of `python -m module`."""
    folder = ROOT / ("src" if module.startswith("pentimento") else ".") / module.replace(".", "/")
    return folder / "__main__.py" if folder.is_dir() else folder.with_suffix(".py")


@cache
def module_options(file: Path) -> dict[str, bool]:
    """Options that a module's parser knows, and whether each is required; read, so that nothing heavy is imported."""
    return {
        str(name.value): any(keyword.arg == "required" for keyword in call.keywords)
        for call in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr == "add_argument"
        for name in call.args
        if isinstance(name, ast.Constant) and str(name.value).startswith("-")
    }


def of_pentimento(command: Command) -> None:
    parser, words = pentimentos(), command.words[1:]
    if command.whole:
        try:
            parser.parse_args(words)
        except SystemExit as error:
            raise AssertionError(f"pentimento does not understand: {shlex.join(command.words)}") from error
    while known := subcommands(parser):
        assert not words or words[0] in known, f"pentimento has no {words[0]}; it has {', '.join(known)}"
        if not words:
            break
        parser, words = known[words[0]], words[1:]
    assert_known(words, options_of(parser), command.words)


def of_a_module(command: Command) -> None:
    file = module_file(command.words[2])
    assert file.is_file() and "__main__" in file.read_text(encoding="utf-8"), f"{command.words[2]} cannot be run"
    options = module_options(file)
    assert_known(command.words[3:], set(options), command.words)
    missing = [option for option, required in options.items() if required and option not in command.words]
    assert not (command.whole and missing), f"{shlex.join(command.words)} needs {', '.join(missing)}"


def of_make(command: Command) -> None:
    makefile = (ROOT / "Makefile").read_text()
    for word in command.words[1:]:
        name, is_variable, _ = word.partition("=")
        line = rf"^{re.escape(name)} \?=" if is_variable else rf"^{re.escape(name)}:"
        assert word == "…" or re.search(line, makefile, re.MULTILINE), f"the Makefile has no {name}"


def of_dvc(command: Command) -> None:
    stages = read_yaml(ROOT / "dvc.yaml")["stages"]
    unknown = [word for word in command.words[2:] if not word.startswith("-") and word.partition("@")[0] not in stages]
    assert not unknown, f"dvc.yaml has no stage {', '.join(unknown)}"


def assert_known(words: list[str], options: set[str], command: list[str]) -> None:
    unknown = [word for word in words if word.startswith("--") and word not in options]
    assert not unknown, f"{shlex.join(command)}: no option {', '.join(unknown)}"


def check(command: Command) -> None:
    checks = {"pentimento": of_pentimento, "python": of_a_module, "make": of_make, "dvc": of_dvc}
    checks[Path(command.words[0]).name](command)


@page
def test_its_commands_are_understood(page: Path) -> None:
    for command in commands(page.read_text(encoding="utf-8")):
        check(command)


@pytest.mark.parametrize(
    "wrong",
    [
        "`pentimento pint`",
        "`pentimento new brush`",
        "`pentimento card rows.parquet --colour`",
        "```sh\npentimento import paths.csv   # without photographs\n```",
        "`python -m pipelines.nowhere`",
        "`python -m pipelines.contracts`",
        "`python -m pipelines.compare --newest 2`",
        "```\ncd pentimento && python -m studies.hands --out DIR\n```",
        "`make report`",
        "`make repro PROFIL=smoke`",
        "`dvc repro -s stroke@marker`",
    ],
)
def test_a_wrong_command_is_noticed(wrong: str) -> None:
    (command,) = commands(wrong)
    with pytest.raises(AssertionError):
        check(command)


@page
def test_the_options_it_speaks_of_are_known_somewhere(page: Path) -> None:
    _, spans = blocks_and_spans(page.read_text(encoding="utf-8"))
    unknown = {span for span in spans if re.match(r"--\w", span) and shlex.split(span)[0] not in all_options()}
    assert not unknown


@cache
def all_options() -> set[str]:
    parsers = [pentimentos()]
    for parser in parsers:  # grows meanwhile
        parsers.extend(subcommands(parser).values())
    modules = (file for folder in CODE for file in (ROOT / folder).rglob("*.py"))
    with_options = [file for file in modules if "add_argument" in file.read_text(encoding="utf-8")]
    return set().union(*map(options_of, parsers), *map(module_options, with_options))


@page
def test_its_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in link]
    broken = [link for link in links if not (page.parent / link.partition("#")[0]).exists()]
    assert not broken


def test_every_page_of_the_docs_is_reached_from_the_readme() -> None:
    reached, waiting = set(), [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        reached.add(page)
        links = re.findall(r"\]\(([^)\s#]+\.md)", page.read_text(encoding="utf-8"))
        waiting += [linked for link in links if (linked := (page.parent / link).resolve()) not in reached]
    assert not set((ROOT / "docs").glob("*.md")) - reached


@page
def test_the_paths_it_names_are_there(page: Path) -> None:
    _, spans = blocks_and_spans(page.read_text(encoding="utf-8"))
    gone = [span for span in spans if any(not is_there(path) for path in expanded(span) if looks_like_a_path(path))]
    assert not gone


@pytest.mark.parametrize("path", ["control/safty.py", "tests/calibration/test_{lens,glass}.py", "data/stroke/<tool>/"])
def test_a_wrong_path_is_noticed(path: str) -> None:
    assert not all(is_there(each) for each in expanded(path) if looks_like_a_path(each))


@page
def test_the_python_names_it_names_are_there(page: Path) -> None:
    _, spans = blocks_and_spans(page.read_text(encoding="utf-8"))
    for name in filter(re.compile(r"(?:pentimento|pipelines|studies|examples|benchmarks)(?:\.\w+)+").fullmatch, spans):
        file = module_file(name)
        package = file.name == "__main__.py" and file.with_name("__init__.py").is_file()
        if not (file.is_file() or package):
            module, _, attribute = name.rpartition(".")
            assert hasattr(importlib.import_module(module), attribute), f"there is no {name}"


def expanded(span: str) -> list[str]:
    """`a/{b,c}.py` as two paths; parts to fill in, such as <tool>, as *."""
    parts = re.split(r"\{([^{}]*)\}", PLACEHOLDER.sub("*", span))
    choices = [part.split(",") if number % 2 else [part] for number, part in enumerate(parts)]
    return ["".join(choice) for choice in product(*choices)]


def looks_like_a_path(text: str) -> bool:
    """A path in this repository, from its root or from within a package; a bare name only where it is Python's."""
    if re.fullmatch(r"[\w.*/-]+", text) is None or text.startswith("/"):
        return False
    first, slash, _ = text.partition("/")
    return text.endswith(".py") or bool(slash and first in folders())


@cache
def folders() -> set[str]:
    """Names of folders in which code or outputs lie."""
    within = {path.name for folder in CODE for path in (ROOT / folder).rglob("*") if path.is_dir()}
    return (within | {*CODE, *OUTPUTS, "docs", "profiles"}) - {"pentimento"}  # so MLflow's experiments are called


@cache
def files() -> list[str]:
    """Files and folders of the repository that are no outputs."""
    found = (
        path for folder in (*CODE, "docs", "profiles", "base") for path in [ROOT / folder, *(ROOT / folder).rglob("*")]
    )
    return [path.relative_to(ROOT).as_posix() for path in found]


@cache
def outputs() -> list[str]:
    """Patterns of what the stages write, and of what else the code names in data/ and models/."""
    stages = read_yaml(ROOT / "dvc.yaml")["stages"].values()
    outs = [PLACEHOLDER.sub("*", str(out)) for stage in stages for out in stage["outs"]]
    code = (file.read_text(encoding="utf-8") for folder in CODE for file in (ROOT / folder).rglob("*.py"))
    return outs + [path for text in code for path in re.findall(r'"((?:data|models)/[\w/]+)"', text)]


def is_there(path: str) -> bool:
    path = path.rstrip("/")
    if path.partition("/")[0] in OUTPUTS:
        return any(
            fnmatch(path, pattern) or fnmatch(path, f"{pattern}/*") or pattern.startswith(f"{path}/")
            for pattern in outputs()
        )
    return any(fnmatch(file, path) or fnmatch(file, f"*/{path}") for file in files())


def test_licences_are_of_the_pinned_versions() -> None:
    """Every package that is pinned is on the page, but PyAV and the drivers of arms, which `make env` leaves out."""
    rows = re.findall(r"^\| (\S+) +\| (\S+) +\| \S", (ROOT / "docs/licences.md").read_text(), re.MULTILINE)
    named = {name.lower().replace("_", "-"): version.partition("+")[0] for name, version in rows[1:]}
    pins = re.findall(r"^([\w.-]+)==([\w.]+)", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    pinned = {name.lower().replace("_", "-"): version for name, version in pins}
    assert set(pinned) - set(named) == {"av", "franky-control", "websockets", "xarm-python-sdk"}
    assert {name: version for name, version in named.items() if pinned.get(name) != version} == {}
