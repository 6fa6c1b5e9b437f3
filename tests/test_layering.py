"""Dependencies point one way: pipelines → workshop → lean core → contracts (the linter sees a part)."""

import ast
from pathlib import Path

import pytest

from pipelines._imports import PIPELINES, ROOT, SOURCES, imported_names

HEAVY = {
    "accelerate",
    "dask",
    "datasets",
    "diffusers",
    "dvc",
    "jinja2",
    "lightning",
    "matplotlib",
    "mlflow",
    "pandas",
    "peft",
}
HEAVY |= {
    "pydantic",
    "pytorch_lightning",
    "rich",
    "skimage",
    "sklearn",
    "torch",
    "transformers",
    "trimesh",
}
TRACKING = {"mlflow", "dvc"}

LEAN = {
    "contracts",
    "render",
    "studio",
    "robots",
    "planning",
    "bundle",
    "control",
    "calibration",
    "collection",
    "sound",
    "goals3d",
    "svg",
}
WORKSHOP = {
    "dynamics",
    "diagnosis",
    "semantics",
    "copainting",
    "handwriting",
    "deploy",
    "report",
    "hearing",
    "rating",
}
# A model must not look at the hidden truth: no part of the workshop knows the studio.
ALLOWED = {
    "contracts": set(),
    "svg": {"contracts"},
    "render": {"contracts"},
    "studio": {"contracts"},
    "robots": {"contracts", "studio", "control"},  # studio: the virtual robot alone; control: safety alone
    "planning": {"contracts", "render", "robots"},
    "goals3d": {"contracts", "planning"},
    **{package: LEAN - {"studio"} for package in ("bundle", "control", "calibration", "collection", "sound")},
    **{package: (LEAN - {"studio"}) | WORKSHOP for package in WORKSHOP},
    "io": (LEAN - {"studio"}) | WORKSHOP,
    "cli": LEAN | WORKSHOP | {"io"},
}


def package(file: Path) -> str:
    """Return the package of src/pentimento that a file belongs to (a module at its top is its own)."""
    return file.relative_to(ROOT / "src/pentimento").parts[0].removesuffix(".py")


def packages_imported(file: Path) -> set[str]:
    parts = [name.split(".") for name in imported_names(file)]
    return {part[1] for part in parts if part[0] == "pentimento" and len(part) > 1}


def top_names(file: Path) -> set[str]:
    return {name.partition(".")[0] for name in imported_names(file)}


def identify(file: Path) -> str:
    return str(file.relative_to(ROOT))


MODULES = [file for file in SOURCES if file.parent.name != "pentimento" or file.name == "cli/main.py"]


@pytest.mark.parametrize("file", MODULES, ids=identify)
def test_a_package_imports_only_packages_below_it(file: Path) -> None:
    own = package(file)
    assert own in ALLOWED, f"{own} has no layer; say in ALLOWED what it may import"
    assert packages_imported(file) - {own} <= ALLOWED[own]


@pytest.mark.parametrize("file", [file for file in SOURCES if package(file) not in WORKSHOP | {"cli"}], ids=identify)
def test_the_lean_core_imports_no_heavy_library(file: Path) -> None:
    assert not top_names(file) & HEAVY


@pytest.mark.parametrize("file", SOURCES, ids=identify)
def test_science_knows_neither_pipelines_nor_tracking(file: Path) -> None:
    assert not top_names(file) & (TRACKING | {"pipelines"})


def test_only_tracking_and_review_know_mlflow() -> None:
    knowing = {file.parent.name for file in PIPELINES if "mlflow" in top_names(file)}
    assert knowing == {"_tracking", "_review"}


def test_in_robots_only_the_virtual_robots_know_the_studio_and_all_know_only_safety_of_control() -> None:
    for file in (ROOT / "src/pentimento/robots").rglob("*.py"):
        control = {name for name in imported_names(file) if name.startswith("pentimento.control.")}
        assert all(name.startswith("pentimento.control.safety") for name in control), file
        assert "studio" not in packages_imported(file) or file.name == "virtual.py", file


def test_only_the_studio_opens_world_files() -> None:
    for file in [*SOURCES, *PIPELINES]:
        if package_or_pipeline(file) == "studio":
            continue
        texts = {text for text in code_texts(file) if "worlds" in Path(text).parts}
        assert not texts, f"{file} names world files: {texts}"


def package_or_pipeline(file: Path) -> str:
    return "pipelines" if file in PIPELINES else package(file)


def code_texts(file: Path) -> set[str]:
    """Return the string constants of a file, without docstrings."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    constants = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in docstrings]
    return {node.value for node in constants if isinstance(node.value, str)}
