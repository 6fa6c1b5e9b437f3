"""SVG drawings: what a viewer shows, at its size, or a refusal that names what is not understood."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from resvg_py import svg_to_bytes

from pentimento.contracts.errors import ContractError
from pentimento.handwriting.recording import XY
from pentimento.handwriting.svg_recordings import read_svg

SIDE_MM = 100
PX_A_MM = 4
XLINK = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'


def svg(content: str, attributes: str = 'viewBox="0 0 100 100"') -> str:
    return f'<svg {XLINK} width="100mm" height="100mm" {attributes}>{content}</svg>'


def strokes_mm(folder: Path, text: str, unit_m: float | None = None) -> list[np.ndarray]:
    """Strokes [K, 2] in mm, y down from the top."""
    file = folder / "drawing.svg"
    file.write_text(text, encoding="utf-8")
    return [stroke.points[:, XY] * [1e3, -1e3] for stroke in read_svg(file, "s", "h", unit_m)]


def lengths_mm(folder: Path, text: str, unit_m: float | None = None) -> list[float]:
    found = strokes_mm(folder, text, unit_m)
    return [float(np.linalg.norm(np.diff(stroke, axis=0), axis=1).sum()) for stroke in found]


DRAWN = {
    "curves": '<path d="M10 20 C20 0 30 40 40 20 S60 0 70 20 q5 10 10 0 t10 0"/>',
    "smooth curves after curves of another kind": '<path d="M10 10C10 40 40 60 50 20T90 60"/>'
    '<path d="M10 50Q10 99 40 70S60 99 90 70"/>',
    "arcs without separators": '<path d="M20 50a20 10 30 1140-5A15 15 0 01 70,70"/>',
    "numbers without separators": '<path d="M10.5.5l30.5-.0.5 40m-5,-5 6e0,1E1h-20v-8.5z l5 40"/>',
    "shapes": '<circle cx="30" cy="30" r="20"/><ellipse cx="60" cy="60" rx="30" ry="10"/>'
    '<rect x="10" y="70" width="40" height="20" rx="8"/><rect x="60" y="5" width="20" height="30"/>'
    '<line x1="5" y1="95" x2="95" y2="80"/><polyline points="5,5 10,15,20 5"/><polygon points="80,80 95,80 90 95"/>',
    "lengths with units": '<circle cx="1in" cy="30pt" r="5%"/><rect x="10%" y="50%" width="10mm" height="1pc" ry="2"/>',
    "an ellipse with one radius": '<ellipse cx="50" cy="50" rx="20"/>'
    '<rect x="10" y="10" width="20" height="9" ry="3"/>',
    "transforms": '<g transform="translate(50,50) rotate(30)"><rect x="-20" y="-10" width="40" height="20"/>'
    '<path transform="matrix(.5 .1 -.2 .5 3 4)" d="M0 0h40v20"/></g>'
    '<path transform="skewX(20)scale(1 .5)" d="M20 30v40h20"/>'
    '<path transform="rotate(90 20 80)" d="M20 80h15"/>',
    "a transform by CSS before the attribute": '<g transform="scale(9)" style="transform:scale(.5)">'
    '<path d="M9 9h60v50"/></g>',
    "use": '<defs><g id="leaf" transform="scale(.5)"><path d="M0 0C5-10 15-10 20 0z"/></g></defs>'
    '<use xlink:href="#leaf" x="10" y="50"/><g id="pair"><use href="#leaf" x="50" y="50"/></g>'
    '<use href="#pair" y="20" transform="rotate(10)"/>',
    "symbols": '<symbol id="s" viewBox="0 0 10 20"><path d="M1 1L9 19M9 1L1 19"/></symbol>'
    '<use href="#s" x="10" y="10" width="40" height="20"/><use href="#s" x="60" y="40" width="20" height="50"/>',
    "nested svg": '<svg x="10" y="10" width="50" height="30" viewBox="0 0 500 500">'
    '<path stroke-width="5" d="M0 0L400 300"/></svg>'
    '<svg x="10" y="60" width="50%" height="30" viewBox="0 -5 500 100" preserveAspectRatio="xMaxYMin">'
    '<path stroke-width="5" d="M0 0h400"/></svg>'
    '<svg x="70" y="5" width="20" height="80" viewBox="0 0 10 10" preserveAspectRatio="none">'
    '<circle stroke-width=".1" cx="5" cy="5" r="4"/></svg>',
    "a share of the page after a nested svg": '<svg width="10" height="10" viewBox="0 0 500 500"/>'
    '<line x1="10%" y1="20%" x2="90%" y2="80%"/>',
    "hidden layers": '<g style="display:none"><path d="M0 0L90 90"/></g><g visibility="hidden"><path d="M0 9L90 90"/>'
    '<path visibility="visible" d="M9 9h50"/></g><path display="none" d="M0 0h50"/><g opacity="0">'
    '<path d="M0 0v90"/></g>',
    "style sheets": "<style>/* .s{display:none} */"
    " .h, path.k{display:none} #m{transform:scale(.5)} .s{transform:scale(.25)}"
    ' @media print{.x{color:red}} .a .b{stroke-width:2}</style><path class="h" d="M0 0h80"/>'
    '<path class="s k" d="M0 9h80"/>'
    '<path id="m" class="s x" d="M10 50h80"/><line class="k" x1="9" x2="50" y1="70" y2="70"/>',
    "a style sheet after what it hides": '<path class="h" d="M0 0h80v80"/><path d="M10 60h50"/>'
    "<style>.h{display:none}</style>",
    "an important rule": "<style>.s{display:inline !important} path{display:none}</style>"
    '<path style="display:none" class="s" d="M10 50h80"/>',
    "a frame without paint": '<rect width="90" height="90" style="stroke:none"/><path d="M10 50h80"/>',
    "a clip path that cuts nothing": '<defs><clipPath id="c"><rect x="5" y="5" width="90" height="90"/>'
    '</clipPath></defs>'
    '<g clip-path="url(#c)" transform="scale(.9)"><path d="M5 5L95 95"/></g>',
    "no drawing of their own": '<clipPath id="c"><path d="M0 0h90"/></clipPath><marker id="m">'
    '<path d="M0 0h90"/></marker>'
    '<pattern id="p"><path d="M0 9h90"/></pattern><mask id="k"><path d="M9 0v90"/></mask>'
    '<path d="M20 20h40"/><text> </text>',
}  # fmt: skip


@pytest.mark.parametrize("name", DRAWN)
def test_strokes_lie_where_a_renderer_draws_them(tmp_path: Path, name: str) -> None:
    drawing = svg(f'<g fill="none" stroke="black" stroke-width=".5">{DRAWN[name]}</g>')
    shown = np.zeros((SIDE_MM * PX_A_MM,) * 2, np.uint8)
    for stroke in strokes_mm(tmp_path, drawing):
        pixels = np.round((stroke * PX_A_MM - 0.5) * 16).astype(np.int32)  # OpenCV counts from pixel centres
        cv2.polylines(shown, [pixels.reshape(-1, 1, 2)], False, 255, 1, cv2.LINE_AA, 4)
    png = bytes(svg_to_bytes(svg_string=drawing, width=len(shown), height=len(shown), dpi=96, background="white"))
    rendered = 255 - np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE))
    assert (rendered > 127).sum() > 100
    near = np.ones((7, 7), np.uint8)
    assert not ((shown > 127) & (cv2.dilate(rendered, near) < 40)).any(), "a stroke where nothing is drawn"
    assert not ((rendered > 127) & (cv2.dilate(shown, near) < 40)).any(), "a line without a stroke"


@pytest.mark.parametrize(
    ("page", "line", "expected_mm"),
    [
        ('width="200mm" height="100mm" viewBox="0 0 100 100"', "M10 50h80", 80),  # the smaller scale
        ('width="200mm" height="100mm" viewBox="0 0 100 100" preserveAspectRatio="none"', "M10 10v80", 80),
        ('width="200mm" height="100mm" viewBox="0 0 100 100" preserveAspectRatio="none"', "M10 10h80", 160),
        ('width="10cm" viewBox="0 0 200 50"', "M0 0h200", 100),
        ('height="1in" viewBox="0,0,50,100"', "M0 0v100", 25.4),
        ('width="72pt" height="6pc" viewBox="5 5 10 10"', "M5 5h10", 25.4),
        ('width="400Q" height="200mm" viewBox="0 0 10 10"', "M0 0h10", 100),
    ],
)
def test_a_user_unit_has_the_length_that_the_page_shows(
    tmp_path: Path, page: str, line: str, expected_mm: float
) -> None:
    drawing = f'<svg {XLINK} {page}><path d="{line}"/></svg>'
    assert lengths_mm(tmp_path, drawing) == [pytest.approx(expected_mm, rel=1e-6)]
    assert lengths_mm(tmp_path, drawing, 1e-3) == [pytest.approx(float(line.split("h")[-1].split("v")[-1]))]


MANY = '<g id="a0"><path d="M0 0h1"/></g>' + "".join(
    f'<g id="a{level}">' + f'<use href="#a{level - 1}"/>' * 10 + "</g>" for level in range(1, 9)
)
"""Parts that repeat each other a hundred million times."""


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ("<text>a</text>", "<text>: it is neither a path nor a basic shape"),
        ('<image href="a.png"/>', "<image>"),
        ('<switch><path d="M0 0h9"/></switch>', "<switch>"),
        ('<path d="M0 0h9"><animate attributeName="d"/></path>', "<animate>"),
        ('<use href="other.svg#a"/>', "'other.svg#a', which is not in this file"),
        ('<use href="#gone"/>', "no element 'gone'"),
        ('<g id="g"><use href="#g"/></g>', "'g' repeats itself"),
        ('<path id="p" mask="url(#m)" d="M0 0h9"/>', "<path id='p'>: the property mask"),
        ('<path filter="url(#m)" d="M0 0h9"/>', "the property filter"),
        ('<path stroke-dasharray="2 1" d="M0 0h9"/>', "dashed"),
        ('<clipPath id="c"><circle r="5"/></clipPath><path clip-path="url(#c)" d="M0 0h9"/>', "cuts a line off"),
        ('<svg width="50" height="50"><path d="M0 0h90"/></svg>', "its edge cuts a line off"),
        ('<svg width="9" height="5" viewBox="0 0 1 1" preserveAspectRatio="xMidYMid slice"/>', "slice"),
        ('<g style="transform: rotate3d(1,0,0,45deg)"/>', "rotate3d"),
        ('<g style="transform-origin: center; transform: scale(2)"/>', "transform-origin"),
        ('<g style="rotate: 45deg"/>', "rotate: 45deg"),
        ('<g transform="scale(2"/>', "'scale.2' cannot be read"),
        ('<rect width="5em" height="2"/>', "'5em' is of unknown size"),
        ('<path style="d: path(\'M0 0h9\')" d="M0 0h5"/>', "by a style sheet"),
        ("<style>g > path {display:none}</style>", "'g > path'"),
        ("<style>@media screen {path{transform:scale(2)}}</style>", "'@media screen'"),
        ("<style>@import url(a.css);</style>", "@import"),
        ("<style>path{", "cannot be read as SVG"),
        ('<path d="M0 0 L1"/>', "lacks numbers"),
        ('<path d="M0 0h1e400"/>', "too large"),
        ('<polyline points="0 0 1"/>', "odd number"),
        (f'<polyline points="{"1" * 5000}x"/>', "not a list of points"),
        ('<path display="none" d="M0 0h9"/>', "draws no line"),
        ("", "draws no line"),
        ("<g>" * 3000 + "</g>" * 3000, "too deep"),
    ],
)  # fmt: skip
def test_what_is_not_understood_is_refused_by_name(tmp_path: Path, content: str, named: str) -> None:
    with pytest.raises(ContractError, match=named):
        strokes_mm(tmp_path, svg(content))


def test_parts_that_repeat_each_other_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pentimento.svg.drawing._MAX_ELEMENTS", 1000)
    with pytest.raises(ContractError, match="more than 1000 times"):
        strokes_mm(tmp_path, svg(MANY))


def test_transforms_by_css_have_units(tmp_path: Path) -> None:
    style = "transform: translate(20px, 1in) rotate(.25turn) scaleX(50%) translateY(10px)"
    (stroke,) = strokes_mm(tmp_path, svg(f'<g style="{style}"><path d="M0 0h60"/></g>'))
    np.testing.assert_allclose(stroke, [[10, 96], [10, 126]], atol=1e-9)


@pytest.mark.parametrize(
    ("page", "sentence"),
    [
        ("", "no width as a length"),
        ('width="100" viewBox="0 0 1 1"', "'100' is no length in mm"),
        ('width="100%" viewBox="0 0 1 1"', "'100%' is no length in mm"),
        ('width="100mm" height="100%" viewBox="0 0 1 1"', "no height as a length"),
        ('width="100mm"', "no viewBox"),
        ('width="100mm" viewBox="0 0 0 1"', "has no size"),
        ('width="100mm" viewBox="0 0 1"', "not four numbers"),
        ('width="1mm" height="2mm" viewBox="0 0 1 1" preserveAspectRatio="middle"', "'middle' is unknown"),
        ('width="1mm" viewBox="0 0 1 1" filter="url(#f)"', "the property filter"),
        ('width="1mm" viewBox="0 0 1 1" transform="scale(2)"', "outermost svg has a transform"),
    ],
)
def test_a_page_of_unknown_size_is_refused(tmp_path: Path, page: str, sentence: str) -> None:
    with pytest.raises(ContractError, match=sentence):
        strokes_mm(tmp_path, f'<svg {XLINK} {page}><path d="M0 0h1"/></svg>')


def test_other_files_are_no_drawings(tmp_path: Path) -> None:
    for text, sentence in (
        ("<html/>", "holds <html> and no <svg>"),
        ('<?xml-stylesheet href="a.css"?><svg/>', "in another file"),
        ("M0 0", "cannot be read as SVG"),
        ('<?xml version="1.0" encoding="no-such"?><svg/>', "cannot be read as SVG"),
    ):
        with pytest.raises(ContractError, match=sentence):
            strokes_mm(tmp_path, text)


def test_a_subpath_after_a_closed_one_begins_where_that_ended(tmp_path: Path) -> None:
    first, second = strokes_mm(tmp_path, svg('<path d="M10 10h20v10zl5 40"/>'))
    np.testing.assert_allclose(first[-1], [10, 10])
    np.testing.assert_allclose(second, [[10, 10], [15, 50]])
