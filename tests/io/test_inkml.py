"""Tests of the import of InkML."""

from pathlib import Path

import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.errors import ContractError
from pentimento.io.inkml import read_inkml
from pentimento.io.pen_files import commanded
from tests.io.pens import INKML, STEP_MS, STROKES_MM, assert_places, demonstrations, inkml, saved, traces

DOWN = [1.0, -1.0]


def trace_format(units: str = 'units="mm"', more: str = "", kind: str = "decimal") -> str:
    named = "".join(f'<channel name="{name}" type="{kind}" {units}/>' for name in "XY")
    return f"<traceFormat>{named}{more}</traceFormat>"


@pytest.mark.parametrize(
    ("units", "per_mm", "options"),
    [
        ('units="mm"', 1.0, ()),
        ('units="cm"', 0.1, ()),
        ('units="in"', 1 / 25.4, ()),
        ("", 1.0, ("--units", "mm")),
        ("", 100.0, ("--units", "0.01 mm")),
    ],
)
def test_places_are_read_in_their_unit_with_y_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], units: str, per_mm: float, options: tuple[str, ...]
) -> None:
    values = [stroke * DOWN * per_mm for stroke in STROKES_MM]
    text = "".join(f"<trace>{','.join(f'{x:.9f} {y:.9f}' for x, y in each)}</trace>" for each in values)
    assert_places(demonstrations(inkml(tmp_path, trace_format(units) + text), *options), STROKES_MM)
    assert "y points down: flipped, as InkML defines it where" in capsys.readouterr().out


def test_each_axis_may_have_its_own_unit_and_direction(tmp_path: Path) -> None:
    channels = '<channel name="X" units="cm" orientation="-ve"/><channel name="Y" units="m" orientation="-ve"/>'
    values = [stroke * [-0.1, 1e-3] for stroke in STROKES_MM]
    path = inkml(tmp_path, f"<traceFormat>{channels}</traceFormat>" + traces(values))
    assert_places(demonstrations(path), STROKES_MM)
    mirrored = [stroke * DOWN for stroke in STROKES_MM]
    assert_places(demonstrations(path, "--y-up"), mirrored)


def test_whole_numbers_of_a_device_have_its_resolution(tmp_path: Path) -> None:
    """As Office writes it: the channel's units are those of its range."""
    properties = "".join(f'<channelProperty channel="{c}" name="resolution" value="1000" units="1/cm"/>' for c in "XY")
    whole = trace_format('units="cm"', kind="integer")
    source = f"<inkSource>{whole}<channelProperties>{properties}"
    head = f'<definitions><context xml:id="c">{source}</channelProperties></inkSource></context></definitions>'
    text = traces([stroke * DOWN * 100 for stroke in STROKES_MM]).replace("<trace>", '<trace contextRef="#c">')
    assert_places(demonstrations(inkml(tmp_path, head + text)), STROKES_MM)


@pytest.mark.parametrize(("orientation", "sign"), [("", -1), ('orientation="+ve"', -1), ('orientation="-ve"', 1)])
def test_y_grows_downwards_unless_its_orientation_is_negative(tmp_path: Path, orientation: str, sign: int) -> None:
    """The recommendation's table of channel names: Y increases downward for +ve, the default."""
    head = f'<traceFormat><channel name="X" units="mm"/><channel name="Y" units="mm" {orientation}/></traceFormat>'
    found = demonstrations(inkml(tmp_path, head + traces(STROKES_MM)))
    assert_places(found, [stroke * [1, sign] for stroke in STROKES_MM])


def test_heights_and_tilts_have_orientations_too(tmp_path: Path) -> None:
    def read(orientation: str) -> tuple[np.ndarray, dict]:
        more = f'<channel name="Z" units="mm" {orientation}/><channel name="OTy" units="deg" {orientation}/>'
        ((points, about),) = read_inkml(
            inkml(tmp_path, trace_format(more=more) + "<trace>1 2 -1 30,3 2 -2 50</trace>"), None
        ).strokes
        return points, about

    (points, about), (turned, turned_about) = read(""), read('orientation="-ve"')
    np.testing.assert_allclose(points[:, 3], [-1e-3, -2e-3], atol=1e-12)
    np.testing.assert_allclose(turned[:, 3], [1e-3, 2e-3], atol=1e-12)
    assert about["tilt_y_rad"] == pytest.approx(np.radians(40)) == -turned_about["tilt_y_rad"]


