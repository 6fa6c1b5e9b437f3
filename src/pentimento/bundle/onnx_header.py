"""The header of an ONNX file, read without a runtime: versions, operator domains, tensors, inputs and outputs.

A graph may come from an untrusted source, and a runtime opens what a graph refers to: other files (external data) and
operators of other domains (plug-ins). So a file is first parsed as plain protocol buffers, field by field. A file with
any field that is not known here is refused. The field numbers are those of onnx.proto (https://github.com/onnx/onnx).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import prod
from typing import Final, TypeAlias

from pentimento.contracts.errors import ContractError

Field: TypeAlias = "tuple[int, int | memoryview]"

_MAX_DEPTH: Final = 8  # of nested graphs, as of If and Loop
_ITEM_BYTES: Final = {1: 4, 2: 1, 3: 1, 4: 2, 5: 2, 6: 4, 7: 8, 9: 1, 10: 2, 11: 8, 12: 4, 13: 8, 16: 2}
"""By data type: float, (u)int8/16/32/64, bool, half, double, bfloat16. Strings and complex numbers are refused."""
_NUMBER: Final = re.compile(r"[0-9]{1,18}")
_TYPED_DATA: Final = (4, 5, 7, 10, 11)  # numbers stored one by one instead of as raw bytes


@dataclass(frozen=True)
class External:
    """Where a tensor lies that is stored beside the graph."""

    location: str
    """Name of the file, relative to the graph's."""
    offset: int
    length: int
    """Bytes; as many as the tensor's shape and type need."""


@dataclass
class Header:
    """The properties of a graph that are checked."""

    ir_version: int = 0
    opsets: dict[str, int] = field(default_factory=dict)
    """Version by domain; "" is ONNX's own."""
    inputs: dict[str, tuple[int | str, ...]] = field(default_factory=dict)
    """Shape by name, in order; a dynamic size is a name."""
    outputs: dict[str, tuple[int | str, ...]] = field(default_factory=dict)
    largest_tensor_bytes: int = 0
    """Size of the largest stored tensor."""
    external: list[External] = field(default_factory=list)
    """The tensors that are stored in other files."""


def read_header(data: bytes) -> Header:
    """The header of a file's content.

    Raises:
        ContractError: the content is not an ONNX model, or has functions, operators of other domains, sparse tensors,
            fields of a later version, or tensors whose size differs from their shape; or it says incompletely where a
            tensor in another file lies.
    """
    header = Header()
    graphs = 0
    for number, value in _fields(memoryview(data)):
        match number:
            case 1:
                header.ir_version = _whole(value)
            case 7:
                graphs += 1
                _read_graph(_message(value), header, 0)
            case 8:
                domain, version = "", 0
                for part, content in _fields(_message(value)):
                    if part == 1:
                        domain = _text(content)
                    elif part == 2:
                        version = _whole(content)
                    else:
                        _unknown("the operator set", part)
                header.opsets[domain] = version
            case 2 | 3 | 4 | 5 | 6 | 14:  # producer and documentation
                pass
            case _:
                _unknown("the model", number)
    if graphs != 1:
        raise ContractError(f"The file holds {graphs} graphs; an ONNX model has one.")
    return header


def _read_graph(graph: memoryview, header: Header, depth: int) -> None:
    if depth > _MAX_DEPTH:
        raise ContractError(f"Graphs are nested more than {_MAX_DEPTH} deep; this version supports no more.")
    for number, value in _fields(graph):
        match number:
            case 1:
                _read_node(_message(value), header, depth)
            case 5:
                _read_tensor(_message(value), header)
            case 11 | 12 if depth == 0:
                name, shape = _read_value(_message(value))
                (header.inputs if number == 11 else header.outputs)[name] = shape
            case 2 | 10 | 11 | 12 | 13 | 16:  # its name, documentation, and the types of inner values
                pass
            case _:
                _unknown("the graph", number)


def _read_node(node: memoryview, header: Header, depth: int) -> None:
    for number, value in _fields(node):
        match number:
            case 5:
                _read_attribute(_message(value), header, depth)
            case 7:
                if _text(value) not in ("", "ai.onnx"):
                    raise ContractError(
                        f"An operator is of the domain {_text(value)!r}; a graph may only use ONNX's own operators."
                    )
            case 1 | 2 | 3 | 4 | 6 | 9:
                pass
            case _:
                _unknown("an operator", number)


def _read_attribute(attribute: memoryview, header: Header, depth: int) -> None:
    for number, value in _fields(attribute):
        match number:
            case 5 | 10:
                _read_tensor(_message(value), header, within=True)
            case 6 | 11:
                _read_graph(_message(value), header, depth + 1)
            case 1 | 2 | 3 | 4 | 7 | 8 | 9 | 13 | 20:
                pass
            case _:
                _unknown("an attribute", number)


