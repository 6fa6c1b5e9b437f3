"""`make deps`: write into dvc.yaml, and into the pipelines of profiles, what follows from other files.

    python -m pipelines._deps

Written are each stage's code dependencies (what its module imports), its sections of params.yaml (its own and those of
its presets), and the paths that stand there for each tool, setting or material. A folder stands for its files where the
stage needs half of them or more. Files and folders that a stage's sections name stand there with a comment: DVC then
notices that one has changed. All other dependencies are kept by hand.
"""

import json
import re
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

from ruamel.yaml import YAML

from pentimento.cli.pipeline_files import with_listed_paths
from pentimento.contracts.atomic import atomic_write
from pipelines._imports import PACKAGE_DATA, ROOT, has_code, needed_files
from pipelines._params import Params, files_named_by, merge, read_yaml, sections_of

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


NAMED = "  # named in params.yaml"


def with_named_files(text: str, params: Params, root: Path) -> str:
    """Return dvc.yaml's text with the files below `root` that each stage's sections of params.yaml name.

    What the stage depends on anyway, or writes itself, is left out.
    """
    plain = "\n".join(line for line in text.splitlines() if not line.endswith(NAMED)) + "\n"
    stages = YAML(typ="safe").load(plain).get("stages", {})
    lines: list[str] = []
    stage = ""
    for line in plain.splitlines():
        lines.append(line)
        if match := _STAGE.fullmatch(line):
            stage = match[1]
        if line == "    deps:" and stage in params:
            known = {str(path) for path in stages[stage]["deps"]}
            made = [re.sub(r"\$\{.*?\}", "*", out) for out in stages[stage].get("outs", []) if isinstance(out, str)]
            for path in files_named_by(stage, params, root):
                if path not in known and not any(fnmatch(f"{path}/", f"{out}/*") for out in made):
                    lines.append(f"      - {json.dumps(path, ensure_ascii=False)}{NAMED}")
    return "\n".join(lines) + "\n"


def name_files(root: Path) -> bool:
    """Write the files that params.yaml names into dvc.yaml; return whether that changed anything."""
    file = root / "dvc.yaml"
    text = file.read_text(encoding="utf-8")
    new = with_named_files(text, read_yaml(root / "params.yaml"), root)
    if new != text:
        atomic_write(file, new.encode())
    return new != text


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
    return with_named_files(with_listed_paths("\n".join(lines) + "\n"), params, ROOT)


def pipelines() -> dict[Path, Params]:
    """Return dvc.yaml and the pipeline.yaml of each profile that has one, with its params.yaml, presets unresolved."""
    params = read_yaml(ROOT / "params.yaml")
    found = {ROOT / "dvc.yaml": params}
    for file in sorted((ROOT / "profiles").glob("*/pipeline.yaml")):
        profile = file.parent.with_suffix(".yaml")
        found[file] = merge(params, read_yaml(profile), profile.relative_to(ROOT))
    return found


def main() -> None:
    for file, params in pipelines().items():
        text = with_dependencies(file.read_text(encoding="utf-8"), params)
        file.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
