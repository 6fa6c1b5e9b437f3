"""Training of an encoder: losses in closed form, altered captions, and reproducibility."""

import math

import numpy as np
import pytest
import torch
from transformers import CLIPTokenizer

from pentimento.semantics.drawings import STYLES, draw
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.examples import VIEWS, Captioned, Examples, drawn_views
from pentimento.semantics.training import contrast, moved, patch_kinds, train_encoder
from tests.semantics.conftest import SHAPE, training


def test_contrast_of_equal_logits_is_the_logarithm_of_the_choices() -> None:
    loss = contrast(torch.zeros(4, 6), torch.arange(4))  # 4 pictures, 6 captions of which 2 are nobody's
    assert float(loss) == pytest.approx(0.5 * (math.log(6) + math.log(4)))
    certain = torch.full((3, 3), -50.0).fill_diagonal_(50.0)
    assert float(contrast(certain, torch.arange(3))) == pytest.approx(0.0, abs=1e-6)


def test_shared_caption_is_positive_for_both_pictures() -> None:
    logits = torch.full((2, 1), 3.0)
    assert float(contrast(logits, torch.tensor([0, 0]))) == pytest.approx(0.5 * math.log(2), abs=1e-6)


def test_patch_kind_is_the_one_that_covers_most() -> None:
    regions = torch.zeros(1, 8, 8)
    regions[0, :4, :4], regions[0, 4:, 6:], regions[0, 0, 4] = 1, 2, 2
    kinds = patch_kinds(regions, torch.tensor([[-1, 7, 3]]), 4)
    assert kinds.tolist() == [[7, -1, -1, 3]]
    assert (patch_kinds(regions, torch.tensor([[-1]]), 4) == -1).all()


def test_pictures_and_regions_are_moved_together() -> None:
    images = torch.zeros(8, 3, 32, 32)
    images[:, :, 10:22, 8:24] = 1.0
    regions = (images[:, 0] > 0).to(torch.uint8)
    shown, labels = moved(images, regions, torch.Generator().manual_seed(1))
    assert shown.shape == images.shape and labels.dtype == regions.dtype
    inside = shown[:, 0] > 0.5
    assert ((inside != (labels > 0)).float().mean((1, 2)) < 0.03).all()  # but for half pixels along the edge
    assert (inside != (regions > 0)).float().mean() > 0.02
    areas = inside.float().sum((1, 2)) / 192
    assert (areas > math.exp(-0.35)).all() and (areas < math.exp(0.35)).all()


def test_altered_captions_differ_by_one_word(known: Examples, tokenizer: CLIPTokenizer, rows: Captioned) -> None:
    for index in range(20):
        for caption, altered in zip(known.captions[index], known.altered[index], strict=True):
            assert altered
            right = known.tokens[caption].tolist()
            for other in altered:
                assert sum(a != b for a, b in zip(right, known.tokens[other].tolist(), strict=True)) == 1
        for plain in known.plain[index]:
            words = tokenizer.decode(known.tokens[plain]).split()
            assert not set(words) & set(rows.colors[index])


def test_drawings_of_a_picture_depend_on_seed_and_number_only(rows: Captioned) -> None:
    views = drawn_views(rows.images[:3], 5)
    assert views.shape == (3, len(VIEWS), 32, 32, 3)
    np.testing.assert_array_equal(views[:2], drawn_views(rows.images[:2], 5))
    assert (views[:, 0] == rows.images[:3]).all()
    assert not (views[:, 1:] == drawn_views(rows.images[:3], 6)[:, 1:]).all()


@pytest.mark.parametrize("style", STYLES)
def test_black_styles_are_grey_on_light_paper(style: str) -> None:
    image = np.full((64, 64, 3), 245, np.uint8)
    image[20:44, 20:44] = (220, 40, 40)
    drawn = draw(image, style, np.random.default_rng(1)).astype(int)  # type: ignore[arg-type]
    ink = drawn[16:48, 16:48].min()
    assert drawn[:6, :6].mean() > 200 and ink < 120
    spread = np.ptp(drawn[16:48, 16:48], axis=-1).max()
    assert (spread > 100) if style == "paint" else (spread < 40)


def test_encoder_training_learns_and_is_reproducible(
    known: Examples, tokenizer: CLIPTokenizer, encoder: Encoder
) -> None:
    losses: list[float] = []
    again = train_encoder(
        known, tokenizer, SHAPE, config=training(), log=lambda name, value, step: losses.append(value)
    )
    assert again.digest == encoder.digest
    assert losses[-1] < 0.95 * losses[0]
    assert train_encoder(known, tokenizer, SHAPE, config=training(seed=1), log=lambda *_: None).digest != encoder.digest


def test_encoder_trains_without_objects(rows: Captioned, tokenizer: CLIPTokenizer) -> None:
    from pentimento.semantics.examples import examples

    nothing: list[list[str]] = [[] for _ in rows.captions]
    bare = Captioned(rows.images, rows.captions, nothing, nothing, rows.regions)
    losses: list[float] = []
    train_encoder(
        examples(bare, tokenizer, 0), tokenizer, SHAPE, config=training(), log=lambda n, v, s: losses.append(v)
    )
    assert losses[-1] < losses[0]


def test_rejects_view_shares_that_miss_a_view() -> None:
    with pytest.raises(ValueError, match="give each of picture, lines"):
        training(view_shares={"picture": 1.0})
