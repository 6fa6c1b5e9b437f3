"""Objectives with given views equal the workshop's objectives with random views."""

import numpy as np
import pytest
import torch

from pentimento.bundle.views import random_views
from pentimento.semantics.objective import SemanticObjective, TextObjective, semantic_loss, text_loss
from tests.copainting.goal_planners import small_encoder

SEED = 4


def drawn(views: int) -> torch.Tensor:
    """The views that the workshop's objectives draw first with the seed."""
    return torch.from_numpy(random_views(views, np.random.default_rng(SEED)))


@pytest.mark.parametrize("views", [0, 1, 3])
def test_exported_objectives_equal_those_of_the_workshop(views: int) -> None:
    encoder = small_encoder()
    image, target = torch.rand(2, 24, 20, 3, generator=torch.Generator().manual_seed(0)) * 1.2 - 0.1
    meant = SemanticObjective(encoder, target, views, SEED)(image)
    torch.testing.assert_close(semantic_loss(encoder, image, target, drawn(views)), meant)
    caption = encoder.embed_texts(["a red disc"])[0]
    asked = TextObjective(encoder, "a red disc", views, SEED)(image)
    torch.testing.assert_close(text_loss(encoder, image, caption, drawn(views)), asked)


def test_no_views_give_no_matrices() -> None:
    assert random_views(0, np.random.default_rng(SEED)).shape == (0, 2, 3)