def test_differences_are_summed(tmp_path: Path) -> None:
    """The example of the recommendation, section 3.2.1: explicit, then velocities, then accelerations."""
    text = """<trace>1125 18432,'23'43,"7"-8,3-5,7 -3,6 2,6 8,3 6,2 9</trace>"""
    steps = np.array([[23, 43], [7, -8], [3, -5], [7, -3], [6, 2], [6, 8], [3, 6], [2, 9]])
    places = np.array([1125, 18432]) + np.vstack([[0, 0], np.cumsum(np.cumsum(steps, axis=0), axis=0)])
    (found,) = read_inkml(inkml(tmp_path, text), 1e-5).strokes
    np.testing.assert_allclose(found.points[:, 1:3], 1e-5 * places, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "10 40,13 38,15 30,15 20",
        "10 40,'3'-2,2-8,0-10",
        "10 40,'3'-2,!15!30,15 20",
        """10 40,'3'-2,"-1"-6,-2-2""",
        "#A #28,#D #26,#F #1E,#F #14",
        "10 40,13 38,'+2 '-8,!*!20",
        "1e1 40.,\n13 3.8E1 ,15 30,15 20",
    ],
)
def test_every_encoding_gives_the_same_stroke(tmp_path: Path, text: str) -> None:
    (found,) = read_inkml(inkml(tmp_path, trace_format() + f"<trace>{text}</trace>"), None).strokes
    np.testing.assert_allclose(1e3 * found.points[:, 1:3], [[10, 40], [13, 38], [15, 30], [15, 20]], atol=1e-9)


def test_times_forces_tilts_and_brushes(tmp_path: Path) -> None:
    channels = (
        '<channel name="T" units="ms"/><channel name="F" max="200"/><channel name="OTx" units="deg"/>'
        '<intermittentChannels><channel name="S" type="boolean"/></intermittentChannels>'
    )
    brush = (
        '<brush xml:id="b"><brushProperty name="color" value="#ff0000"/>'
        '<brushProperty name="width" value="0.5" units="mm"/></brush>'
    )
    text = '<trace brushRef="#b">1 2 1000 50 30,2 2 1020 100 60 T,3 2 1040 200 90 F</trace>'
    strokes = read_inkml(
        inkml(tmp_path, f"<definitions>{brush}</definitions>{trace_format(more=channels)}{text}"), None
    ).strokes
    ((points, about),) = strokes
    np.testing.assert_allclose(points[:, 0], [1.0, 1.02, 1.04])
    np.testing.assert_allclose(points[:, 4], [0.25, 0.5, 1.0])
    assert about["tool_id"] == "b" and about["color_srgb"] == [1.0, 0.0, 0.0]
    assert about["brush_width_m"] == pytest.approx(5e-4) and about["tilt_x_rad"] == pytest.approx(np.pi / 3)


def test_a_context_holds_for_the_traces_after_it(tmp_path: Path) -> None:
    in_mm, in_cm = trace_format().replace("<traceFormat", "<traceFormat xml:id='mm'"), trace_format('units="cm"')
    head = f"<definitions>{in_mm}</definitions>"
    text = "<context traceFormatRef='#mm'/><trace>1 2,3 4</trace><traceGroup><context>"
    text += f"{in_cm}</context><trace>1 2,3 4</trace></traceGroup><trace>1 2,3 4</trace>"
    found = [1e3 * stroke.points[1, 1:3] for stroke in read_inkml(inkml(tmp_path, head + text), None).strokes]
    np.testing.assert_allclose(found, [[3, 4], [30, 40], [3, 4]])


def test_parts_of_a_trace_are_joined_and_lifted_pens_left_out(tmp_path: Path) -> None:
    text = (
        '<trace xml:id="a" continuation="begin">1 2,3 4</trace><trace type="penUp">3 4,9 9</trace>'
        '<trace xml:id="b" continuation="end" priorRef="#a">5 6</trace>'
    )
    (found,) = read_inkml(inkml(tmp_path, trace_format() + text), None).strokes
    np.testing.assert_allclose(1e3 * found.points[:, 1:3], [[1, 2], [3, 4], [5, 6]])


def test_what_was_assumed_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    channels = '<channel name="T"/><channel name="F"/>'
    values = [
        np.column_stack([stroke * DOWN, STEP_MS * np.arange(len(stroke)), 10 + np.arange(len(stroke))])
        for stroke in STROKES_MM
    ]
    first, second = demonstrations(inkml(tmp_path, trace_format(more=channels) + traces(values)))
    printed = capsys.readouterr().out
    assert "Times have no unit: ms." in printed
    assert "the largest force in the file, 13, counts as 1" in printed
    np.testing.assert_allclose(first[:, 0], 1e-3 * STEP_MS * np.arange(len(first)), atol=1e-6)
    np.testing.assert_allclose(second[:, 4], (10 + np.arange(len(second))) / 13, atol=1e-6)


