"""Styles of SVG elements, as far as they hide or move what is drawn: attributes, `style`, and style sheets.

Style sheets select by type, class and id. A rule with any other selector is passed over where it only changes how lines
look, and refused where it hides, moves or shapes something.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple
from xml.etree.ElementTree import Element

Style = dict[str, str]
"""Values of properties by name, lower case."""

INHERITED: Final = ("visibility", "fill", "stroke", "stroke-dasharray")
GEOMETRY: Final = ("x", "y", "width", "height", "cx", "cy", "r", "rx", "ry")
_MOVING: Final = (
    "transform",
    "transform-origin",
    "transform-box",
    "translate",
    "rotate",
    "scale",
    "zoom",
    "offset-path",
)
_PAINT: Final = ("fill", "stroke", "opacity", "stroke-dasharray")
_KNOWN: Final = frozenset(
    (*GEOMETRY, *_MOVING, *_PAINT, "display", "visibility", "overflow", "clip-path", "mask", "filter", "d")
)
_NO_ATTRIBUTES: Final = frozenset(("translate", "rotate", "scale", "zoom", "offset-path", "transform-box"))
"""Properties of style sheets only: as attributes they mean nothing, or something else."""

_COMMENT: Final = re.compile(r"/\*.*?\*/|<!--|-->", re.DOTALL)
_COMPOUND: Final = re.compile(r"(\*|[\w-]+)?((?:[.#][\w-]+)*)")
_STATEMENT: Final = re.compile(r"@(?:charset|namespace)[^;{]*;")


class _Rule(NamedTuple):
    kind: str
    """Type of the elements; "" for any."""
    marks: frozenset[str]
    """Classes and ids, each with its mark: `.name`, `#name`."""
    style: Style
    important: bool

    def matches(self, kind: str, marks: frozenset[str]) -> bool:
        return self.kind in ("", kind) and self.marks <= marks

    def weight(self) -> tuple[int, int, int]:
        ids = sum(mark.startswith("#") for mark in self.marks)
        return ids, len(self.marks) - ids, int(self.kind != "")


class StyleSheet:
    """The rules of all `<style>` elements of a drawing."""

    def __init__(self, texts: list[str]) -> None:
        """Read the rules.

        Raises:
            ValueError: a rule that hides, moves or shapes something cannot be understood.
        """
        self._rules = [rule for text in texts for rule in _rules(_COMMENT.sub("", text))]

    def style_of(self, element: Element, inherited: Mapping[str, str]) -> Style:
        """The style of an element: the more specific rule prevails, then the later one; `style` before all sheets."""
        kind = element.tag.rpartition("}")[2]
        classes = element.get("class", "").split()
        marks = frozenset([f".{name}" for name in classes] + [f"#{element.get('id')}"] * ("id" in element.attrib))
        found: Style = {name: value for name, value in inherited.items() if name in INHERITED}
        attributes = {name: element.attrib[name].strip() for name in _KNOWN - _NO_ATTRIBUTES if name in element.attrib}
        own = dict(_declarations(element.get("style", "")))
        matching = sorted((rule for rule in self._rules if rule.matches(kind, marks)), key=_Rule.weight)
        layers = [attributes, *(rule.style for rule in matching if not rule.important)]
        layers.append({name: value for name, (value, important) in own.items() if not important})
        layers += [rule.style for rule in matching if rule.important]
        layers.append({name: value for name, (value, important) in own.items() if important})
        for layer in layers:
            for name, value in layer.items():
                found[name] = inherited.get(name, "") if value == "inherit" else value
        return {name: value for name, value in found.items() if value}


def hidden_paint(style: Mapping[str, str]) -> bool:
    """Whether an element has neither a fill nor a stroke, or no opacity, and so cannot be seen."""
    fill, stroke = (style.get(name, initial).lower() for name, initial in (("fill", "black"), ("stroke", "none")))
    return (fill in ("none", "transparent") and stroke in ("none", "transparent")) or transparent(style)


def transparent(style: Mapping[str, str]) -> bool:
    """Whether an element and all that it holds has no opacity."""
    return re.fullmatch(r"0*\.?0*%?", style.get("opacity", "1")) is not None


def _rules(text: str) -> Iterator[_Rule]:
    place, text = 0, _STATEMENT.sub("", text)
    while text[place:].strip():
        opening = text.find("{", place)
        if text[place:].lstrip().startswith("@import") or opening < 0:
            raise ValueError(f"the style sheet has {text[place:].strip()[:60]!r}, which cannot be read")
        closing = _closing(text, opening)
        yield from _rules_of(text[place:opening].strip(), text[opening + 1 : closing])
        place = closing + 1


def _closing(text: str, opening: int) -> int:
    depth = 0
    for place in range(opening, len(text)):
        depth += {"{": 1, "}": -1}.get(text[place], 0)
        if depth == 0:
            return place
    raise ValueError(f"the style sheet has {text[opening : opening + 60]!r}, which does not end")


def _rules_of(selectors: str, body: str) -> Iterator[_Rule]:
    if selectors.startswith("@"):
        inner = body.replace("{", ";").replace("}", ";")
        if not selectors.startswith("@font-face") and any(_matters(name, value) for name, (value, _) in _listed(inner)):
            raise ValueError(f"the style sheet hides or moves something within {selectors[:60]!r}")
        return
    declared = list(_listed(body))
    for selector in (part.strip() for part in selectors.split(",")):
        match = _COMPOUND.fullmatch(selector)
        if match is None or not selector:
            if any(_matters(name, value) for name, (value, _) in declared):
                raise ValueError(f"the style sheet hides, moves or shapes what {selector[:60]!r} selects")
            continue
        marks = frozenset(re.findall(r"[.#][\w-]+", match[2]))
        kind = "" if match[1] in (None, "*") else match[1]
        for important in (False, True):
            style = {name: value for name, (value, strong) in declared if strong == important}
            yield _Rule(kind, marks, style, important)


def _declarations(text: str) -> dict[str, tuple[str, bool]]:
    return dict(_listed(_COMMENT.sub("", text)))


def _listed(body: str) -> Iterator[tuple[str, tuple[str, bool]]]:
    """The known properties of a block, each with its value and whether it is `!important`."""
    for declaration in body.split(";"):
        name, colon, value = declaration.partition(":")
        name, strong = name.strip().lower(), re.search(r"!\s*important\s*$", value)
        value = value[: strong.start()] if strong else value
        if colon and name in _KNOWN:
            yield name, (value.strip(), strong is not None)


def _matters(name: str, value: str) -> bool:
    """Whether a property hides, moves or shapes something, and does not only change how it looks."""
    if name in ("fill", "stroke"):
        return value.lower() in ("none", "transparent")
    if name == "opacity":
        return transparent({"opacity": value})
    if name == "display":
        return value.lower() == "none"
    return value.lower() not in ("none", "visible")
