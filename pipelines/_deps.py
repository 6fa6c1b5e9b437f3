"""`make deps`: write into dvc.yaml what follows from other files.

    python -m pipelines._deps

Written are each stage's code dependencies (what its module imports), its sections of params.yaml (its own and those of
its presets), and the paths that stand there for each tool, setting or material. A folder stands for its files where the
stage needs half of them or more. All other dependencies are kept by hand.
"""

import re
from functools import cache
from pathlib import Path

from pentimento.cli.pipeline_files import with_listed_paths
from pipelines._imports import PACKAGE_DATA, ROOT, has_code, needed_files
from pipelines._params import Params, read_yaml, sections_of

CODE = ("src/", "pipelines/")
_STAGE = re.compile(r"  (\w+):$")
_CODE_LINE = re.compile(rf"      - ({'|'.join(CODE)})")


@cache
def _members(folder: Path) -> frozenset[Path]:
    code = {file for file in folder.rglob("*.py") if has_code(file)}
    return frozenset(code | {file for pattern in PACKAGE_DATA.values() for file in folder.rglob(pattern)})


def code_dependencies(stage: str) -> list[str]:
    """Return the stage's code dependencies as paths from the repository's root, sorted, its own module first."""
    needed = needed_files(stage)
    chosen = {_folder_or_file(file, needed) for file in needed}
    paths = sorted(path.relative_to(ROOT).as_posix() for path in chosen)
    own = f"pipelines/{stage}.py"
    return [own, *(path for path in paths if path != own)]


def _folder_or_file(file: Path, needed: set[Path]) -> Path:
    """Return the outermost folder around `file` of whose files at least half is needed, or the file."""
    packages = (ROOT / "src/pentimento", ROOT / "pipelines")
    above = [folder for folder in file.parents if any(folder.is_relative_to(p) and folder != p for p in packages)]
    mostly = [folder for folder in above if 2 * len(_members(folder) & needed) >= len(_members(folder))]
    return mostly[-1] if mostly else file


def with_dependencies(text: str, params: Params) -> str:
    """Return dvc.yaml's text with all that this module writes; `params` is params.yaml, presets unresolved."""
    lines: list[str] = []
    stage = ""
    for line in text.splitlines():
        if match := _STAGE.fullmatch(line):
            stage = match[1]
        if _CODE_LINE.match(line):
            continue
        if line.startswith("    params: [") and stage in params:
            line = f"    params: [{', '.join(sections_of(stage, params))}]"
        lines.append(line)
        if line == "    deps:":
            lines += [f"      - {path}" for path in code_dependencies(stage)]
    return with_listed_paths("\n".join(lines) + "\n")


def main() -> None:
    file = ROOT / "dvc.yaml"
    text = with_dependencies(file.read_text(encoding="utf-8"), read_yaml(ROOT / "params.yaml"))
    file.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