BOMB = '<!DOCTYPE ink [<!ENTITY a0 "ha">' + "".join(
    f"<!ENTITY a{n} '{10 * ('&a' + str(n - 1) + ';')}'>" for n in range(1, 10)
)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("<ink><trace>1 2", "cannot be read as InkML"),
        ("no ink", "cannot be read as InkML"),
        (f"{BOMB}]><ink><trace>&a9;</trace></ink>", "cannot be read as InkML"),
        ('<!DOCTYPE ink [<!ENTITY a SYSTEM "/etc/passwd">]><ink><trace>&a;</trace></ink>', "cannot be read as InkML"),
        ("<svg/>", "holds <svg> and no <ink>"),
        ("<ink/>", "holds no <trace> with the pen down"),
        ("<ink><trace xml:id='t'>1 2,3</trace></ink>", r"<trace id='t'> \(number 0, from 0\): point 1 has 1 values"),
        ("<ink><trace>1 2,3 4 5</trace></ink>", "point 1 has more values than the 2 channels"),
        ("<ink><trace>1 2,3 x</trace></ink>", "point 1 holds 'x', which is no number"),
        ("<ink><trace>'1 2</trace></ink>", "a difference has no value before it"),
        ('<ink><trace>1 2,"3 4</trace></ink>', "a second difference has no difference before it"),
        ("<ink><trace>1 2,'3'*</trace></ink>", "among differences"),
        ("<ink><trace contextRef='#c'>1 2</trace></ink>", "refers to '#c', which is no <context> of this file"),
        ("<ink><trace continuation='end' priorRef='#a'>1 2</trace></ink>", "continues 'a', which is no trace"),
        ("<ink><traceFormat><channel name='X'/></traceFormat><trace>1</trace></ink>", "has no channel Y"),
        (
            "<ink><traceFormat><channel name='X'/><channel name='Y' orientation='up'/></traceFormat>"
            "<trace>1 2</trace></ink>",
            "the orientation of channel Y is 'up'",
        ),
        ("<ink><canvasTransform><mapping type='affine'/></canvasTransform></ink>", "'affine' is not supported"),
    ],
)
def test_a_malformed_file_is_one_sentence(tmp_path: Path, content: str, said: str) -> None:
    path = saved(tmp_path / "bad.inkml", content.replace("<ink", f'<ink xmlns="{INKML}"', 1))
    with pytest.raises(ContractError, match=said) as caught:
        read_inkml(path, 1e-3)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_contexts_that_refer_to_each_other_end_in_a_sentence(tmp_path: Path) -> None:
    head = '<context xml:id="a" contextRef="#b"/><context xml:id="b" contextRef="#a"/>'
    with pytest.raises(ContractError, match="too deep"):
        read_inkml(inkml(tmp_path, f"<definitions>{head}</definitions><trace contextRef='#a'>1 2</trace>"), 1e-3)


def test_a_unit_is_given_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = inkml(tmp_path, trace_format() + "<trace>1 2,3 4</trace>")
    command = ["import", str(path), "--hand", "ann", "--out", str(tmp_path / "out")]
    assert main([*command, "--units", "cm"]) == 1
    assert "leave --units out" in capsys.readouterr().err
    inkml(tmp_path, "<trace>1 2,3 4</trace>")
    assert main(command) == 1
    assert "has no unit of length of its channel X; give --units" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_unit_of_a_notebook_s_ink_is_known(tmp_path: Path) -> None:
    """OneNote counts in himetric, hundredths of a millimetre."""
    text = traces([stroke * DOWN * 100 for stroke in STROKES_MM])
    assert_places(demonstrations(inkml(tmp_path, trace_format('units="himetric"') + text)), STROKES_MM)


def test_forces_may_begin_below_zero(tmp_path: Path) -> None:
    force = '<channel name="F" min="{}" max="32767"/>'
    text = trace_format(more=force.format(-32768)) + "<trace>1 2 -32768,3 4 32767</trace>"
    (stroke,) = read_inkml(inkml(tmp_path, text), None).strokes
    np.testing.assert_allclose(stroke.points[:, 4], [0, 1])
    for least, values in ((0, "1 2 -1,3 4 1"), (0, "1 2 0,3 4 65535")):
        text = trace_format(more=force.format(least)) + f"<trace>{values}</trace>"
        with pytest.raises(ContractError, match="forces below 0 or above its own largest"):
            read_inkml(inkml(tmp_path, text), None)


def test_an_empty_trace_is_counted_as_a_stroke_that_cannot_be_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = trace_format() + "<trace/>" + traces([stroke * DOWN for stroke in STROKES_MM])
    assert_places(demonstrations(inkml(tmp_path, text)), STROKES_MM)
    assert "Refused: 1 × it stays at one place (0)." in capsys.readouterr().out
    (first, *_) = commanded(read_inkml(inkml(tmp_path, text), None), 1e-3, tmp_path)
    assert first.fault == "it has fewer than 2 points"
