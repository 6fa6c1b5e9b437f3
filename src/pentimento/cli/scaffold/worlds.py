"""The studio's hidden truth of what is new: where it lies, and what another's is under a new name."""

from __future__ import annotations

from pathlib import Path

from pentimento.contracts.errors import ConfigError

_PACKAGE = Path(__file__).resolve().parents[2]


def world_file(root: Path, worlds: Path, name: str) -> Path:
    """Where a world lies in the project in ``root``; ``worlds`` is the folder of such worlds in this package."""
    return root / "src" / worlds.relative_to(_PACKAGE.parent) / f"{name}.toml"


def world_like(table: str, base: str, like: str, name: str) -> str:
    """The truth of ``like``, by reference to the world ``base``: nothing is made up. ``table`` names what it is of."""
    return (
        f"# {name} in the studio: as {like}. Change here what it really is; the robot is never told.\n"
        f'base = "{base}.toml"\n\n[{table}]\nname = "{name}"\n'
    )


def text_of(path: Path) -> str:
    """What a given file says.

    Raises ConfigError where it is no text, OSError where it cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is not UTF-8 text; save it as plain text.") from error


def check_said(what: str, said: str, name: str) -> None:
    """Raise ConfigError where a file (``what``) is of another thing than the new one."""
    if said != name:
        raise ConfigError(f'The {what} is that of {said}; write name = "{name}" into it. Nothing was changed.')
