"""Height maps, meshes, pictures and point clouds: known geometry comes back, and bad files are sentences."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from pentimento.contracts.height_maps import encode_height_png
from pentimento.goals3d.height_files import height_file_relief
from pentimento.goals3d.meshes import mesh_relief, top_of
from pentimento.goals3d.pictures import depth_relief, plain_relief
from pentimento.goals3d.point_clouds import point_cloud_relief
from pentimento.goals3d.sources import relief_of
from pentimento.planning.pushes.goal import GoalError

RAMP = np.tile(np.linspace(0.01, 0.03, 24), (16, 1))
MEASURED = os.environ.get("PENTIMENTO_MEASURED")


def test_a_height_map_comes_back_from_png_and_npy(tmp_path: Path) -> None:
    np.save(tmp_path / "ramp.npy", RAMP)
    (tmp_path / "ramp.png").write_bytes(encode_height_png(RAMP, 1e-6))
    heights, holes = height_file_relief(tmp_path / "ramp.npy")
    np.testing.assert_array_equal(heights, RAMP)
    units, _ = height_file_relief(tmp_path / "ramp.png")
    np.testing.assert_allclose(units, RAMP / 1e-6, atol=0.51)
    assert holes == 0


def test_holes_are_filled_from_around_and_counted(tmp_path: Path) -> None:
    holed = RAMP.copy()
    holed[5:8, 10:12] = np.nan
    np.save(tmp_path / "holed.npy", holed)
    filled, count = height_file_relief(tmp_path / "holed.npy")
    assert count == 6
    assert np.abs(filled - RAMP).max() <= RAMP[0, 1] - RAMP[0, 0]


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (np.full((8, 8), np.nan), "64 of 64 pixels are holes"),
        (np.array([[1.0, np.inf], [0, 0]]), "infinite"),
        (np.zeros((8, 8, 3)), r"a height map is real numbers \[h, w\]"),
        (np.zeros((8, 8), complex), "complex"),
    ],
)
def test_arrays_that_are_no_height_maps_are_sentences(tmp_path: Path, content: np.ndarray, sentence: str) -> None:
    np.save(tmp_path / "bad.npy", content)
    with pytest.raises(GoalError, match=sentence):
        height_file_relief(tmp_path / "bad.npy")


def test_a_broken_file_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "bad.npy").write_bytes(b"not an array")
    with pytest.raises(GoalError, match="cannot be read as a height map"):
        height_file_relief(tmp_path / "bad.npy")


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
def test_a_hemisphere_is_a_dome_from_above(tmp_path: Path, suffix: str) -> None:
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    sphere.export(tmp_path / f"sphere{suffix}")
    top = mesh_relief(tmp_path / f"sphere{suffix}", 65)
    x = np.linspace(-1, 1, 66)[:-1] + 1 / 65
    expected = np.sqrt(np.clip(1 - x**2 - x[:, None] ** 2, 0, None))
    inside = expected > 0.4
    np.testing.assert_allclose(top[inside], expected[inside], atol=0.03)
    assert top[0, 0] == pytest.approx(-1.0, abs=0.01)  # nothing there: the lowest


def test_a_mesh_is_seen_from_above_right_side_up() -> None:
    left_top = np.array([[[0, 0.5, 1.0], [0, 1, 1.0], [0.5, 1, 1.0]], [[0, 0, 0], [1, 0, 0], [1, 1, 0]]], float)
    top = top_of(left_top, 40)
    assert top[2, 2] == 1.0 and top[-2, -2] == 0.0


def test_what_is_below_is_hidden_whatever_the_order() -> None:
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], float)
    both = np.concatenate([square + np.array([0, 0, 2.0]), square])
    np.testing.assert_array_equal(top_of(both, 16), np.full((16, 16), 2.0))
    np.testing.assert_array_equal(top_of(both[::-1].copy(), 16), np.full((16, 16), 2.0))


def test_any_axis_may_point_up(tmp_path: Path) -> None:
    trimesh.creation.box(extents=(2.0, 4.0, 1.0)).export(tmp_path / "box.stl")
    assert mesh_relief(tmp_path / "box.stl", 32, "z").shape == (32, 16)
    assert mesh_relief(tmp_path / "box.stl", 32, "x").shape == (8, 32)


def test_meshes_without_faces_numbers_or_extent_are_sentences(tmp_path: Path) -> None:
    (tmp_path / "empty.obj").write_text("# nothing\n")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    (tmp_path / "nan.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "wall.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n")
    (tmp_path / "broken.stl").write_bytes(b"solid ")
    for name in ("empty.obj", "points.obj", "broken.stl"):
        with pytest.raises(GoalError, match=r"cannot be read as a mesh|has no faces"):
            mesh_relief(tmp_path / name, 16)
    with pytest.raises(GoalError, match=r"not finite|has no faces"):  # trimesh drops what has no place
        mesh_relief(tmp_path / "nan.obj", 16)
    with pytest.raises(GoalError, match="Seen from above, the mesh measures 1 by 0"):
        mesh_relief(tmp_path / "wall.obj", 16)


def test_bright_is_high_in_a_plain_relief() -> None:
    picture = np.zeros((40, 60, 3), np.uint8)
    picture[:20] = 255
    relief = plain_relief(picture)
    assert relief[2].min() > 0.95 and relief[-2].max() < 0.05
    assert (np.diff(relief[:, 30]) <= 1e-9).all()


def test_a_depth_model_in_a_folder_is_asked(tmp_path: Path) -> None:
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
    model.config.depth_estimation_type = "metric"
    model.config.max_depth = 1
    model.save_pretrained(tmp_path)
    assert depth_relief(picture, tmp_path).max() <= 0  # metres away from the eye


def test_a_folder_without_a_depth_model_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(GoalError, match="holds no depth model"):
        depth_relief(np.zeros((8, 8, 3), np.uint8), tmp_path)


def test_a_cloud_of_a_cone_is_a_cone() -> None:
    x, y = np.random.default_rng(0).uniform(-1, 1, (2, 20000))
    inside = np.hypot(x, y) < 1
    cloud = np.stack([x, y, 1 - np.hypot(x, y)], axis=1)[inside]
    relief = point_cloud_relief(cloud, 32)
    assert relief[16, 16] > 0.93
    assert relief[0, 0] == cloud[:, 2].min()
    assert relief[16, 24] == pytest.approx(0.5, abs=0.08)


@pytest.mark.parametrize(
    ("cloud", "sentence"),
    [
        (np.zeros((3, 3)), "at least 50 points"),
        (np.full((60, 3), np.nan), "not finite"),
        (np.stack([np.arange(60.0)] * 3, axis=1), "on a line"),
    ],
)
def test_clouds_that_show_nothing_are_sentences(cloud: np.ndarray, sentence: str) -> None:
    with pytest.raises(GoalError, match=sentence):
        point_cloud_relief(cloud, 16)


def test_sources_are_told_apart_by_what_they_are(tmp_path: Path) -> None:
    np.save(tmp_path / "ramp.npy", RAMP)
    (tmp_path / "ramp.png").write_bytes(encode_height_png(RAMP, 1e-6))
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((8, 8, 3), 99, np.uint8))
    trimesh.creation.box(extents=(1, 1, 1)).export(tmp_path / "box.ply")
    for source in (
        "letter:A",
        "shape:dome",
        *(str(tmp_path / n) for n in ("ramp.npy", "ramp.png", "photo.png", "box.ply")),
    ):
        assert relief_of(source, (32, 32), 0.8, 1.0).shape == (32, 32)
    with pytest.raises(GoalError, match=r"no goal .nothing\.stl"):
        relief_of("nothing.stl", (32, 32), 0.8, 1.0)


@pytest.mark.skipif(not MEASURED, reason="PENTIMENTO_MEASURED does not name a folder with measured clouds of dough")
def test_measured_dough_becomes_a_relief() -> None:
    with np.load(Path(MEASURED or "") / "robocook_dough_states.npz", allow_pickle=False) as clouds:
        for name, cloud in clouds.items():
            relief = point_cloud_relief(cloud, 64)
            assert np.isfinite(relief).all(), name
            assert relief.max() == pytest.approx(cloud[:, 2].max(), abs=1e-6)
            assert 0.003 < np.ptp(relief) < 0.2, name  # dough of centimetres, in metres
