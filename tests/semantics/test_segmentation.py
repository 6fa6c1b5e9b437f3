"""Segmentation by the classical method and by a SAM model in a folder."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pentimento.contracts.errors import ConfigError
from pentimento.semantics import segmentation
from pentimento.semantics.segmentation import SegmentationConfig, segment

CLASSICAL = SegmentationConfig("classical", None, 60.0, 0.03, 4)


def two_squares() -> np.ndarray:
    image = np.full((64, 64, 3), 240, np.uint8)
    image[8:40, 6:36], image[44:58, 40:60] = (200, 40, 40), (40, 60, 200)
    return image


def test_segments_are_numbered_by_size_with_background_0() -> None:
    regions = segment(two_squares(), CLASSICAL)
    assert regions.dtype == np.uint8 and regions.shape == (64, 64)
    assert set(np.unique(regions)) == {0, 1, 2}
    assert (regions[12:36, 10:32] == 1).all() and (regions[47:55, 43:57] == 2).all() and regions[0, 0] == 0


def test_flat_picture_has_no_segment() -> None:
    assert (segment(np.full((32, 32, 3), 90, np.uint8), CLASSICAL) == 0).all()


def test_segments_by_sam_from_a_local_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from transformers import SamConfig, SamMaskDecoderConfig, SamModel, SamPromptEncoderConfig, SamVisionConfig

    torch.manual_seed(0)
    vision = SamVisionConfig(
        hidden_size=16, output_channels=16, num_hidden_layers=1, num_attention_heads=2, image_size=64, patch_size=16,
        window_size=2, global_attn_indexes=[0], mlp_dim=32, num_pos_feats=8,
    )  # fmt: skip
    prompts = SamPromptEncoderConfig(hidden_size=16, image_size=64, patch_size=16, mask_input_channels=4)
    decoder = SamMaskDecoderConfig(
        hidden_size=16, mlp_dim=32, num_hidden_layers=1, num_attention_heads=2, iou_head_hidden_dim=16
    )
    model = SamModel(SamConfig(vision_config=vision, prompt_encoder_config=prompts, mask_decoder_config=decoder))
    model.save_pretrained(tmp_path)
    regions = segment(two_squares(), SegmentationConfig("sam", str(tmp_path), 60.0, 0.0, 3))
    assert regions.shape == (64, 64) and regions.dtype == np.uint8
    again = segment(two_squares(), SegmentationConfig("sam", str(tmp_path), 60.0, 0.0, 3))
    np.testing.assert_array_equal(regions, again)
    # Points in several calls give the same regions.
    monkeypatch.setattr(segmentation, "_POINTS", 2)
    by_two = segment(two_squares(), SegmentationConfig("sam", str(tmp_path), 60.0, 0.0, 3))
    np.testing.assert_array_equal(regions, by_two)


def test_rejects_folder_without_sam(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no SAM model"):
        segment(two_squares(), SegmentationConfig("sam", str(tmp_path), 60.0, 0.0, 3))
    with pytest.raises(ValueError, match="give the folder with sam"):
        SegmentationConfig("sam", None, 60.0, 0.0, 3)
