"""What a file of the project imports, read from its syntax tree: imports inside functions count too."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "src/pentimento").rglob("*.py"))
PIPELINES = sorted((ROOT / "pipelines").rglob("*.py"))
# Package data that is read when any code of the package runs: pattern by package of src/pentimento.
PACKAGE_DATA = {"studio": "*.toml", "robots": "*.toml", "rating": "*.toml"}
TEMPLATES = ROOT / "src/pentimento/report/templates"
_TEMPLATE_NAME = re.compile(r'"(?:templates/)?([\w/]+\.(?:html|css))"')


@cache
def has_code(file: Path) -> bool:
    """Tell whether a file holds more than a docstring and names such as `__version__`."""
    return any(
        not isinstance(node, ast.Expr)
        and not (isinstance(node, ast.Assign) and ast.unparse(node.targets[0]).startswith("__"))
        for node in ast.parse(file.read_text(encoding="utf-8")).body
    )


@cache
def imported_names(file: Path) -> frozenset[str]:
    """Return dotted names: `import a.b` gives a.b, `from a import b` gives a and a.b (b may be a module)."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"), str(file))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module, f"{file} has a relative import; write the full name"
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


@cache
def project_files(name: str) -> frozenset[Path]:
    """Return the files that Python runs to import the project's module `name`, packages first."""
    top = {"pentimento": ROOT / "src", "pipelines": ROOT}.get(name.partition(".")[0])
    if top is None:
        return frozenset()
    parts = name.split(".")
    files = {top.joinpath(*parts[:depth], "__init__.py") for depth in range(1, len(parts) + 1)}
    files.add(top.joinpath(*parts).with_suffix(".py"))
    return frozenset(file for file in files if file.is_file())


def import_closure(file: Path) -> set[Path]:
    """Return every project file that running `file` may execute, itself included."""
    closure: set[Path] = set()
    waiting = {file}
    while waiting:
        current = waiting.pop()
        closure.add(current)
        waiting |= set().union(*map(project_files, imported_names(current))) - closure
    return closure


def needed_files(stage: str) -> set[Path]:
    """Return the project files that the stage executes or reads as package data."""
    files = {file for file in import_closure(ROOT / f"pipelines/{stage}.py") if has_code(file)}
    for package, pattern in PACKAGE_DATA.items():
        folder = ROOT / "src/pentimento" / package
        if any(file.is_relative_to(folder) for file in files):
            files |= set(folder.rglob(pattern))
    return files | named_templates(files)


def named_templates(files: set[Path]) -> set[Path]:
    """Return the page templates that the files name in double quotes, and those that these templates name."""
    names = {name for file in files for name in _TEMPLATE_NAME.findall(file.read_text(encoding="utf-8"))}
    found = {TEMPLATES / name for name in names if (TEMPLATES / name).is_file()}
    return found if found <= files else found | named_templates(files | found)
