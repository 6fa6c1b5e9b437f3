"""Readers of what people record with pens, videos and sheets, each with a sound file to begin with."""

from __future__ import annotations

import copy
import hashlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import cv2
import numpy as np

from pentimento.collection.recording_sheet import (
    COMMANDS,
    RECORDING,
    read_recording,
    sheet_markers,
    write_recording,
)
from pentimento.contracts.errors import ContractError
from pentimento.io.marker_views import read_markers
from pentimento.io.pen_files import commanded, import_demonstrations, read_pen
from pentimento.io.photo_pairs import read_paths
from pentimento.io.stroke_rows import Placement, Refused
from pentimento.io.stroke_videos import first_and_last
from pentimento.robots.tools import load_tool
from studies.fuzz.mutate import mutated
from studies.fuzz.target import Target, through_file

_NO_CONTROLS: Final = dict.fromkeys(range(32))
_INKML = b"""<ink xmlns="http://www.w3.org/2003/InkML"><definitions><brush xml:id="b"><brushProperty name="color"
value="#1a2b3c"/></brush><context xml:id="c"><inkSource xml:id="s"><traceFormat><channel name="X" type="integer"
units="cm"/><channel name="Y" type="integer" units="cm"/><channel name="F" max="1023"/><channel name="T" units="ms"/>
</traceFormat><channelProperties><channelProperty channel="X" name="resolution" value="1000" units="1/cm"/>
<channelProperty channel="Y" name="resolution" value="1000" units="1/cm"/></channelProperties></inkSource></context>
</definitions><traceGroup contextRef="#c" brushRef="#b"><trace xml:id="t">100 200 512 0, 200 250 600 10, '50 '-10 '5
'10,"5 "0 "1 "0</trace><trace continuation="end" priorRef="#t">!400 !300 !1023 !40</trace></traceGroup></ink>"""
_UNIPEN = b""".VERSION 1.0
.COORD X Y T P
.X_POINTS_PER_INCH 2540
.Y_POINTS_PER_INCH 2540
.SEGMENT CHARACTER 0-1 ? "a"
.PEN_DOWN
100 200 0 5
200 300 10 10
.PEN_UP
250 300 20 0
.PEN_DOWN
300 200 30 3
350 300 40 3
"""
_SVG = b"""<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="40mm" viewBox="0 0 60 40"><style>
.a {stroke: red}</style><g transform="rotate(10) scale(0.5)">
<path class="a" d="M1 2 C 3 4 5 6 7 8 A 3 2 0 0 1 20 20 z"/>
</g><circle cx="9" cy="9" r="4"/><use href="#l"/><defs><line id="l" x1="1" y1="1" x2="9" y2="5"/></defs></svg>"""
_MARKERS = b"marker,x_mm,y_mm,side_mm\n3,-10,-10,14\n7,310,-10,14\n11,310,210,14\n20,-10,210,14\n"


def recordings(folder: Path) -> list[Target]:
    """All readers; ``folder`` is theirs to write into."""
    return [*_pens(folder), *_videos(folder / "videos"), *_sheets(folder / "sheets")]


def _pens(folder: Path) -> list[Target]:
    """Pen strokes, on the way to demonstrations and to commanded paths."""

    def read(path: Path) -> Any:
        pen = read_pen(path, None, None)
        has_height = any(np.isfinite(stroke.points[:, 3]).any() for stroke in pen.strokes)
        commanded(pen, None if has_height else 1e-3, path)
        return import_demonstrations(path, pen, "ann", folder / "demonstrations")

    kinds = (("InkML", ".inkml", _INKML), ("UNIPEN", ".unipen", _UNIPEN), ("SVG strokes", ".svg", _SVG))
    files = [Target(name, (sound,), through_file(folder / f"pen{suffix}", read)) for name, suffix, sound in kinds]
    return files + [
        Target(f"values of {name}", (sound,), _altered_values(sound, through_file(folder / f"pen{suffix}", read)))
        for name, suffix, sound in kinds
        if suffix != ".unipen"
    ]


def _altered_values(sound: bytes, attempt: Callable[[bytes], Any]) -> Callable[[bytes], Any]:
    """Altered names, attributes and texts in place of bytes, so that the XML stays well formed: which, is drawn by the
    altered bytes.
    """

    def attempt_values(data: bytes) -> Any:
        if data == sound:
            return attempt(data)
        rng = np.random.default_rng(int.from_bytes(hashlib.sha256(data).digest()[:8]))
        root = ElementTree.fromstring(sound)
        for _ in range(int(rng.integers(1, 4))):
            elements = list(root.iter())
            element = elements[rng.integers(len(elements))]
            _alter(element, elements[rng.integers(len(elements))], rng)
        return attempt(ElementTree.tostring(root))

    return attempt_values


def _alter(element: ElementTree.Element, other: ElementTree.Element, rng: np.random.Generator) -> None:
    def worse(text: str) -> str:
        return mutated(text.encode(), rng).decode(errors="ignore").translate(_NO_CONTROLS)

    names = list(element.keys())
    match int(rng.integers(6)):
        case 0 if names:
            name = names[rng.integers(len(names))]
            element.set(name, worse(element.get(name, "")))
        case 1 if names:
            del element.attrib[names[rng.integers(len(names))]]
        case 2:
            element.tag = other.tag
        case 3 if len(element):
            element.remove(element[int(rng.integers(len(element)))])
        case 4:
            element.append(copy.deepcopy(other))
        case _:
            element.text = worse(element.text or "")


def _videos(folder: Path) -> list[Target]:
    """A video of a stroke, and where its markers lie."""
    folder.mkdir(exist_ok=True)
    writer = cv2.VideoWriter(str(folder / "s0.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25, (64, 48))
    for level in (250, 200, 150, 100):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    place = Placement.parsed("0 mm, 0 mm, 300 mm, 200 mm", None, False)

    def ends(path: Path) -> Any:
        try:
            return first_and_last(path)
        except Refused as reason:  # part of a sentence that counts the strokes
            raise ContractError(f"The stroke is left out: {reason}.") from None

    return [
        Target("video", ((folder / "s0.mp4").read_bytes(),), through_file(folder / "altered.mp4", ends)),
        Target("markers", (_MARKERS,), through_file(folder / "markers.csv", lambda path: read_markers(path, place))),
    ]


def _sheets(folder: Path) -> list[Target]:
    """The folder of a recording by hand; its photographs are read like any picture."""
    with tempfile.TemporaryDirectory() as temporary:
        printed = Path(temporary) / "recording"
        write_recording(printed, load_tool("marker"), 4, 0)
        sound = {name: (printed / name).read_bytes() for name in (RECORDING, COMMANDS)}
    folder.mkdir(exist_ok=True)

    def recording(path: Path) -> Any:
        found = read_recording(path.parent)
        return [found.code_of(sheet) for sheet in range(found.sheets)], sheet_markers(found.canvas_size_m)

    return [
        Target("recording of sheets", (sound[RECORDING],), through_file(folder / RECORDING, recording)),
        Target("commands of sheets", (sound[COMMANDS],), through_file(folder / COMMANDS, read_paths)),
    ]
