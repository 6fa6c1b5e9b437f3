"""How world files (TOML) are read: sections of typed keys, and `base = "other.toml"` beside them."""

import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from pentimento.contracts.errors import ConfigError


def world_path(name_or_path: str | Path, worlds: Path) -> Path:
    """The world file of a name in the folder `worlds`, or the path that was given."""
    path = Path(name_or_path)
    return path if path.suffix == ".toml" else worlds / f"{name_or_path}.toml"


def read_sections(path: Path, worlds: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    """The sections of a world file over those of its base; `worlds` is the folder of the shipped ones.

    Raises ConfigError where a file is missing or not valid, is its own base, or has a key outside a section.
    """
    if path in seen:
        raise ConfigError(f"World file {path} is its own base; remove one `base` line from the circle.")
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        known = ", ".join(sorted(p.stem for p in worlds.glob("*.toml")))
        raise ConfigError(
            f"There is no world file {path}; give the path of a .toml file or one of: {known}."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigError(f"World file {path} is not valid TOML: {error}.") from error
    base = document.pop("base", None)
    if base is None:
        return document
    merged = read_sections(path.parent / base, worlds, (*seen, path))
    for key, section in document.items():
        if not isinstance(section, dict):
            raise ConfigError(f"World file {path} has a key '{key}' outside a section; move it into a [section].")
        merged[key] = {**merged.get(key, {}), **section}
    return merged


def parse_section(section_type: Any, section: Any, where: str) -> Any:
    """A section as a value of the dataclass `section_type`; raises ConfigError naming `where` and the key."""
    if not isinstance(section, dict):
        raise ConfigError(f"{where} is not a section; write its keys below a line [name].")
    types = get_type_hints(section_type)
    check_keys(section, {f.name: None for f in fields(section_type)}, where, "key")
    return section_type(**{key: _parse_value(types[key], section[key], f"'{key}' in {where}") for key in types})


def check_keys(given: dict[str, Any], expected: dict[str, Any], where: str, noun: str) -> None:
    """Raise ConfigError unless the two have the same keys."""
    if unknown := sorted(set(given) - set(expected)):
        raise ConfigError(f"Unknown {noun} {', '.join(unknown)} in {where}; known are: {', '.join(expected)}.")
    if missing := [key for key in expected if key not in given]:
        raise ConfigError(f"Missing {noun} {', '.join(missing)} in {where}; add it.")


def _parse_value(kind: Any, value: Any, where: str) -> Any:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Literal and value in arguments:
        return value
    if origin is tuple and isinstance(value, list) and len(value) == len(arguments):
        return tuple(_parse_value(k, v, where) for k, v in zip(arguments, value, strict=True))
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if kind in (int, str) and isinstance(value, kind) and not isinstance(value, bool):
        return value
    name = kind.__name__ if isinstance(kind, type) else str(kind)
    raise ConfigError(f"The value {value!r} of {where} is not a {name}; correct it.")
