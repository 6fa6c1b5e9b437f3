"""The design of pellets: within the feeder's range and the area, some beside others, each row from its number alone."""

import numpy as np
import pytest

from pentimento.collection.places import design_places
from pentimento.contracts.errors import ContractError
from pentimento.robots.tools import load_feeder

FEEDER = load_feeder("pellets")
AREA_M = (0.2, 0.15)


def test_design_stays_within_feeder_and_area_and_sets_pellets_side_by_side() -> None:
    places = np.array(design_places(FEEDER, AREA_M, count=60, edge_m=0.02, seed=1))
    low, high = FEEDER.volume_m3
    assert np.all((places[:, 2] >= low) & (places[:, 2] <= high))
    assert np.all((places[:, :2] >= 0.02) & (places[:, :2] <= np.array(AREA_M) - 0.02))
    assert places[:, 2].min() < 2 * low and places[:, 2].max() > 0.5 * high
    groups = places[:, :2].reshape(10, 6, 2)
    apart = np.linalg.norm(groups[:, :, None] - groups[:, None], axis=-1) + np.eye(6)
    assert (apart.min(axis=(1, 2)) < 1.2 * FEEDER.diameter_m[1]).mean() > 0.5


def test_design_of_fewer_pellets_is_the_beginning_of_more() -> None:
    few, many = (design_places(FEEDER, AREA_M, count=count, edge_m=0.02, seed=1) for count in (8, 20))
    np.testing.assert_array_equal(few, many[:8])


def test_design_without_room_is_refused() -> None:
    with pytest.raises(ContractError, match="no room for pellets"):
        design_places(FEEDER, AREA_M, count=6, edge_m=0.08, seed=1)