def _read_tensor(tensor: memoryview, header: Header, *, within: bool = False) -> None:
    """Check a tensor; one `within` an operator cannot lie in another file."""
    dims: list[int] = []
    kind, raw, typed, external = 0, None, False, False
    place: dict[str, str] = {}
    for number, value in _fields(tensor):
        match number:
            case 1:
                dims += _whole_numbers(value)
            case 2:
                kind = _whole(value)
            case 9:
                raw = _message(value)
            case 13:
                key, told = _read_entry(_message(value))
                if key in place:
                    raise ContractError(f"A tensor in another file has two entries {key!r}.")
                place[key] = told
            case 14:
                external = _whole(value) != 0
            case 8 | 12 | 16:
                pass
            case _ if number in _TYPED_DATA:
                typed = True
            case _:
                _unknown("a tensor", number)
    if kind not in _ITEM_BYTES or any(size < 0 or size >= 2**63 for size in dims):
        raise ContractError(f"A tensor has the data type {kind} and the shape {dims}, which are not supported.")
    size = prod(dims) * _ITEM_BYTES[kind]
    header.largest_tensor_bytes = max(header.largest_tensor_bytes, size)
    if external or place:
        if within or typed or raw is not None or not external:
            raise ContractError("A tensor is said to be in another file and in the graph; export the graph again.")
        header.external.append(_external(place, size))
    elif not typed and (0 if raw is None else len(raw)) != size:
        raise ContractError(
            f"A tensor of the shape {dims} needs {size} bytes and has {0 if raw is None else len(raw)}."
        )


def _read_entry(entry: memoryview) -> tuple[str, str]:
    key, told = "", ""
    for number, value in _fields(entry):
        if number == 1:
            key = _text(value)
        elif number == 2:
            told = _text(value)
        else:
            _unknown("an entry of a tensor in another file", number)
    return key, told


def _external(place: dict[str, str], size: int) -> External:
    """Where a tensor of this number of bytes lies."""
    numbers = [place.get(key, "") for key in ("offset", "length")]
    if place.keys() != {"location", "offset", "length"} or not all(_NUMBER.fullmatch(text) for text in numbers):
        raise ContractError(f"A tensor in another file has the entries {place}; it needs location, offset and length.")
    offset, length = map(int, numbers)
    if length != size:
        raise ContractError(f"A tensor in another file needs {size} bytes, and {length} are named.")
    return External(place["location"], offset, length)


def _read_value(value_info: memoryview) -> tuple[str, tuple[int | str, ...]]:
    name, shape = "", tuple[int | str, ...]()
    for number, value in _fields(value_info):
        if number == 1:
            name = _text(value)
        elif number == 2:
            for kind, content in _fields(_message(value)):
                if kind != 1:
                    raise ContractError(f"The value {name!r} is not a tensor; all inputs and outputs must be.")
                shape = _read_shape(_message(content))
    return name, shape


def _read_shape(tensor_type: memoryview) -> tuple[int | str, ...]:
    sizes: list[int | str] = []
    for number, value in _fields(tensor_type):
        if number == 2:
            for _, dimension in _fields(_message(value)):
                size: int | str = ""
                for part, content in _fields(_message(dimension)):
                    if part in (1, 2):
                        size = _whole(content) if part == 1 else _text(content)
                sizes.append(size)
    return tuple(sizes)


def _fields(message: memoryview) -> Iterator[Field]:
    """Number and content of each field, in order."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        match key & 7:
            case 0:
                value, at = _varint(message, at)
                yield key >> 3, value
                continue
            case 1:
                length = 8
            case 2:
                length, at = _varint(message, at)
            case 5:
                length = 4
            case _:
                raise ContractError("The file is no ONNX model: it is not a protocol buffer.")
        if at + length > len(message):
            raise ContractError("The file is no whole ONNX model: it ends in the middle of a field.")
        yield key >> 3, message[at : at + length]
        at += length


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            break
        byte = message[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
    raise ContractError("The file is no ONNX model: a number in it does not end.")


def _whole_numbers(value: int | memoryview) -> list[int]:
    """One number, or several that are packed into bytes."""
    if isinstance(value, int):
        return [value]
    numbers, at = [], 0
    while at < len(value):
        number, at = _varint(value, at)
        numbers.append(number)
    return numbers


def _whole(value: int | memoryview) -> int:
    if not isinstance(value, int):
        raise ContractError("The file is no ONNX model: bytes stand where a number belongs.")
    return value


def _message(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise ContractError("The file is no ONNX model: a number stands where bytes belong.")
    return value


def _text(value: int | memoryview) -> str:
    try:
        return bytes(_message(value)).decode()
    except UnicodeDecodeError as error:
        raise ContractError(f"The file is no ONNX model: a name in it is no text ({error}).") from error


def _unknown(where: str, number: int) -> None:
    raise ContractError(
        f"There is a field {number} of {where} that this version does not know; export the graph again."
    )
