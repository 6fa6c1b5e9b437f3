"""Pages of the site that are no Markdown in `docs/`: the README, the tutorials, and the reference from docstrings."""

from __future__ import annotations

import ast
import posixpath
import re
from pathlib import Path
from typing import Any, Final

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from docs.site import tutorials

ROOT: Final = Path(__file__).parents[2]
_OUTSIDE: Final = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
}
"""Files outside of `docs/` and their pages."""
_REFERENCE: Final = {
    "render": ("The renderer", ("pentimento.render.kernel", "pentimento.render.strokes")),
    "diagnosis": (
        "Diagnosis",
        ("pentimento.diagnosis.problem", "pentimento.diagnosis.simulator", "pentimento.diagnosis.diagnose"),
    ),
    "robots": ("Robots", ("pentimento.robots.driver", "pentimento.robots.machine", "pentimento.robots.scanner")),
    "contracts": ("Contracts", ("pentimento.contracts.strokes", "pentimento.contracts.pushes")),
}
"""By page: its title and the modules whose docstrings it holds."""
_LINK: Final = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#:]+)(#[^)\s]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made here."""
    for source, page in _OUTSIDE.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=_relinked(text, "")))
    for page, (title, modules) in _REFERENCE.items():
        text = "\n\n".join([f"# {title}", *(f"::: {module}" for module in modules)])
        files.append(File.generated(config, f"reference/{page}.md", content=text))
    files.append(File.generated(config, "reference/params.md", content=_params()))
    for name in tutorials.names():
        files.append(File.generated(config, f"tutorials/{name}.md", content=tutorials.page(name)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Point links between files of the repository at their pages."""
    return markdown if page.file.generated_by else _relinked(markdown, "docs")


def _relinked(text: str, folder: str) -> str:
    """Markdown of a file in a folder of the repository with links to pages; a link to no page becomes its words."""

    def page_of(match: re.Match[str]) -> str:
        picture, words, target, anchor = match[1], match[2], match[3], match[4] or ""
        place = posixpath.normpath(posixpath.join(folder, target))
        if place.startswith("docs/") and (ROOT / place).is_file():
            page = re.sub(r"^docs/(tutorials/\w+)\.py$", r"docs/\1.md", place).removeprefix("docs/")
            return f"{picture}[{words}]({page}{anchor})"
        if place in _OUTSIDE:
            return f"{picture}[{words}]({_OUTSIDE[place]}{anchor})"
        return words

    return _LINK.sub(page_of, text)


def _params() -> str:
    """The reference of params.yaml: the dataclass of each stage's section."""
    found = []
    for file in sorted((ROOT / "pipelines").glob("*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        imported = {
            name.name: node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for name in node.names
        }
        for call in ast.walk(tree):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "load_section":
                section, config = call.args[1:]
                if isinstance(section, ast.Constant) and isinstance(config, ast.Name):
                    module = imported.get(config.id, f"pipelines.{file.stem}")
                    found.append(f"## {section.value}\n\n::: {module}.{config.id}\n    options: {{heading_level: 3}}")
    return "\n\n".join(["# Parameters", "Each section of `params.yaml` is read into a dataclass.", *found])
