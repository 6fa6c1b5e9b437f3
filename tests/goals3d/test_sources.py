"""Height maps, meshes and pictures as goals: known geometry is recovered, and bad files raise clear errors."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from pentimento.contracts.height_maps import encode_height_png
from pentimento.goals3d.sources import depth_relief, height_file_relief, mesh_relief, plain_relief, relief_of, top_of
from pentimento.planning.pushes.goal import GoalError

RAMP = np.tile(np.linspace(0.01, 0.03, 24), (16, 1))


def test_reads_heights_from_png_and_npy(tmp_path: Path) -> None:
    np.save(tmp_path / "ramp.npy", RAMP)
    (tmp_path / "ramp.png").write_bytes(encode_height_png(RAMP, 1e-6))
    heights, holes = height_file_relief(tmp_path / "ramp.npy")
    np.testing.assert_array_equal(heights, RAMP)
    units, _ = height_file_relief(tmp_path / "ramp.png")
    np.testing.assert_allclose(units, RAMP / 1e-6, atol=0.51)
    assert holes == 0


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
