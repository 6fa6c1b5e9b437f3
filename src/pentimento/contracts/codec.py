"""One codec for everything that is stored as text: JSON, TOML and parameters become frozen dataclasses, and back.

msgspec checks the types. On top of that every key of a dataclass must be present (fields with a default included), no
key may be unknown, and every number is finite. Files for people write quantities with their unit: see ``from_table``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from tomllib import TOMLDecodeError, loads
from types import NoneType, UnionType
from typing import Any, Final, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from pentimento.contracts.errors import ConfigError, ContractError, PentimentoError, UnitError
from pentimento.contracts.units import parse_quantity

T = TypeVar("T")

_TYPE_NAMES: Final = {
    "int": "a whole number",
    "float": "a finite number",
    "str": "a text",
    "bool": "true or false",
    "object": "a mapping",
    "array": "a list",
    "null": "null",
}
_UNIT_OF_SUFFIX: Final = {"_m_s2": "m/s^2", "_m_s": "m/s", "_rad": "rad", "_m": "m", "_s": "s"}  # longest first


def to_plain(value: Any) -> Any:
    """Mappings, lists, numbers and texts of a dataclass, or of a mapping or sequence of such: what JSON can hold."""
    return msgspec.to_builtins(value, enc_hook=_encoded)


def from_plain(kind: type[T], value: Any, where: str, error: type[PentimentoError] = ContractError) -> T:
    """The dataclass ``kind`` of which ``to_plain`` gave ``value``.

    Args:
        where: names the value in messages: a file, or a section of it.

    Raises:
        error: a key is missing or unknown, a value has another type or is not finite, or the dataclass rejects its
            values by a ValueError.
    """
    try:
        built = msgspec.convert(value, kind, strict=True)
    except msgspec.ValidationError as fault:
        raise error(_message(str(fault), kind, value, where)) from fault
    _check_tree(value, msgspec.to_builtins(built), where, error)
    return built


def from_table(kind: type[T], table: Any, where: str) -> T:
    """The dataclass ``kind`` of a TOML table whose quantities carry their units.

    A field with a unit's suffix has the key without it and a text: field ``speed_m_s`` is ``speed = "60 mm/s"``. A list
    holds one text for each quantity. Keys of fields that have a default may be absent.

    Raises:
        ConfigError: as ``from_plain``; and a quantity without its unit, or with one of another dimension.
    """
    return from_plain(kind, _in_si(kind, table, where), where, ConfigError)


def find_toml(name_or_path: str | Path, folder: Path, what: str) -> Path:
    """The path that was given where it ends in .toml, else the file of that name in a folder of shipped files.

    Args:
        what: which kind of file it is, for messages, such as "tool".

    Raises:
        ConfigError: there is no such file.
    """
    path, known = Path(name_or_path), ", ".join(sorted(file.stem for file in folder.glob("*.toml")))
    shipped = folder / f"{name_or_path}.toml"
    if path.suffix == ".toml" and not path.is_file():
        raise ConfigError(f"The {what} file {path} does not exist; give a .toml file or one of: {known}.")
    if path.suffix != ".toml" and not (shipped.parent == folder and shipped.is_file()):
        raise ConfigError(
            f"There is no {what} named {str(name_or_path)!r}; choose one of: {known}, or give the path of a .toml file."
        )
    return path if path.suffix == ".toml" else shipped


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """The table in a TOML file; ``what`` as for ``find_toml``.

    Raises:
        ConfigError: the text is no TOML. OSError passes through.
    """
    try:
        return loads(path.read_bytes().decode())
    except (TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigError(f"The {what} file {path} is not valid TOML: {error}.") from error


def check_keys(table: Any, required: frozenset[str], optional: frozenset[str], where: str) -> None:
    """Raise ConfigError unless ``table`` is a mapping with all the required keys and no unknown ones."""
    if not isinstance(table, dict):
        raise ConfigError(f"{where} is {table!r}; write it as a table.")
    missing, unknown = sorted(required - table.keys()), sorted(table.keys() - required - optional)
    if missing or unknown:
        may = f" and may have {sorted(optional)}" if optional else ""
        raise ConfigError(f"{where}: {_key_faults(missing, unknown)}; it has {sorted(required)}{may}.")


def _key_faults(missing: Sequence[str], unknown: Sequence[str]) -> str:
    """What is wrong with a mapping's keys, in words; one of the lists may be empty."""
    faults = {"missing": missing, "unknown": unknown}
    return ", ".join(f"{fault} keys {list(keys)}" for fault, keys in faults.items() if keys)


