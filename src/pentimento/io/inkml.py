"""Reader of InkML (Ink Markup Language, W3C Recommendation 20 September 2011).

Read are traces in groups and out of them, with their contexts, trace formats and brushes; channels X, Y, Z, T, F, OTx
and OTy; differences, hexadecimal numbers and wildcards. Archival and streaming style both work: a context that stands
among the traces holds for those after it. Mappings that move the ink are refused by name.

Where the orientation of a channel is +ve, which is the default, X grows to the right, Y downwards, and Z upwards from
the surface; with -ve the other way. Source: the table of channel names at https://www.w3.org/TR/InkML/#channel.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.io.inkml_traces import Channel, decoded
from pentimento.io.pen_strokes import PenFile, PenStroke, with_pressures

FloatArray = NDArray[np.float64]

_NAMESPACE: Final = "{http://www.w3.org/2003/InkML}"
_ID: Final = "{http://www.w3.org/XML/1998/namespace}id"
_LENGTHS_M: Final = {
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "in": 0.0254,
    "pt": 0.0254 / 72,
    "pc": 0.0254 / 6,
    "himetric": 1e-5,
}
_TIMES_S: Final = {"s": 1.0, "ms": 1e-3}
_ANGLES_RAD: Final = {"deg": np.pi / 180, "rad": 1.0}
_STILL: Final = ("identity", "unknown", "")
"""Types of mappings that do not move the ink."""
_COLOUR: Final = re.compile(r"#[0-9a-fA-F]{6}")


class _Context(NamedTuple):
    """What holds for a trace."""

    source: Element | None = None
    trace_format: Element | None = None
    brush: Element | None = None


def read_inkml(path: Path, unit_m: float | None) -> PenFile:
    """Read the traces of a file; those with the pen up are left out.

    Args:
        unit_m: length of the unit of X and Y, where the file does not say it.

    Raises:
        ContractError: the file is no InkML, or an element is not understood, which is named.
        ConfigError: the unit is given twice, or not at all.
    """
    try:
        root = ElementTree.parse(path).getroot()  # expat limits entities, and opens no other file
    except (OSError, ElementTree.ParseError, LookupError, ValueError) as error:
        raise ContractError(f"{path} cannot be read as InkML: {error}. Export it again.") from error
    for element in root.iter():
        element.tag = str(element.tag).removeprefix(_NAMESPACE)
    if root.tag != "ink":
        raise ContractError(f"{path} holds <{root.tag[:60]}> and no <ink>; export the recording as InkML.")
    try:
        strokes, forces, assumed = _Ink(root, unit_m, path).strokes()
        assumed += with_pressures(strokes, forces)
    except (ValueError, RecursionError) as error:
        reason = "its elements lie too deep in each other" if isinstance(error, RecursionError) else str(error)
        raise ContractError(f"{path}: {reason}. Correct it, or export the recording again.") from error
    if not strokes:
        raise ContractError(f"{path} holds no <trace> with the pen down; record some strokes.")
    return PenFile(strokes, True, assumed)


class _Ink:
    """A document whose traces are read in order."""

    def __init__(self, root: Element, unit_m: float | None, path: Path) -> None:
        self._root, self._unit_m, self._path = root, unit_m, path
        self._by_id = {name: each for each in root.iter() if (name := each.get(_ID) or each.get("id"))}
        self._assumed: dict[str, None] = {}
        for mapping in root.iter("mapping"):
            if mapping.get("type", "") not in _STILL:
                raise ValueError(f"{_named(mapping)} of type {mapping.get('type', '')[:40]!r} is not supported")

    def strokes(self) -> tuple[list[PenStroke], list[float], list[str]]:
        """All strokes with raw forces, the force of each at full pressure (NaN: unknown), and what was assumed."""
        strokes: list[PenStroke] = []
        forces: list[float] = []
        whole: dict[str, int] = {}  # strokes by the ids of their traces
        for number, (trace, context) in enumerate(self._traces(self._root, _Context())):
            if trace.get("type", "penDown") == "penUp":
                continue
            where = f"{_named(trace)} (number {number}, from 0)"
            points, about, force = self._stroke(trace, context, where)
            before = trace.get("priorRef", "").removeprefix("#")
            if trace.get("continuation", "begin") != "begin":
                if before not in whole:
                    raise ValueError(f"{where} continues {before[:40]!r}, which is no trace before it")
                at = whole[before]
                strokes[at] = PenStroke(np.concatenate([strokes[at].points, points]), strokes[at].about)
            else:
                at = len(strokes)
                strokes.append(PenStroke(points, about))
                forces.append(force)
            whole[trace.get(_ID) or trace.get("id") or ""] = at
        return strokes, forces, list(self._assumed)

    def _traces(self, parent: Element, context: _Context) -> Iterator[tuple[Element, _Context]]:
        for child in parent:
            if child.tag == "trace":
                yield child, self._of(child, context)
            elif child.tag == "traceGroup":
                yield from self._traces(child, self._of(child, context))
            elif child.tag in ("context", "inkSource", "traceFormat", "brush"):
                context = self._changed(child, context)

    def _of(self, element: Element, context: _Context) -> _Context:
        """The context of an element that may refer to others."""
        for kind in ("context", "inkSource", "traceFormat", "brush"):
            if (name := element.get(f"{kind}Ref")) is not None and name != "#DefaultContext":
                target = self._by_id.get(name.removeprefix("#"))
                if target is None or target.tag != kind:
                    raise ValueError(f"{_named(element)} refers to {name[:40]!r}, which is no <{kind}> of this file")
                if target is not element:
                    context = self._changed(target, context)
        return context

    def _changed(self, element: Element, context: _Context) -> _Context:
        match element.tag:
            case "traceFormat":
                return context._replace(trace_format=element)
            case "brush":
                return context._replace(brush=element)
            case "inkSource":
                own = element.find("traceFormat")
                return context._replace(source=element, trace_format=context.trace_format if own is None else own)
        context = self._of(element, context)
        for child in element:
            if child.tag in ("inkSource", "traceFormat", "brush"):
                context = self._changed(child, context)
        return context

    def _stroke(self, trace: Element, context: _Context, where: str) -> tuple[FloatArray, dict[str, Any], float]:
        channels = _channels(context.trace_format)
        try:
            columns = decoded("".join(trace.itertext()), channels)
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from error
        missing = [name for name in ("X", "Y") if name not in columns]
        if missing:
            raise ValueError(f"{where}: its trace format has no channel {missing[0]}")
        by_name = {channel.name: channel.element for channel in channels}
        points = np.full((len(columns["X"]), 5), np.nan)
        for at, name in ((1, "X"), (2, "Y"), (3, "Z")):
            if name in columns:
                points[:, at] = columns[name] * self._length_m(by_name[name], context)
        if "T" in columns:
            points[:, 0] = columns["T"] * self._unit(by_name["T"], _TIMES_S, "ms", "Times have")
        about = self._about(context)
        for name in ("OTx", "OTy"):
            if name in columns and np.isfinite(columns[name]).any():
                factor = _sign(by_name[name]) * self._unit(by_name[name], _ANGLES_RAD, "deg", "Tilts have")
                about[f"tilt_{name[-1]}_rad"] = float(np.nanmean(columns[name]) * factor)
        if "F" not in columns:
            return points, about, np.nan
        least = _number(by_name["F"].get("min", "0"), "the channel F's min")
        points[:, 4] = columns["F"] - least
        percent = by_name["F"].get("units") == "%"
        full = 100.0 if percent else _number(by_name["F"].get("max", "nan"), "the channel F's max")
        return points, about, full - least

    def _length_m(self, channel: Element, context: _Context) -> float:
        """Metres of the unit of a channel, with the sign of its orientation."""
        own = self._own_length_m(channel, context)
        if own is not None and self._unit_m is not None and channel.get("name") != "Z":
            raise ConfigError(f"{self._path} has units of its channel {channel.get('name')}; leave --units out.")
        if own is None and self._unit_m is None:
            raise ConfigError(
                f"{self._path} has no unit of length of its channel {channel.get('name')}; give --units, such as mm "
                "or '0.01 mm'."
            )
        return _sign(channel) * float(own if own is not None else self._unit_m or 0.0)

    def _own_length_m(self, channel: Element, context: _Context) -> float | None:
        """The resolution counts where values are whole numbers of a device: their units then are those of its range."""
        units = channel.get("units", "dev")
        if channel.get("type") == "integer" or units not in _LENGTHS_M:
            for each in () if context.source is None else context.source.iter("channelProperty"):
                per, _, of = each.get("units", "").partition("/")
                if (each.get("channel"), each.get("name"), per) == (channel.get("name"), "resolution", "1"):
                    value = _number(each.get("value", ""), f"the resolution of channel {channel.get('name')}")
                    if of in _LENGTHS_M and value > 0:
                        return _LENGTHS_M[of] / value
        return _LENGTHS_M.get(units)

    def _unit(self, channel: Element, known: dict[str, float], usual: str, what: str) -> float:
        units = channel.get("units")
        if units is None:
            self._assumed[f"{what} no unit: {usual}."] = None
        elif units not in known:
            self._assumed[f"{what} the unit {units[:20]!r}, which is none of {', '.join(known)}: left out."] = None
        return known.get(units or usual, np.nan)

    def _about(self, context: _Context) -> dict[str, Any]:
        about: dict[str, Any] = {}
        if context.brush is None:
            return about
        if name := context.brush.get(_ID) or context.brush.get("id"):
            about["tool_id"] = name
        for each in context.brush.iter("brushProperty"):
            value = each.get("value", "")
            if each.get("name") == "color" and _COLOUR.fullmatch(value):
                about["color_srgb"] = [int(value[at : at + 2], 16) / 255 for at in (1, 3, 5)]
            elif each.get("name") == "width" and each.get("units") in _LENGTHS_M:
                about["brush_width_m"] = _number(value, "a brush's width") * _LENGTHS_M[each.get("units", "m")]
        return about


def _channels(trace_format: Element | None) -> list[Channel]:
    if trace_format is None:  # the default of the recommendation
        return [Channel(name, Element("channel", name=name), True) for name in ("X", "Y")]
    late = {id(each) for part in trace_format.iter("intermittentChannels") for each in part.iter("channel")}
    found = [Channel(each.get("name", ""), each, id(each) not in late) for each in trace_format.iter("channel")]
    return sorted(found, key=lambda channel: not channel.regular)


def _sign(channel: Element) -> float:
    """The direction in which a channel grows."""
    orientation = channel.get("orientation", "+ve")
    if orientation not in ("+ve", "-ve"):
        raise ValueError(f"the orientation of channel {channel.get('name')} is {orientation[:20]!r}, not +ve or -ve")
    return 1.0 if orientation == "+ve" else -1.0


def _number(text: str, what: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{what} is {text[:20]!r} and no number") from None


def _named(element: Element) -> str:
    name = element.get(_ID) or element.get("id")
    return f"<{element.tag}{f' id={name!r}' if name else ''}>"[:80]
