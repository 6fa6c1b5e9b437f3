"""Fonts of the computer: which one has the letters of a text, and the text drawn in it."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pentimento.planning.pushes.goal import GoalError

_FOLDERS = (
    "/usr/share/fonts", "/usr/local/share/fonts", "~/.local/share/fonts", "~/.fonts", "/System/Library/Fonts",
    "/Library/Fonts", "~/Library/Fonts", "C:/Windows/Fonts",
)  # fmt: skip
_SUFFIXES = (".ttf", ".otf", ".ttc")
_VARIANTS = ("bold", "italic", "oblique", "mono", "condensed", "light", "narrow")
"""Parts of the names of fonts that come last."""
_NO_CHARACTER = "\U0010ffff"
"""Never a character (Unicode 23.7), so that fonts draw it as their sign for a missing glyph."""
_COMPARED_PX = 40


def font_for(text: str, font: Path | None = None) -> Path:
    """The file of the first font that has a glyph for each character; of this font alone, if one is given.

    Matplotlib's serif comes first where that package is installed, so that the workshop draws the same letters on every
    computer.

    Raises:
        GoalError: a character is invisible, the font is unreadable or lacks a character, or no installed font has them.
    """
    for character in text:
        if character in "\t\n\r" or (not character.isspace() and unicodedata.category(character)[0] == "C"):
            raise GoalError(f"The text has {_named(character)}, which leaves no mark; leave it out.")
    if font is not None:
        lacking = _lacking(text, _opened(font, _COMPARED_PX))
        if lacking is not None:
            raise GoalError(f"The font {font} has no character {_named(lacking)}; give another font, or another text.")
        return font
    lacking = None
    for path in installed_fonts():
        try:
            lacks = _lacking(text, _opened(path, _COMPARED_PX))
        except GoalError:  # a damaged file, or a font of pictures
            continue
        if lacks is None:
            return path
        lacking = lacking or lacks
    if lacking is None:
        raise GoalError("No font is installed on this computer; give the file of one (--font FILE).")
    raise GoalError(
        f"No font on this computer has all characters of {text!r}; the first ones lack {_named(lacking)}. Give the "
        "file of a font that has them (--font FILE), or another text."
    )


def installed_fonts() -> Iterator[Path]:
    """Files of fonts: plain ones before bold, italic and narrow ones, each in the order of their names."""
    matplotlib = find_spec("matplotlib")
    if matplotlib is not None and matplotlib.origin is not None:
        serif = Path(matplotlib.origin).parent / "mpl-data/fonts/ttf/DejaVuSerif.ttf"
        if serif.is_file():
            yield serif
    found = [path for folder in _FOLDERS for path in Path(folder).expanduser().rglob("*") if _is_font(path)]
    yield from sorted(found, key=lambda path: (any(part in path.stem.lower() for part in _VARIANTS), path.name))


def drawn(text: str, font: Path, height_px: int) -> NDArray[np.uint8]:
    """Text in a font of this size, 255 in a ground of 0, without margins.

    Raises:
        GoalError: the file is not a font of any size.
    """
    opened = _opened(font, height_px)
    left, top, right, bottom = (round(edge) for edge in opened.getbbox(text))
    picture = Image.new("L", (max(right - left, 1), max(bottom - top, 1)))
    ImageDraw.Draw(picture).text((-left, -top), text, fill=255, font=opened)
    return np.asarray(picture)


def _is_font(path: Path) -> bool:
    return path.suffix.lower() in _SUFFIXES and path.is_file()


def _opened(font: Path, height_px: int) -> ImageFont.FreeTypeFont:
    try:
        return ImageFont.truetype(str(font), height_px)
    except (OSError, ValueError) as error:
        raise GoalError(f"{font} cannot be read as a font ({error}); give a TrueType or OpenType file.") from error


def _lacking(text: str, font: ImageFont.FreeTypeFont) -> str | None:
    """The first character that the font lacks."""
    missing = _glyph(_NO_CHARACTER, font)
    return next((c for c in text if not c.isspace() and _glyph(c, font) == missing), None)


def _glyph(character: str, font: ImageFont.FreeTypeFont) -> tuple[tuple[int, int], bytes]:
    mask = font.getmask(character)
    return mask.size, bytes(mask)


def _named(character: str) -> str:
    return f"{character!r} ({unicodedata.name(character, f'U+{ord(character):04X}')})"
