"""Parses a stage's section of params.yaml into the stage's frozen config dataclass.

Every field of the dataclass must be in the file, and every key in the file must be a field: defaults are in params.yaml
only. An entry of a list may leave out fields that have a default. Lengths, times, angles, speeds and resolutions may
have a unit: a text for a field whose name ends in `_m`, `_s`, `_rad`, `_m_s`, `_m_s2` or `pixels_per_m` is parsed, e.g.
`press_m: 2 mm`, `pixels_per_m: 5 px/mm`.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, TypeAdapter, ValidationError

from pentimento.contracts.errors import ConfigError, UnitError
from pentimento.contracts.units import parse_quantity
from pipelines._params import read_params

T = TypeVar("T")

_UNIT_OF_SUFFIX = {
    "pixels_per_m": "px/m", "_m_s2": "m/s^2", "_m_s": "m/s", "_rad": "rad", "_m": "m", "_s": "s",
}  # longest first  # fmt: skip
_STRICT = ConfigDict(strict=True, allow_inf_nan=False)


def load_section(params_path: Path, section: str, config_type: type[T]) -> T:
    """Read `section` of the YAML file into `config_type`, a frozen dataclass that may hold others.

    Raises `ConfigError` with the file, `section.key`, the value found and what is expected.
    """
    document = read_params(params_path)
    if section not in document:
        raise ConfigError(f"{params_path} has no section {section!r}; add it, or take it from the repository.")
    try:
        config: T = _build(document[section], config_type, section)
    except ConfigError as error:
        raise ConfigError(f"{params_path}: {error}") from None
    return config


def entry_of(entries: Mapping[str, T], name: str, key: str) -> T:
    """Return the entry `name` of the mapping `key` of params.yaml; `name` is a tool or setting of the command line."""
    if name not in entries:
        known = ", ".join(entries) or "none"
        raise ConfigError(f"params.yaml: {key} has no entry {name!r}; known are {known}. Add it.")
    return entries[name]


def require_model(key: str, tool: str, tools: Sequence[str]) -> None:
    """Raise `ConfigError` unless dvc.yaml gives the stage a model of the tool that `key` of params.yaml names."""
    if tool not in tools:
        raise ConfigError(
            f"params.yaml: {key} is {tool!r}, but dvc.yaml hands the stage models of {', '.join(tools)} only: choose "
            "one of them, or add that model to the stage."
        )


def shipped(source: str | None, base: Path | None, part: str) -> Path | None:
    """Return the folder or name of a published model; `base` names a part of the base that ships, in the folder `base`.

    Raises `ConfigError` if the stage was not given that folder.
    """
    if source != "base":
        return None if source is None else Path(source)
    if base is None:
        raise ConfigError(f"params.yaml asks for {part} of the base that ships, but the stage has no --base; add it.")
    return base / part


def _build(value: Any, kind: Any, key: str) -> Any:
    """Convert the YAML value at `key` to the type `kind`."""
    if isinstance(kind, type) and is_dataclass(kind):
        return _build_dataclass(value, kind, key)
    arguments = get_args(kind)
    if get_origin(kind) in (Union, UnionType) and any(is_dataclass(part) for part in arguments):
        if value is None and type(None) in arguments:
            return None
        return _build(value, next(part for part in arguments if is_dataclass(part)), key)
    if get_origin(kind) in (dict, Mapping) and is_dataclass(arguments[1]):
        _require_mapping(value, key)
        return {name: _build(entry, arguments[1], f"{key}.{name}") for name, entry in value.items()}
    listed = get_origin(kind)
    if listed in (tuple, list) and is_dataclass(arguments[0]) and isinstance(value, list):
        defaults = {field.name: field.default for field in fields(arguments[0]) if field.default is not MISSING}
        full = [defaults | entry if isinstance(entry, dict) else entry for entry in value]
        return listed(_build(entry, arguments[0], f"{key}[{index}]") for index, entry in enumerate(full))
    return _build_plain(value, kind, key)


def _build_dataclass(value: Any, kind: type, key: str) -> Any:
    _require_mapping(value, key)
    kinds = get_type_hints(kind)
    names = [field.name for field in fields(kind)]
    for name in value:
        if name not in names:
            close = get_close_matches(str(name), names, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(names)}."
            raise ConfigError(f"{key}.{name} is not a parameter; {hint}")
    for name in names:
        if name not in value:
            raise ConfigError(f"{key}.{name} is missing; add it ({_type_name(kinds[name])}).")
    entries = {name: _build(value[name], kinds[name], f"{key}.{name}") for name in names}
    try:
        return kind(**entries)
    except ValueError as error:  # the dataclass checks its own ranges
        raise ConfigError(f"{key}: {error}") from None


def _build_plain(value: Any, kind: Any, key: str) -> Any:
    unit = next((unit for suffix, unit in _UNIT_OF_SUFFIX.items() if key.endswith(suffix)), None)
    if unit is not None and kind is not str and not _is_word(value, kind):
        value = _parse_quantities(value, unit, key)
    adapter = TypeAdapter(kind, config=_STRICT)
    try:
        # Through JSON, a list may become a tuple and 1 may become 1.0, but "1" stays a text.
        return adapter.validate_json(json.dumps(value))
    except TypeError:
        raise ConfigError(f"{key} is {_found(value)}, expected {_type_name(kind)}.") from None
    except ValidationError as error:
        first = error.errors()[0]
        if not first["msg"].startswith("Input should be "):  # such as a tuple of another length
            raise ConfigError(f"{key} is {_found(value)}, expected {_type_name(kind)}.") from None
        place = "".join(f"[{part}]" for part in first["loc"] if isinstance(part, int))
        expected = " or ".join(
            dict.fromkeys(each["msg"].removeprefix("Input should be ") for each in error.errors())
            if get_origin(kind) in (Union, UnionType)
            else [first["msg"].removeprefix("Input should be ")]
        )
        raise ConfigError(f"{key}{place} is {_found(first['input'])}, expected {expected}.") from None


def _is_word(value: Any, kind: Any) -> bool:
    """Whether the value is a word that a field such as `float | Literal["auto"]` allows in place of a number."""
    return any(get_origin(part) is Literal and value in get_args(part) for part in get_args(kind))


def _parse_quantities(value: Any, unit: str, key: str) -> Any:
    if isinstance(value, list):
        return [_parse_quantities(entry, unit, key) for entry in value]
    if not isinstance(value, str):
        return value
    try:
        return parse_quantity(value, unit)
    except UnitError as error:
        raise ConfigError(f"{key}: {error}") from None


def _require_mapping(value: Any, key: str) -> None:
    if not isinstance(value, dict):
        raise ConfigError(f"{key} is {_found(value)}, expected indented `key: value` lines.")


def _found(value: Any) -> str:
    return "empty" if value is None else repr(value)


def _type_name(kind: Any) -> str:
    return kind.__name__ if isinstance(kind, type) and not get_args(kind) else str(kind).replace("typing.", "")
