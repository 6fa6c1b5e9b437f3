"""What is exported of the objectives is what the workshop plans with."""

import numpy as np
import pytest
import torch

from pentimento.bundle.manifest import MAX_CELLS
from pentimento.bundle.views import views_of
from pentimento.deploy.objective_graphs import semantic_value, text_value
from pentimento.semantics.objective import SemanticObjective, TextObjective
from pentimento.semantics.style import _MAX
from tests.copainting.goal_planners import small_encoder

SEED = 4


def drawn(views: int) -> torch.Tensor:
    """The views that the workshop's objectives draw first with the seed."""
    numbers = torch.rand(4, views, generator=torch.Generator().manual_seed(SEED)) * 2 - 1
    return torch.from_numpy(views_of(numbers.numpy()))


@pytest.mark.parametrize("views", [0, 1, 3])
def test_with_the_same_views_values_are_the_workshops(views: int) -> None:
    encoder = small_encoder()
    image, target = torch.rand(2, 24, 20, 3, generator=torch.Generator().manual_seed(0)) * 1.2 - 0.1
    meant = SemanticObjective(encoder, target, views, SEED)(image)
    torch.testing.assert_close(semantic_value(encoder, image, target, drawn(views)), meant)
    caption = encoder.embed_texts(["a red disc"])[0]
    asked = TextObjective(encoder, "a red disc", views, SEED)(image)
    torch.testing.assert_close(text_value(encoder, image, caption, drawn(views)), asked)


def test_as_many_cells_are_paired_as_in_the_workshop() -> None:
    assert MAX_CELLS == _MAX


def test_no_view_is_no_matrix() -> None:
    assert views_of(np.zeros((4, 0), np.float32)).shape == (0, 2, 3)
