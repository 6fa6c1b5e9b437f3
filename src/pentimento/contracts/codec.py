"""Frozen dataclasses as plain values (mappings, lists, numbers, texts) and back, with every key and type checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pentimento.contracts.errors import ContractError

T = TypeVar("T")


def to_plain(value: Any) -> Any:
    """What JSON can hold of a dataclass, a named tuple, or a mapping or sequence of such."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return {name: to_plain(entry) for name, entry in value._asdict().items()}
    if isinstance(value, Mapping):
        return {str(name): to_plain(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain(entry) for entry in value]
    return value


def from_plain(kind: type[T], value: Any, where: str) -> T:
    """The value of a type that ``to_plain`` gave: a frozen dataclass or named tuple, and all within it.

    Raises:
        ContractError: a key is missing or unknown, a value is of another type or not finite, or the type refuses it;
            ``where`` says which it is in.
    """
    built: T = _build(kind, value, where)
    return built


def _build(kind: Any, value: Any, where: str) -> Any:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        if type(value) in arguments:  # None, or one of several plain types
            return value
        return _build(next(part for part in arguments if part is not NoneType), value, where)
    if origin is Literal:
        _require(value in arguments, where, f"one of {list(arguments)}", value)
        return value
    if origin is tuple:
        _require(isinstance(value, list), where, "a list", value)
        parts = arguments[:1] * len(value) if arguments[-1] is Ellipsis else arguments
        _require(len(parts) == len(value), where, f"a list of {len(parts)}", value)
        pairs = enumerate(zip(parts, value, strict=True))
        return tuple(_build(part, entry, f"{where}[{at}]") for at, (part, entry) in pairs)
    if origin in (dict, Mapping):
        _require(isinstance(value, dict), where, "a mapping", value)
        return {name: _build(arguments[1], entry, f"{where}.{name}") for name, entry in value.items()}
    if is_dataclass(kind) or hasattr(kind, "_fields"):
        return _build_record(kind, value, where)
    return _number_or_text(kind, value, where)


def _build_record(kind: Any, value: Any, where: str) -> Any:
    _require(isinstance(value, dict), where, "a mapping", value)
    kinds = get_type_hints(kind)
    names = set(kind._fields) if hasattr(kind, "_fields") else {field.name for field in fields(kind)}
    if set(value) != names:
        missing, unknown = sorted(names - set(value)), sorted(set(value) - names)
        raise ContractError(f"{where}: missing are {missing or 'none'}, unknown are {unknown or 'none'}.")
    entries = {name: _build(kinds[name], value[name], f"{where}.{name}") for name in value}
    try:
        return kind(**entries)
    except ValueError as error:  # it checks its own ranges
        raise ContractError(f"{where}: {error}") from error


def _number_or_text(kind: Any, value: Any, where: str) -> Any:
    if kind is float:
        number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        _require(number, where, "a finite number", value)
        return float(value)
    _require(type(value) is kind, where, f"of type {kind.__name__}", value)
    return value


def _require(met: bool, where: str, what: str, value: Any) -> None:
    if not met:
        raise ContractError(f"{where} is {value!r}; it must be {what}.")
