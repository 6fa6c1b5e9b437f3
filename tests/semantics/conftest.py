"""A small encoder, trained for a few steps on a few procedural scenes."""

import numpy as np
import pyarrow.compute as pc
import pytest
import torch
from transformers import CLIPTokenizer

from pentimento.copainting.scenes.procedural import ScenesConfig, build_scenes
from pentimento.semantics.encoder import Encoder, EncoderShape
from pentimento.semantics.examples import Captioned, Examples, captioned, examples
from pentimento.semantics.tokenizer import learn_tokenizer
from pentimento.semantics.training import EncoderTraining, train_encoder

SHAPE = EncoderShape(
    image_px=16, patch_px=8, image_width=32, image_layers=2, text_width=16, text_layers=1, heads=2, embedding=16
)


def training(**changes: object) -> EncoderTraining:
    values = {"steps": 30, "batch": 16, "rate": 0.003, "warmup": 0.1, "weight_decay": 0.01}
    values |= {"object_weight": 1.0, "patch_weight": 1.0, "precision": "32-true", "seed": 0}
    shares = {"picture": 0.4, "lines": 0.2, "hatching": 0.1, "grey": 0.1, "strokes": 0.1, "paint": 0.1}
    return EncoderTraining(**({"view_shares": shares} | values | changes))


@pytest.fixture(scope="session")
def rows() -> Captioned:
    table = build_scenes(ScenesConfig(60, 32, 0.1, 0.1, 4, 0), lambda *_: None)
    return captioned(table.filter(pc.equal(table["split"], "train")))


@pytest.fixture(scope="session")
def tokenizer(rows: Captioned) -> CLIPTokenizer:
    return learn_tokenizer([text for texts in rows.captions for text in texts], 300, 24)


@pytest.fixture(scope="session")
def known(rows: Captioned, tokenizer: CLIPTokenizer) -> Examples:
    return examples(rows, tokenizer, 0)


@pytest.fixture(scope="session")
def encoder(known: Examples, tokenizer: CLIPTokenizer) -> Encoder:
    return train_encoder(known, tokenizer, SHAPE, config=training(), log=lambda *_: None)


@pytest.fixture(scope="session")
def images(rows: Captioned) -> torch.Tensor:
    """[12, 3, 32, 32]."""
    return torch.from_numpy(np.ascontiguousarray(rows.images[:12])).permute(0, 3, 1, 2).float() / 255
