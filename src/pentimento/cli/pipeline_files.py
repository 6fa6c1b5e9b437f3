"""dvc.yaml and params.yaml, edited as text, so that comments and layout stay as they are.

Tools, settings and materials are lists in dvc.yaml, one line each under `vars`. A comment `# each LIST: PATTERN...`
stands above the paths that are written for each name of the list, with the name in place of `{}`; after
`# each LIST as: LINE`, a whole line is.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ConfigError

_EACH = re.compile(r"( *)# each (\w+)( as)?: (.+)")


def names_in(text: str, name: str) -> list[str]:
    """Return the names in a list of dvc.yaml's `vars`.

    Raises ConfigError where there is no such list.
    """
    return re.findall(r"\w+", _line(text, name)[2])


def with_name(text: str, name: str, new: str) -> str:
    """Return dvc.yaml's text with a name added at the end of a list, and its paths written again."""
    line = _line(text, name)
    return with_listed_paths(f"{text[: line.end(2)]}, {new}{text[line.end(2) :]}")


def with_listed_paths(text: str) -> str:
    """Return dvc.yaml's text with the lines under every `# each` comment written again."""
    lines: list[str] = []
    stale: re.Pattern[str] | None = None  # lines below the last comment that an earlier run wrote
    for line in text.splitlines():
        if stale is not None and stale.fullmatch(line):
            continue
        stale = None
        lines.append(line)
        if (each := _EACH.fullmatch(line)) is not None:
            indent = each[1]
            patterns = [each[4]] if each[3] else [f"- {path}" for path in each[4].split()]
            stale = re.compile(" *(?:{})".format("|".join(re.escape(p).replace(r"\{\}", r"\w+") for p in patterns)))
            listed = names_in(text, each[2])
            lines += [indent + pattern.replace("{}", name) for pattern in patterns for name in listed]
    return "\n".join(lines) + "\n"


def _line(text: str, name: str) -> re.Match[str]:
    found = re.search(rf"(?m)^  - ({re.escape(name)}): [^\[\n]*\[([^\]\n]*)\]", text)
    if found is None:
        raise ConfigError(f"dvc.yaml has no list {name!r} under vars; take the file from the repository.")
    return found


class ProjectFiles:
    """dvc.yaml and params.yaml of a project."""

    def __init__(self, root: Path) -> None:
        """Read both files of the project in `root`; raises ConfigError where one is missing."""
        self.root = root
        self.dvc, self.params = (text_of(self._existing(name)) for name in ("dvc.yaml", "params.yaml"))

    def _existing(self, name: str) -> Path:
        if not (self.root / name).is_file():
            raise ConfigError(f"{self.root / name} does not exist; run this in the root of the project's folder.")
        return self.root / name

    def contents(self) -> dict[Path, str]:
        """Path and text of each file, as they are to be written."""
        return {self.root / "params.yaml": self.params, self.root / "dvc.yaml": self.dvc}

    def parsed(self, *keys: str) -> Any:
        """The mapping of params.yaml under the keys."""
        return _mapping(self.params, self.root / "params.yaml", *keys)

    def stages_for(self, listed: str) -> list[str]:
        """The stages of dvc.yaml that run for each name of a list."""
        stages = _mapping(self.dvc, self.root / "dvc.yaml", "stages")
        return [
            name for name, stage in stages.items() if f"${{{listed}}}" in (stage.get("matrix") or {}).values()
        ]  # fmt: skip

    def add_name(self, listed: str, name: str) -> None:
        """Add a name at the end of a list of dvc.yaml."""
        self.dvc = with_name(self.dvc, listed, name)

    def add_entry(self, section: str, key: str, entry: str) -> None:
        """Insert an entry as the first one of the mapping `section.key` of params.yaml."""
        header = re.search(rf"(?m)^{section}:\n(?:(?:[ #].*)?\n)*?  {key}:(?P<flow> \{{(?P<end>\}})?|\n)", self.params)
        if header is None:
            raise ConfigError(f"params.yaml has no section {section}.{key}; take the file from the repository.")
        if header["flow"] == "\n":
            inserted, at = f"    {entry}\n", header.end()
        else:
            inserted, at = entry + ("" if header["end"] else ", "), header.start("flow") + len(" {")
        self.params = self.params[:at] + inserted + self.params[at:]

    def set_source(self, stage: str, name: str, source: Path | None) -> None:
        """Let a stage read a measured table instead of collecting in the studio."""
        if source is None:
            return
        if not (self.root / source).exists():
            raise ConfigError(
                f"--source: {self.root / source} does not exist; give a Parquet file or a folder of shards."
            )
        self.add_entry(stage, "source", f"{name}: {source}")


def text_of(path: Path) -> str:
    """Return the text of a file; raises ConfigError where it is not UTF-8."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is not UTF-8 text; save it as plain text.") from error


def _mapping(text: str, path: Path, *keys: str) -> Any:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        found: Any = YAML(typ="safe").load(text)
    except YAMLError as error:
        raise ConfigError(f"{path} is not readable as YAML: {' '.join(str(error).split())}; correct it.") from None
    for key in keys:
        found = found.get(key) if isinstance(found, dict) else None
    if not isinstance(found, dict):
        raise ConfigError(f"{path} has no section {'.'.join(keys)}; take the file from the repository.")
    return found
