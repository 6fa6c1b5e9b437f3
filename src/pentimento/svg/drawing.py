"""The one reader of SVG drawings: the outlines that a viewer shows, at their size, flattened, with y up.

Drawn are `path` and the basic shapes, also within groups, links, nested `svg`, and by `use`; transforms, viewports,
hidden layers and style sheets are followed. Outlines count, not how they are painted: what is seen only as a filling
gives its outline, and markers at the ends of lines give nothing. Elements and properties that would draw or cut
something else are refused by name.

The library svgelements is not used here, because version 1.9.6 draws masks, markers and unused symbols; ignores the
viewBox of symbols, the precedence of style rules and what it cannot read; gives a smooth curve after one of another
kind a wrong shape; and repeats `use` without a limit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.svg.path_data import ellipse, flattened, places, rectangle
from pentimento.svg.style import Style, StyleSheet, hidden_paint, transparent
from pentimento.svg.transforms import (
    PX_M,
    Size,
    fitted,
    length,
    length_m,
    moved,
    scaled,
    transform_of,
    view_box,
)

FloatArray = NDArray[np.float64]


class Line(NamedTuple):
    """A subpath, or the outline of a shape."""

    points: FloatArray
    """[K, 2]"""
    paint: str
    """Of its line, or else of its filling, as SVG has it: `#102030`, `navy`, `url(#gradient)`."""


Lines = list[Line]


@dataclass(frozen=True, eq=False)
class Drawing:
    """What a file draws, in metres from the origin of its user units, y up."""

    lines: Lines
    """In the order of drawing."""
    page_m: tuple[float, float, float, float] | None
    """Left, bottom, width and height of its page: the viewBox, or else width and height; None where it has neither."""


_NAMESPACE: Final = "{http://www.w3.org/2000/svg}"
_NOT_DRAWN: Final = frozenset((
    "title", "desc", "metadata", "defs", "symbol", "clipPath", "mask", "marker", "pattern", "linearGradient",
    "radialGradient", "meshgradient", "hatch", "solidcolor", "filter", "style", "view", "cursor", "color-profile",
    "font", "font-face",
))  # fmt: skip
_GROUPS: Final = ("g", "a")
_SHAPES: Final = ("path", "line", "polyline", "polygon", "circle", "ellipse", "rect")
_TEXT: Final = ("text", "flowRoot")
_MAX_ELEMENTS: Final = 200_000
"""Drawn, each time that `use` repeats them."""
_LARGEST: Final = 1e9
"""Coordinate of a shape, in user units."""
_OUTSIDE: Final = 1e-6
"""Of a viewport's or a clip path's size: how far a line may leave it before it counts as cut."""


class NoSizeError(ContractError):
    """A drawing does not say how large it is."""


def read_drawing(path: Path, unit_m: float | None, *, css_pixels: bool = False) -> Drawing:
    """Read a file.

    Args:
        unit_m: length of a user unit of the outermost `svg`. None: from its width or height (mm, cm, in, pt, pc, Q)
            and viewBox.
        css_pixels: where ``unit_m`` is None, a pixel is 1/96 inch, and so is a user unit without a size.

    Raises:
        NoSizeError: the size is unknown.
        ContractError: the file is no SVG, has no unit, draws no line, or has something that is not understood, which is
            named.
    """
    try:
        if b"<?xml-stylesheet" in path.read_bytes():
            raise ContractError(f"{path} has its style in another file; save it with its style inside.")
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError, LookupError, ValueError) as error:
        raise ContractError(f"{path} cannot be read as SVG: {error}.") from error
    if root.tag.removeprefix(_NAMESPACE) != "svg":
        raise ContractError(f"{path} holds <{root.tag[:60]}> and no <svg>; export the drawing as plain SVG.")
    try:
        reader = _Reader(root)
        to_m = _page(root, path, unit_m, css_pixels)
        box = view_box(root.get("viewBox", ""))
        size = Size(np.nan, np.nan) if box is None else Size(*box[2:])
        style = reader.style(root, {})
        hidden = style.get("display") == "none" or transparent(style)
        lines = [] if hidden else reader.children(root, _Context(style, size))
        reader.check_effects(style, lines, _Context(style, size))
    except (ValueError, RecursionError) as error:
        reason = "its elements lie too deep in each other" if isinstance(error, RecursionError) else str(error)
        raise ContractError(
            f"{path}: {reason}. Convert that to plain visible paths in your drawing program, or remove it."
        ) from error
    if not lines:
        raise ContractError(f"{path} draws no line: it is empty, or all of it is hidden; show what is to be drawn.")
    upright = [line._replace(points=line.points * np.array([1.0, -1.0])) for line in _placed(lines, to_m)]
    if not all(np.isfinite(line.points).all() for line in upright):
        raise ContractError(f"{path} has a transform that is too large; correct it.")
    return Drawing(upright, _page_m(root, box, to_m))


def _page_m(
    root: Element, box: tuple[float, float, float, float] | None, to_m: FloatArray
) -> tuple[float, float, float, float] | None:
    if box is None:
        try:
            width, height = (length(root.get(name, ""), np.nan) for name in ("width", "height"))
        except ValueError:
            return None
        box = (0.0, 0.0, width, height)
    (x, y), (left, top, width, height) = np.diag(to_m)[:2].tolist(), box
    return x * left, -y * (top + height), x * width, y * height


def _page(root: Element, path: Path, unit_m: float | None, css_pixels: bool) -> FloatArray:
    """The matrix [3, 3] from user units of the outermost `svg` to metres, y down."""
    if root.get("transform"):
        raise ValueError("the outermost svg has a transform")
    if unit_m is not None:
        return scaled(unit_m, unit_m)
    sides: dict[str, float] = {}
    for name in ("width", "height"):
        text = root.get(name, "auto")
        if text == "auto" or (css_pixels and text.strip().endswith("%")):
            continue
        try:
            sides[name] = PX_M * length(text, np.nan) if css_pixels else length_m(text)
        except ValueError as error:
            raise NoSizeError(f"{path} has no {name} as a length ({error}). Give unit_m instead.") from error
    box = view_box(root.get("viewBox", ""))
    if css_pixels and (not sides or box is None):
        return scaled(PX_M, PX_M)
    if not sides:
        raise NoSizeError(f"{path} has no width as a length in mm. Give unit_m instead.")
    if box is None or not all(side > 0 for side in sides.values()):
        raise NoSizeError(f"{path} has no viewBox or no size; give unit_m, the length of a user unit.")
    width = sides.get("width", sides.get("height", 0.0) * box[2] / box[3])
    height = sides.get("height", width * box[3] / box[2])
    matrix = fitted(box, Size(width, height), root.get("preserveAspectRatio", ""))
    return scaled(matrix[0, 0], matrix[1, 1])  # places are counted from the origin of the user's units


@dataclass(frozen=True)
class _Context:
    """What an element has from those around it."""

    style: Mapping[str, str]
    size: Size
    """Of the viewport."""
    within: tuple[str, ...] = ()
    """Ids of the elements that `use` repeats here."""


class _Reader:
    """Draws the elements one in another, each in the coordinates of its parent."""

    def __init__(self, root: Element) -> None:
        self._by_id = {element.get("id"): element for element in reversed(list(root.iter())) if element.get("id")}
        self._svg = _NAMESPACE if root.tag.startswith(_NAMESPACE) else ""
        sheets = ["".join(element.itertext()) for element in root.iter(f"{self._svg}style")]
        self._sheet = StyleSheet(sheets)
        self._drawn = 0

    def style(self, element: Element, inherited: Mapping[str, str]) -> Style:
        return self._sheet.style_of(element, inherited)

    def children(self, element: Element, context: _Context) -> Lines:
        return [line for child in element for line in self._element(child, context)]

    def _element(self, element: Element, context: _Context) -> Lines:
        """The lines of an element and all that it holds."""
        kind = element.tag.removeprefix(self._svg)
        if kind.startswith("{") or kind in _NOT_DRAWN:  # elements of other vocabularies are not drawn
            return []
        self._drawn += 1
        if self._drawn > _MAX_ELEMENTS:
            raise ValueError(f"<use> repeats elements more than {_MAX_ELEMENTS} times")
        style = self.style(element, context.style)
        if style.get("display") == "none" or transparent(style):
            return []
        try:
            lines = self._content(kind, element, replace(context, style=style))
            self.check_effects(style, lines, context)
            return _placed(lines, transform_of(style))
        except _Named:
            raise
        except ValueError as error:
            raise _Named(f"{_named(element)}: {error}") from error

    def _content(self, kind: str, element: Element, context: _Context) -> Lines:
        """The lines of a visible element in its own coordinates; ``context`` has its own style."""
        if kind in _GROUPS:
            return self.children(element, context)
        if kind in _SHAPES:
            seen = context.style.get("visibility", "visible") not in ("hidden", "collapse")
            if not seen or hidden_paint(context.style):
                return []
            if context.style.get("stroke-dasharray", "none") not in ("none", "0"):
                raise ValueError("its line is dashed")
            outlines = list(_outlines(kind, element, context.style, context.size))
            if not all((np.abs(outline) < _LARGEST).all() for outline in outlines):
                raise ValueError("it has a number that is too large")
            paint = _paint(context.style)
            return [Line(outline, paint) for outline in outlines] + self.children(element, context)
        if kind == "svg":
            return self._viewport(element, element, context)
        if kind == "use":
            return self._used(element, context)
        if kind in _TEXT and not "".join(element.itertext()).strip():
            return []
        raise ValueError("it is neither a path nor a basic shape")

    def _used(self, element: Element, context: _Context) -> Lines:
        name = _reference(element)
        target = self._by_id.get(name)
        if target is None:
            raise ValueError(f"there is no element {name[:60]!r} to repeat")
        if name in context.within:
            raise ValueError(f"the element {name[:60]!r} repeats itself")
        inner = replace(context, within=(*context.within, name))
        x, y = (length(context.style.get(axis, "0"), whole) for axis, whole in zip("xy", context.size, strict=True))
        if target.tag.removeprefix(self._svg) == "symbol":
            style = self.style(target, context.style)
            if style.get("display") == "none":
                return []
            lines = self._viewport(target, element, replace(inner, style=style))
            return _placed(_placed(lines, transform_of(style)), moved(x, y))
        if target.tag.removeprefix(self._svg) == "svg" and {"width", "height"} & set(context.style):
            raise ValueError("it gives another size to a nested svg")
        return _placed(self._element(target, inner), moved(x, y))

    def _viewport(self, element: Element, sized: Element, context: _Context) -> Lines:
        """The content of a nested svg or of a symbol; the attributes width and height are those of ``sized``."""
        own = self.style(sized, {})
        pairs = zip(("width", "height"), context.size, strict=True)
        sides = (length(own.get(name, "100%"), whole) for name, whole in pairs)
        size, box = Size(*sides), view_box(element.get("viewBox", ""))
        if size.width <= 0 or size.height <= 0:
            return []
        if box is None:
            inside, matrix = size, np.eye(3)
        else:
            inside, matrix = Size(*box[2:]), fitted(box, size, element.get("preserveAspectRatio", ""))
        lines = _placed(self.children(element, replace(context, size=inside)), matrix)
        if context.style.get("overflow", "hidden") not in ("visible", "auto"):
            margin = _OUTSIDE * max(size)
            for line in lines:
                if (line.points < -margin).any() or (line.points > np.array(size) + margin).any():
                    raise ValueError("its edge cuts a line off")
        if element is sized:  # a symbol is placed by the `use` that shows it
            place = (length(own.get(axis, "0"), whole) for axis, whole in zip("xy", context.size, strict=True))
            return _placed(lines, moved(*place))
        return lines

    def check_effects(self, style: Mapping[str, str], lines: Lines, context: _Context) -> None:
        """Refuse masks and filters, and a clip path that cuts a line off."""
        for name in ("mask", "filter"):
            if style.get(name, "none") != "none":
                raise ValueError(f"the property {name}: {style[name][:60]} is not supported")
        clip = style.get("clip-path", "none")
        if clip == "none" or not lines:
            return
        name = clip.removeprefix("url(").removesuffix(")").strip("\"' ").removeprefix("#")
        target = self._by_id.get(name) if clip.startswith("url(") else None
        if (
            target is None
            or target.get("clipPathUnits", "userSpaceOnUse") != "userSpaceOnUse"
            or name in context.within
        ):
            raise ValueError(f"the clip path {clip[:60]!r} is not supported")
        plain = replace(context, style=self.style(target, {}), within=(*context.within, name))
        shapes = _placed(self.children(target, plain), transform_of(plain.style))
        if not all(any(_holds(shape.points, line.points) for shape in shapes) for line in lines):
            raise ValueError(f"the clip path {clip[:60]!r} cuts a line off")


class _Named(ValueError):
    """A message that names its element."""


def _named(element: Element) -> str:
    name = f" id={element.get('id')!r}"[:60] if element.get("id") else ""
    return f"<{element.tag.rpartition('}')[2]}{name}>"


def _reference(element: Element) -> str:
    target = element.get("href", element.get("{http://www.w3.org/1999/xlink}href", ""))
    if not target.startswith("#"):
        raise ValueError(f"it repeats {target[:60]!r}, which is not in this file")
    return target[1:]


def _outlines(kind: str, element: Element, style: Mapping[str, str], size: Size) -> Iterator[FloatArray]:
    """The outlines [K, 2] of a shape in its own coordinates."""

    def value(name: str, whole: float, otherwise: str = "0") -> float:
        text = style.get(name, otherwise)
        return length(otherwise if text == "auto" else text, whole)

    width, height = size
    match kind:
        case "path":
            d = style.get("d", "none")
            if not d.startswith("none"):
                if d.lstrip().startswith("path("):
                    raise ValueError("its path is given by a style sheet")
                yield from flattened(d)
        case "line":
            ends = [
                length(element.get(name, "0"), width if "x" in name else height) for name in ("x1", "y1", "x2", "y2")
            ]
            yield np.array(ends).reshape(2, 2)
        case "polyline" | "polygon":
            corners = places(element.get("points", ""))
            if len(corners) > 1:
                yield np.vstack([corners, corners[:1]]) if kind == "polygon" else corners
        case "circle":
            radius = value("r", size.diagonal)
            if radius > 0:
                yield ellipse(value("cx", width), value("cy", height), radius, radius)
        case "ellipse" | "rect":
            rx, ry = style.get("rx", "auto"), style.get("ry", "auto")
            rx, ry = (ry if rx == "auto" else rx), (rx if ry == "auto" else ry)  # one radius stands for both
            radii = [length("0" if r == "auto" else r, whole) for r, whole in ((rx, width), (ry, height))]
            if kind == "ellipse" and min(radii) > 0:
                yield ellipse(value("cx", width), value("cy", height), *radii)
            if kind == "rect":
                sides = value("width", width), value("height", height)
                if min(sides) > 0:
                    yield rectangle(value("x", width), value("y", height), *sides, *radii)


def _placed(lines: Lines, matrix: FloatArray) -> Lines:
    return [line._replace(points=line.points @ matrix[:2, :2].T + matrix[:2, 2]) for line in lines]


def _paint(style: Mapping[str, str]) -> str:
    line = style.get("stroke", "none")
    return style.get("fill", "black") if line.lower() in ("none", "transparent") else line


def _holds(shape: FloatArray, stroke: FloatArray) -> bool:
    """Whether all points of a stroke lie within a closed shape or on its edge."""
    x, y = stroke.T[:, :, None]
    (ax, ay), (bx, by) = shape[:-1].T, shape[1:].T
    along = np.stack([bx - ax, by - ay])
    squared = np.maximum((along**2).sum(0), 1e-300)
    share = np.clip(((x - ax) * along[0] + (y - ay) * along[1]) / squared, 0, 1)
    distance = np.hypot(x - ax - share * along[0], y - ay - share * along[1]).min(axis=1)
    crossed = (ay > y) != (by > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = x < ax + (y - ay) * along[0] / along[1]
    inside = (crossed & beyond).sum(axis=1) % 2 == 1
    return bool((inside | (distance <= _OUTSIDE * np.ptp(shape))).all())