def _encoded(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    raise NotImplementedError(f"{type(value).__name__} cannot be stored as text")


def _message(fault: str, kind: Any, value: Any, where: str) -> str:
    """msgspec's message, such as "Expected `int`, got `float` - at `$.rounds`", as a sentence with place and value."""
    problem, _, path = fault.partition(" - at `$")
    place, found, expected = where, value, kind
    for name, index in re.findall(r"\.(\w+)|\[(\d+|\.\.\.)\]", path):
        if index == "...":  # some value of a mapping: msgspec does not say which
            return _message_of_entry(_inner(expected, "value"), found, place)
        found = found[name or int(index)]
        place += f".{name}" if name else f"[{index}]"
        expected = _inner(expected, name)
    if problem.startswith("Object missing required field"):
        present, known = set(found), {field.name for field in fields(expected)}
        return f"{place}: {_key_faults(sorted(known - present), sorted(present - known))}."
    if problem.startswith("Invalid enum value") or get_origin(expected) is Literal:
        return f"{place} is {found!r}; it must be one of {list(get_args(expected))}."
    if match := re.match(r"Expected `([^`]+)`(?: of length (\d+))?", problem):
        names = " or ".join(_TYPE_NAMES.get(name, name) for name in match[1].split(" | "))
        return f"{place} is {found!r}; it must be {names}{f' of {match[2]}' if match[2] else ''}."
    return f"{place}: {problem}"


def _message_of_entry(kind: Any, values: Mapping[str, Any], where: str) -> str:
    """The message for the first value of a mapping that is no ``kind``."""
    for name, value in values.items():
        try:
            msgspec.convert(value, kind, strict=True)
        except msgspec.ValidationError as fault:
            return _message(str(fault), kind, value, f"{where}.{name}")
    raise AssertionError(f"msgspec rejected {where} and accepted each of its values")


def _inner(kind: Any, name: str) -> Any:
    """The type of a field, of a mapping's values or of a sequence's entries; a union's by its part that is not None."""
    if get_origin(kind) in (Union, UnionType):
        kind = next(part for part in get_args(kind) if part is not NoneType)
    if is_dataclass(kind):
        return _inner_union(get_type_hints(kind)[name])
    arguments = get_args(kind)
    return _inner_union(arguments[1] if name else arguments[0]) if arguments else Any


def _inner_union(kind: Any) -> Any:
    parts = [part for part in get_args(kind) if part is not NoneType]
    return parts[0] if get_origin(kind) in (Union, UnionType) and len(parts) == 1 else kind


def _check_tree(value: Any, built: Any, where: str, error: type[PentimentoError]) -> None:
    """Raise ``error`` where the value has other keys than what was built of it, or a number that is not finite."""
    if isinstance(built, dict):
        missing, unknown = sorted(built.keys() - value.keys()), sorted(value.keys() - built.keys())
        if missing or unknown:
            raise error(f"{where}: {_key_faults(missing, unknown)}.")
        for name, entry in built.items():
            _check_tree(value[name], entry, f"{where}.{name}", error)
    elif isinstance(built, list | tuple):
        for at, (stored, entry) in enumerate(zip(value, built, strict=True)):
            _check_tree(stored, entry, f"{where}[{at}]", error)
    elif isinstance(built, float) and not math.isfinite(built):
        raise error(f"{where} is {value!r}; it must be a finite number.")


def _in_si(kind: Any, table: Any, where: str) -> Any:
    """The table with the field names of ``kind`` as keys, quantities in SI, and defaults filled in."""
    keys = {field.name: _key_and_unit(field.name) for field in fields(kind)}
    defaults = {
        field.name: field.default if field.default_factory is MISSING else field.default_factory()
        for field in fields(kind)
        if field.default is not MISSING or field.default_factory is not MISSING
    }
    optional = frozenset(keys[name][0] for name in defaults)
    check_keys(table, frozenset(key for key, _ in keys.values()) - optional, optional, where)
    types = get_type_hints(kind)
    plain: dict[str, Any] = {}
    for name, (key, unit) in keys.items():
        inner = _inner_union(types[name])
        if key not in table:
            plain[name] = to_plain(defaults[name])
        elif is_dataclass(inner):
            plain[name] = _in_si(inner, table[key], f"[{key}] of {where}")
        else:
            plain[name] = table[key] if unit is None else quantities(table[key], unit, f"{where}: {key}")
    return plain


def quantities(value: Any, unit: str, where: str) -> Any:
    """A text such as "2 mm" in the SI unit ``unit``, or a list of such texts, or of such lists.

    Raises:
        ConfigError: a quantity without its unit, or with one of another dimension.
    """
    if isinstance(value, list):
        return [quantities(entry, unit, where) for entry in value]
    if not isinstance(value, str):
        raise ConfigError(f'{where} has {value!r}; write it with its unit, such as "2 {unit}".')
    try:
        return parse_quantity(value, unit)
    except UnitError as error:
        raise ConfigError(f"{where}: {error}") from error


def _key_and_unit(name: str) -> tuple[str, str | None]:
    for suffix, unit in _UNIT_OF_SUFFIX.items():
        if name.endswith(suffix):
            return name.removesuffix(suffix), unit
    return name, None
