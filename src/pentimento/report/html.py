"""Pieces of HTML, and the album that keeps each picture both inside the page and as a separate file."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape

_TYPES = {"png": "image/png", "gif": "image/gif"}


class Album:
    """The report's files besides the page: `files` maps names to contents."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}

    def keep(self, name: str, data: bytes) -> str:
        """Keep a file in the page's folder and return its name, for a link."""
        self.files[name] = data
        return name

    def photo(self, name: str, data: bytes, alt: str, caption: str, still: bytes | None = None) -> str:
        """A photograph or a rendering; `caption` is HTML.

        `still` (PNG) takes the place of an animation for readers who asked their system for reduced motion.
        """
        image = self._image(name, data, alt)
        if still is not None:
            source = f'<source media="(prefers-reduced-motion: reduce)" srcset="{_data_uri("png", still)}">'
            image = f"<picture>{source}{image}</picture>"
        return f'<figure class="photo">{image}<figcaption>{caption}</figcaption></figure>'

    def plot(self, name: str, data: bytes, alt: str, caption: str) -> str:
        """A drawn figure, on its own light ground in either colour scheme; `caption` is HTML."""
        image = self._image(name, data, alt)
        return f'<figure class="plot">{image}<figcaption>{caption}</figcaption></figure>'

    def _image(self, name: str, data: bytes, alt: str) -> str:
        self.keep(name, data)
        uri = _data_uri(name.rpartition(".")[2], data)
        return f'<img alt="{escape(alt)}" src="{uri}">'


def row(figures: Sequence[str]) -> str:
    """Figures side by side, below one another on a narrow screen."""
    return f'<div class="row">{"".join(figures)}</div>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], caption: str, numbers_from: int = 1) -> str:
    """A table of HTML cells; the first column heads its row, columns from `numbers_from` on are numbers."""
    return (
        f'<div class="scroll"><table><caption>{caption}</caption><thead><tr>'
        + "".join(f'<th scope="col"{_class(i, numbers_from)}>{cell}</th>' for i, cell in enumerate(head))
        + "</tr></thead><tbody>"
        + "".join(_table_row(cells, numbers_from) for cells in rows)
        + "</tbody></table></div>"
    )


def bar(share: float) -> str:
    """A bar as long as `share` (0 to 1) of its cell."""
    return f'<span class="bar" style="width:{100 * min(max(share, 0.0), 1.0):.1f}%"></span>'


def _table_row(cells: Sequence[str], numbers_from: int) -> str:
    first = f'<th scope="row">{cells[0]}</th>'
    rest = "".join(f"<td{_class(i, numbers_from)}>{cell}</td>" for i, cell in enumerate(cells) if i > 0)
    return f"<tr>{first}{rest}</tr>"


def _class(index: int, numbers_from: int) -> str:
    return ' class="number"' if index >= numbers_from else ""


def _data_uri(ending: str, data: bytes) -> str:
    return f"data:{_TYPES[ending]};base64,{b64encode(data).decode('ascii')}"
