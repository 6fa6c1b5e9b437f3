"""Height maps, meshes and pictures as goals: known geometry is recovered, and bad files raise clear errors."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image

from pentimento.contracts.errors import ImageError
from pentimento.contracts.height_maps import encode_height_png
from pentimento.contracts.images import read_image
from pentimento.goals3d import mesh_files
from pentimento.goals3d.sources import height_file_relief, mesh_relief, plain_relief, relief_of, top_of
from pentimento.planning.pushes.goal import GoalError
from pentimento.semantics.depth import depth_relief

RAMP = np.tile(np.linspace(0.01, 0.03, 24), (16, 1))


def test_reads_heights_from_png_and_npy(tmp_path: Path) -> None:
    np.save(tmp_path / "ramp.npy", RAMP)
    (tmp_path / "ramp.png").write_bytes(encode_height_png(RAMP, 1e-6))
    heights, holes = height_file_relief(tmp_path / "ramp.npy")
    np.testing.assert_array_equal(heights, RAMP)
    units, _ = height_file_relief(tmp_path / "ramp.png")
    np.testing.assert_allclose(units, RAMP / 1e-6, atol=0.51)
    assert holes == 0


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_black_ground_of_a_height_file_is_its_lowest_height(tmp_path: Path, suffix: str) -> None:
    frame = np.zeros((32, 32), np.uint16)
    frame[8:24, 8:24] = 60_000
    frame[12:20, 12:20] = 30_000
    cv2.imwrite(str(tmp_path / f"frame{suffix}"), frame)
    heights, holes = height_file_relief(tmp_path / f"frame{suffix}")
    np.testing.assert_array_equal(heights, frame)
    assert holes == 0
    relief = relief_of(str(tmp_path / f"frame{suffix}"), (32, 32), 1.0, soften_px=0)
    np.testing.assert_array_equal(relief, frame)


def test_holes_that_are_filled_are_told(tmp_path: Path) -> None:
    holed = RAMP.astype(np.float32)
    holed[5:8, 10:12] = np.nan
    np.save(tmp_path / "holed.npy", holed)
    Image.fromarray(holed).save(tmp_path / "holed.tif")
    for name in ("holed.npy", "holed.tif"):
        told: list[str] = []
        relief = relief_of(str(tmp_path / name), RAMP.shape, 1.0, soften_px=0, tell=told.append)
        assert "6 of 384 heights were not measured" in told[0]
        assert np.abs(relief - RAMP).max() <= RAMP[0, 1] - RAMP[0, 0]


def test_sixteen_bits_of_colour_or_alpha_are_refused(tmp_path: Path) -> None:
    for channels in (3, 4):
        cv2.imwrite(str(tmp_path / "deep.png"), np.zeros((8, 8, channels), np.uint16))
        with pytest.raises(ImageError, match="save heights as 16-bit grey without alpha, a picture as 8-bit"):
            relief_of(str(tmp_path / "deep.png"), (8, 8), 1.0, soften_px=0)


def test_grey_of_8_bits_is_a_height_map_on_request(tmp_path: Path) -> None:
    grey = np.arange(0, 256, 4, dtype=np.uint8).reshape(8, 8)
    cv2.imwrite(str(tmp_path / "grey.png"), grey)
    relief = relief_of(f"heights:{tmp_path / 'grey.png'}", (8, 8), 1.0, soften_px=0)
    np.testing.assert_array_equal(relief, grey)
    cv2.imwrite(str(tmp_path / "colour.png"), np.dstack([grey, grey, 255 - grey]))
    with pytest.raises(GoalError, match="is in colour"):
        relief_of(f"heights:{tmp_path / 'colour.png'}", (8, 8), 1.0, soften_px=0)


def test_fills_and_counts_holes_of_height_file(tmp_path: Path) -> None:
    holed = RAMP.copy()
    holed[5:8, 10:12] = np.nan
    np.save(tmp_path / "holed.npy", holed)
    filled, count = height_file_relief(tmp_path / "holed.npy")
    assert count == 6
    assert np.abs(filled - RAMP).max() <= RAMP[0, 1] - RAMP[0, 0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (np.full((8, 8), np.nan), "64 of 64 pixels are holes"),
        (np.array([[1.0, np.inf], [0, 0]]), "infinite"),
        (np.zeros((8, 8, 3)), r"a height map is real numbers \[h, w\]"),
        (np.zeros((8, 8), complex), "complex"),
    ],
)
def test_rejects_invalid_height_arrays(tmp_path: Path, content: np.ndarray, message: str) -> None:
    np.save(tmp_path / "bad.npy", content)
    with pytest.raises(GoalError, match=message):
        height_file_relief(tmp_path / "bad.npy")


def test_rejects_broken_height_file(tmp_path: Path) -> None:
    (tmp_path / "bad.npy").write_bytes(b"not an array")
    with pytest.raises(GoalError, match="cannot be read as a height map"):
        height_file_relief(tmp_path / "bad.npy")


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
def test_mesh_relief_of_sphere_is_dome(tmp_path: Path, suffix: str) -> None:
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    sphere.export(tmp_path / f"sphere{suffix}")
    top = mesh_relief(tmp_path / f"sphere{suffix}", 65)
    x = np.linspace(-1, 1, 66)[:-1] + 1 / 65
    expected = np.sqrt(np.clip(1 - x**2 - x[:, None] ** 2, 0, None))
    inside = expected > 0.4
    np.testing.assert_allclose(top[inside], expected[inside], atol=0.03)
    assert top[0, 0] == pytest.approx(-1.0, abs=0.01)  # outside the mesh: its lowest height


def test_mesh_relief_orientation() -> None:
    left_top = np.array([[[0, 0.5, 1.0], [0, 1, 1.0], [0.5, 1, 1.0]], [[0, 0, 0], [1, 0, 0], [1, 1, 0]]], float)
    top = top_of(left_top, 40)
    assert top[2, 2] == 1.0 and top[-2, -2] == 0.0


def test_mesh_relief_hides_lower_faces() -> None:
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], float)
    both = np.concatenate([square + np.array([0, 0, 2.0]), square])
    np.testing.assert_array_equal(top_of(both, 16), np.full((16, 16), 2.0))
    np.testing.assert_array_equal(top_of(both[::-1].copy(), 16), np.full((16, 16), 2.0))


def test_mesh_relief_supports_any_up_axis(tmp_path: Path) -> None:
    trimesh.creation.box(extents=(2.0, 4.0, 1.0)).export(tmp_path / "box.stl")
    assert mesh_relief(tmp_path / "box.stl", 32, "z").shape == (32, 16)
    assert mesh_relief(tmp_path / "box.stl", 32, "x").shape == (8, 32)


def test_an_obj_needs_its_up_axis_and_is_then_seen_from_above(tmp_path: Path) -> None:
    # An L of 30 by 40 and 5 to 9 high, y up: its stem on the left, its foot towards the viewer, at z = 0.
    boxes = ((0, 0, -10, 30, 5, 0), (0, 0, -40, 10, 9, -10))
    meshes = [trimesh.creation.box(bounds=[box[:3], box[3:]]) for box in boxes]
    trimesh.util.concatenate(meshes).export(tmp_path / "l.obj")
    with pytest.raises(GoalError, match="does not say which of its axes points up"):
        relief_of(str(tmp_path / "l.obj"), (40, 40), 1.0, soften_px=0)
    relief = relief_of(str(tmp_path / "l.obj"), (40, 30), 1.0, soften_px=0, up="y")
    wanted = np.zeros((40, 30))
    wanted[:30, :10], wanted[30:] = 9, 5
    np.testing.assert_array_equal(relief, wanted)
    flat = np.array([[0, 1], [2, 3]])
    upright = relief_of(str(tmp_path / "l.obj"), (40, 40), 1.0, soften_px=0, up="z")
    assert upright.shape != flat.shape and not np.array_equal(upright, relief)


def test_faces_of_an_obj_may_count_back_in_each_object(tmp_path: Path) -> None:
    square = "v {x} 0 {z}\nv {x1} 0 {z}\nv {x1} 1 {z}\nv {x} 1 {z}\nusemtl {z}\nf -4//-1 -3//-1 -2//-1 -1//-1\n"
    left, right = square.format(x=0, x1=1, z=2), square.format(x=1, x1=2, z=1)
    (tmp_path / "two.obj").write_text(f"o a\n{left}o b\n{right}")
    np.testing.assert_array_equal(mesh_relief(tmp_path / "two.obj", 4), [[2, 2, 1, 1]] * 2)
    (tmp_path / "bom.obj").write_bytes(b"\xef\xbb\xbf" + f"{left}{right}".replace("\n", "\r\n").encode())
    np.testing.assert_array_equal(mesh_relief(tmp_path / "bom.obj", 4), [[2, 2, 1, 1]] * 2)


def ply_of(vertices: list[tuple[float, float, float]], faces: list[list[int]], kind: str) -> bytes:
    """A PLY whose vertices have a colour before their places, and whose faces have texture coordinates."""
    header = (
        f"ply\nformat {kind} 1.0\ncomment by hand\nelement vertex {len(vertices)}\nproperty uchar red\n"
        "property float x\nproperty float y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar float texcoord\nproperty list uint8 int vertex_index\n"
        "end_header\n"
    ).encode()
    if kind == "ascii":
        lines = [f"9 {x} {y} {z}" for x, y, z in vertices] + [f"2 0 1 {len(f)} {' '.join(map(str, f))}" for f in faces]
        return (header.decode() + "\n".join(lines) + "\n").replace("\n", "\r\n").encode()
    order = "<" if "little" in kind else ">"
    body = b"".join(struct.pack(f"{order}Bffd", 9, *vertex) for vertex in vertices)
    return header + body + b"".join(struct.pack(f"{order}BffB{len(f)}i", 2, 0.0, 1.0, len(f), *f) for f in faces)


@pytest.mark.parametrize("start", range(6))
@pytest.mark.parametrize("turn", [1, -1])
def test_the_notch_of_a_polygon_stays_open(tmp_path: Path, start: int, turn: int) -> None:
    ell = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)]
    corners = (ell[start:] + ell[:start])[::turn]
    square = ((-2, -2), (6, -2), (6, 6), (-2, 6))
    lines = [f"v {x} {y} 1" for x, y in corners] + ["f 1 2 3 4 5 6"]
    lines += [f"v {x} {y} 0" for x, y in square] + ["f 7 8 9 10"]
    (tmp_path / "ell.obj").write_text("\n".join(lines))
    wanted = np.zeros((8, 8))
    wanted[2:6, 2] = wanted[5, 2:6] = 1
    np.testing.assert_array_equal(mesh_relief(tmp_path / "ell.obj", 8), wanted)
    vertices = [(x, y, 1) for x, y in corners] + [(x, y, 0) for x, y in square]
    for kind in ("ascii", "binary_little_endian", "binary_big_endian"):
        (tmp_path / "ell.ply").write_bytes(ply_of(vertices, [list(range(6)), [6, 7, 8, 9]], kind))
        np.testing.assert_array_equal(mesh_relief(tmp_path / "ell.ply", 8), wanted)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_ply_that_is_not_whole_is_refused(tmp_path: Path, kind: str) -> None:
    vertices = [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    whole = ply_of(vertices, [[0, 1, 2], [0, 2, 3]], kind)
    (tmp_path / "mesh.ply").write_bytes(whole)
    assert mesh_relief(tmp_path / "mesh.ply", 4).min() == 1
    last = whole[:-2].rindex(b"\n") if kind == "ascii" else len(whole) - 22
    for end in (last, len(whole) - 3, len(whole) // 2, 40):
        (tmp_path / "mesh.ply").write_bytes(whole[:end])
        with pytest.raises(GoalError, match=r"cut off|has no end"):
            mesh_relief(tmp_path / "mesh.ply", 4)
    for wrong, sentence in (([0, 1], "less than three corners"), ([0, 1, 4], "one that is no vertex")):
        (tmp_path / "mesh.ply").write_bytes(ply_of(vertices, [[0, 1, 2], wrong], kind))
        with pytest.raises(GoalError, match=sentence):
            mesh_relief(tmp_path / "mesh.ply", 4)
    (tmp_path / "mesh.ply").write_bytes(whole + b"1 2")
    with pytest.raises(GoalError, match=r"more .* follow than its header tells"):
        mesh_relief(tmp_path / "mesh.ply", 4)


def test_a_ply_of_points_or_strips_is_refused(tmp_path: Path) -> None:
    vertex = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    header = f"ply\nformat ascii 1.0\n{vertex}{{}}end_header\n"
    points = "0 0 0\n1 0 0\n0 1 0\n"
    (tmp_path / "points.ply").write_text(header.format("") + points)
    with pytest.raises(GoalError, match="has no faces"):
        mesh_relief(tmp_path / "points.ply", 4)
    strips = "element tristrips 1\nproperty list int int vertex_indices\n"
    (tmp_path / "strips.ply").write_text(header.format(strips) + points + "3 0 1 2\n")
    with pytest.raises(GoalError, match="its faces are strips of triangles; export plain triangles"):
        mesh_relief(tmp_path / "strips.ply", 4)


def test_an_obj_that_was_cut_off_between_its_lines_is_refused(tmp_path: Path) -> None:
    vertices, faces = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n", ("f 1 2 3\n", "f 1 3 4\n")
    (tmp_path / "cut.obj").write_text(vertices + faces[0])
    with pytest.raises(GoalError, match="1 of its 4 vertices are in no face, so the file may be cut off"):
        mesh_relief(tmp_path / "cut.obj", 4)
    for comment in ("# 2 faces", "# Faces: 2", "#faces 2"):
        (tmp_path / "cut.obj").write_text(f"{comment}\n{vertices}f 1 2 4\nl 3 2\n")
        with pytest.raises(GoalError, match="its comments tell of 2 faces, and it has 1"):
            mesh_relief(tmp_path / "cut.obj", 4)
        (tmp_path / "whole.obj").write_text(f"{comment}\n# Vertices: 4\n{vertices}{''.join(faces)}")
        assert mesh_relief(tmp_path / "whole.obj", 4).shape == (4, 4)


def test_an_ascii_stl_that_was_cut_off_between_its_facets_is_refused(tmp_path: Path) -> None:
    text = trimesh.creation.box().export(file_type="stl_ascii")
    (tmp_path / "cut.stl").write_text(text[: text.index("endfacet", len(text) // 2) + len("endfacet")])
    with pytest.raises(GoalError, match="does not end with 'endsolid'"):
        mesh_relief(tmp_path / "cut.stl", 8)


def test_heights_that_a_geotiff_marks_as_not_measured_are_holes(tmp_path: Path) -> None:
    heights = np.full((8, 8), 100.0, np.float32)
    heights[3:5, 3:5] = 120
    for mark, kind in (("-9999", np.float32), ("-3.4028234663852886e+38", np.float32), ("-32768", np.int16)):
        holed = heights.astype(kind)
        holed[0, :3] = np.float32(mark) if kind is np.float32 else kind(mark)
        Image.fromarray(holed.astype(np.int32) if kind is np.int16 else holed).save(
            tmp_path / "dem.tif", tiffinfo={42113: mark}
        )
        filled, count = height_file_relief(tmp_path / "dem.tif")
        np.testing.assert_allclose(filled, heights, atol=0.1)  # filled from neighbours
        assert count == 3


def test_heights_that_count_from_white_are_turned(tmp_path: Path) -> None:
    grey = np.linspace(0, 65535, 48).astype(np.uint16).reshape(6, 8)
    (tmp_path / "grey.tif").write_bytes(white_is_zero(65535 - grey))
    np.testing.assert_array_equal(height_file_relief(tmp_path / "grey.tif")[0], grey)
    np.testing.assert_array_equal(read_image(tmp_path / "grey.tif")[..., 0], np.rint(grey / 257))


def white_is_zero(stored: np.ndarray) -> bytes:
    """A TIFF whose photometric interpretation is 0, from one that has 1."""
    written = io.BytesIO()
    Image.fromarray(stored).save(written, "TIFF")
    photometric = struct.pack("<HHIHH", 262, 3, 1, 1, 0)
    assert written.getvalue().count(photometric) == 1
    return written.getvalue().replace(photometric, struct.pack("<HHIHH", 262, 3, 1, 0, 0))


def test_an_archive_of_arrays_is_no_height_map(tmp_path: Path) -> None:
    with (tmp_path / "map.npy").open("wb") as file:
        np.savez(file, heights=RAMP)
    with pytest.raises(GoalError, match="it is an archive of arrays"):
        height_file_relief(tmp_path / "map.npy")


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("f 0 1 2", "line 4, 'f 0 1 2', is broken"),
        ("f 1 2 -4", "line 4, 'f 1 2 -4', is broken"),
        ("f 1 2", "less than three corners"),
        ("f 1 2 9", "a corner that is no vertex"),
        ("v 1 2", "line 4, 'v 1 2', is broken"),
    ],
)
def test_broken_lines_of_an_obj_are_named(tmp_path: Path, line: str, sentence: str) -> None:
    (tmp_path / "bad.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\n")
    with pytest.raises(GoalError, match=sentence):
        mesh_relief(tmp_path / "bad.obj", 8)


def test_rejects_unusable_meshes(tmp_path: Path) -> None:
    (tmp_path / "empty.obj").write_text("# nothing\n")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    (tmp_path / "nan.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "wall.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n")
    (tmp_path / "broken.stl").write_bytes(b"solid ")
    for name in ("empty.obj", "points.obj", "broken.stl"):
        with pytest.raises(GoalError, match=r"cannot be read as a mesh|has no faces"):
            mesh_relief(tmp_path / name, 16)
    with pytest.raises(GoalError, match=r"not finite|has no faces"):  # trimesh drops invalid vertices
        mesh_relief(tmp_path / "nan.obj", 16)
    with pytest.raises(GoalError, match="Seen from above, the mesh measures 1 by 0"):
        mesh_relief(tmp_path / "wall.obj", 16)


def test_plain_relief_maps_bright_to_high() -> None:
    picture = np.zeros((40, 60, 3), np.uint8)
    picture[:20] = 255
    relief = plain_relief(picture)
    assert relief[2].min() > 0.95 and relief[-2].max() < 0.05
    assert (np.diff(relief[:, 30]) <= 1e-9).all()


def test_plain_relief_of_a_large_picture_is_that_of_a_small_one() -> None:
    small = np.zeros((40, 60, 3), np.uint8)
    small[:20, 10:] = 200
    large = np.repeat(np.repeat(small, 40, axis=0), 40, axis=1)
    relief = plain_relief(large)
    assert relief.shape == (683, 1024)
    shrunk = cv2.resize(relief, (60, 40), interpolation=cv2.INTER_AREA)
    assert np.abs(shrunk - plain_relief(small)).max() < 0.06


def test_depth_relief_uses_local_depth_model(tmp_path: Path) -> None:
    import torch
    from transformers import DepthAnythingConfig, DepthAnythingForDepthEstimation, Dinov2Config, DPTImageProcessor

    backbone = Dinov2Config(
        hidden_size=16, num_hidden_layers=2, num_attention_heads=2, mlp_ratio=1, image_size=28, patch_size=14,
        out_features=["stage1", "stage2"], reshape_hidden_states=False, apply_layernorm=True,
    )  # fmt: skip
    torch.manual_seed(0)
    model = DepthAnythingForDepthEstimation(
        DepthAnythingConfig(
            backbone_config=backbone, reassemble_hidden_size=16, patch_size=14, reassemble_factors=[1, 0.5],
            neck_hidden_sizes=[8, 8], fusion_hidden_size=8, head_hidden_size=8,
        )
    )  # fmt: skip
    model.save_pretrained(tmp_path)
    DPTImageProcessor(size={"height": 28, "width": 28}, ensure_multiple_of=14).save_pretrained(tmp_path)
    picture = np.random.default_rng(0).integers(0, 256, (30, 40, 3), dtype=np.uint8)
    near = depth_relief(picture, tmp_path)
    assert near.shape == (30, 40) and np.ptp(near) > 0 and near.min() >= 0  # inverse depth
    weights = tmp_path / "model.safetensors"
    whole = weights.read_bytes()
    for broken in (whole[: len(whole) // 2], b"version https://git-lfs.github.com/spec/v1\n"):
        weights.write_bytes(broken)
        with pytest.raises(GoalError, match=r"model\.safetensors is (cut off|a pointer)"):
            depth_relief(picture, tmp_path)
    model.config.depth_estimation_type = "metric"
    model.config.max_depth = 1
    model.save_pretrained(tmp_path)
    assert depth_relief(picture, tmp_path).max() <= 0  # metres away from the eye


def test_rejects_folder_without_depth_model(tmp_path: Path) -> None:
    with pytest.raises(GoalError, match="holds no depth model"):
        depth_relief(np.zeros((8, 8, 3), np.uint8), tmp_path)


def test_relief_of_dispatches_on_source(tmp_path: Path) -> None:
    np.save(tmp_path / "ramp.npy", RAMP)
    (tmp_path / "ramp.png").write_bytes(encode_height_png(RAMP, 1e-6))
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((8, 8, 3), 99, np.uint8))
    trimesh.creation.box(extents=(1, 1, 1)).export(tmp_path / "box.ply")
    for source in (
        "letter:A",
        "shape:dome",
        *(str(tmp_path / n) for n in ("ramp.npy", "ramp.png", "photo.png", "box.ply")),
    ):
        assert relief_of(source, (32, 32), 0.8, soften_px=1.0).shape == (32, 32)
    with pytest.raises(GoalError, match=r"no goal .nothing\.stl"):
        relief_of("nothing.stl", (32, 32), 0.8, soften_px=1.0)


def test_the_unit_and_the_sense_of_a_mesh_are_of_no_importance(tmp_path: Path) -> None:
    told: list[str] = []
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.03)
    ball.export(tmp_path / "metres.stl")
    ball.apply_scale(1000).export(tmp_path / "millimetres.stl")
    ball.invert()
    ball.export(tmp_path / "inverted.stl")
    metres, millimetres, inverted = (
        mesh_relief(tmp_path / f"{name}.stl", 32, tell=told.append) for name in ("metres", "millimetres", "inverted")
    )
    for other in (millimetres, inverted):  # a pixel at the rim may fall on the other side of it
        assert (np.abs(other - 1000 * metres) > 1e-2).mean() < 0.01
    assert len(told) == 1 and "inverted.stl: its faces point inwards" in told[0]


def test_an_inverted_sheet_is_told(tmp_path: Path) -> None:
    told: list[str] = []
    lines = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 1"]
    for name, face in (("up", "f 1 2 3 4"), ("down", "f 4 3 2 1")):
        (tmp_path / f"{name}.obj").write_text("\n".join([*lines, face]))
        mesh_relief(tmp_path / f"{name}.obj", 8, "z", tell=told.append)
    assert len(told) == 1 and "down.obj" in told[0]


def test_a_mesh_that_seems_to_lie_on_its_back_is_told(tmp_path: Path) -> None:
    told: list[str] = []
    trimesh.creation.box(extents=(4.0, 0.5, 4.0)).export(tmp_path / "face.stl")
    mesh_relief(tmp_path / "face.stl", 16, tell=told.append)
    assert "8.0 times as high as deep" in told[0] and "--up y" in told[0]
    mesh_relief(tmp_path / "face.stl", 16, "y", tell=told.append)
    assert len(told) == 1


def test_a_huge_mesh_is_refused_in_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trimesh.creation.icosphere(subdivisions=3).export(tmp_path / "ball.stl")
    monkeypatch.setattr(mesh_files, "MAX_BYTES", 50_000)
    with pytest.raises(GoalError, match="reduce it to a few hundred thousand faces"):
        mesh_relief(tmp_path / "ball.stl", 16)


def test_a_mesh_of_a_million_faces_is_read(tmp_path: Path) -> None:
    side = 700
    facets = np.zeros(2 * side * side, mesh_files._FACET)
    y, x = np.mgrid[:side, :side]
    corners = np.stack([np.stack([x + i, y + j, x], axis=-1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], axis=2)
    facets["corners"] = np.stack([corners[:, :, [0, 1, 2]], corners[:, :, [0, 2, 3]]]).reshape(-1, 3, 3)
    (tmp_path / "large.stl").write_bytes(bytes(80) + len(facets).to_bytes(4, "little") + facets.tobytes())
    relief = mesh_relief(tmp_path / "large.stl", 64)
    np.testing.assert_allclose(relief, np.tile((np.arange(64) + 0.5) / 64 * side, (64, 1)), atol=1.0)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_big"])
@pytest.mark.parametrize("polygons", [False, True])
def test_all_kinds_of_ply_are_read(tmp_path: Path, encoding: str, polygons: bool) -> None:
    """A step: the left half is at 1, the right half at 0; with further properties, and quadrilaterals."""
    points = [(0, 0, 1), (1, 0, 1), (1, 2, 1), (0, 2, 1), (1, 0, 0), (2, 0, 0), (2, 2, 0), (1, 2, 0)]
    faces = [(0, 1, 2, 3), (4, 5, 6, 7)] if polygons else [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)]
    kind = {"ascii": "ascii", "binary": "binary_little_endian", "binary_big": "binary_big_endian"}[encoding]
    header = (
        f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex 8\nproperty float x\nproperty double y\n"
        f"property float z\nproperty uchar red\nelement face {len(faces)}\nproperty list uchar int vertex_indices\n"
        "end_header\n"
    ).encode()
    if encoding == "ascii":
        rows = [f"{x} {y} {z} 7" for x, y, z in points] + [f"{len(f)} {' '.join(map(str, f))}" for f in faces]
        body = "\n".join(rows).encode() + b"\n"
    else:
        order = ">" if encoding == "binary_big" else "<"
        body = b"".join(struct.pack(f"{order}fdfB", *point, 7) for point in points)
        body += b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in faces)
    (tmp_path / "step.ply").write_bytes(header + body)
    np.testing.assert_array_equal(mesh_relief(tmp_path / "step.ply", 8), np.tile([1.0] * 4 + [0.0] * 4, (8, 1)))
    (tmp_path / "step.ply").write_bytes((header + body)[: -(3 if encoding == "ascii" else 9)])
    with pytest.raises(GoalError, match="cannot be read as a mesh"):
        mesh_relief(tmp_path / "step.ply", 8)


def test_stl_in_text_is_read_and_its_end_is_missed(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    text = ball.export(file_type="stl_ascii")
    (tmp_path / "text.stl").write_text(text)
    ball.export(tmp_path / "binary.stl")
    text_relief, binary_relief = (mesh_relief(tmp_path / f"{name}.stl", 24) for name in ("text", "binary"))
    np.testing.assert_allclose(text_relief, binary_relief, atol=1e-5)
    (tmp_path / "text.stl").write_text(text[: text.rindex("vertex") - 2])
    with pytest.raises(GoalError, match="the file may be cut off"):
        mesh_relief(tmp_path / "text.stl", 24)
    whole = (tmp_path / "binary.stl").read_bytes()
    (tmp_path / "binary.stl").write_bytes(whole[:-100])
    with pytest.raises(GoalError, match="320 facets are announced and 15900 bytes follow"):
        mesh_relief(tmp_path / "binary.stl", 24)
