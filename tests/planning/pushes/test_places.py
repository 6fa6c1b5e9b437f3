"""The place model: volume, symmetry, gradients, its file; and its fit."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.height_maps import encode_height_png
from pentimento.planning.pushes.place_fit import fit_places
from pentimento.planning.pushes.places import PlaceModel, place_model_bytes, place_model_from, read_place_model
from pentimento.robots.tools import ball_m3

MODEL = PlaceModel("pellets", 0.7, 0.006, 0.3, 4.0, ball_m3(0.01), (ball_m3(0.006), ball_m3(0.014)), 0.08, 24)
WINDOW_M = (0.0, 0.0, 0.1, 0.1)
SHAPE = (128, 128)
PIXEL_M = 0.1 / 128
PLACE = np.array([0.052, 0.047, ball_m3(0.012)])


@pytest.mark.parametrize("flatness", [2.0, 4.0, 8.0])
@pytest.mark.parametrize("diameter_m", [0.006, 0.014])
def test_footprint_holds_the_kept_volume_and_its_energy(flatness: float, diameter_m: float) -> None:
    model = replace(MODEL, flatness=flatness)
    place = np.array([0.05, 0.05, ball_m3(diameter_m)])
    added = model.change(place[None], SHAPE, WINDOW_M)[0]
    assert added.sum() * PIXEL_M**2 == pytest.approx(0.7 * place[2], rel=0.01)
    assert np.square(added).sum() * PIXEL_M**2 == pytest.approx(model.energy_m4(place[2]), rel=0.02)
    assert 0.97 * model.peak_m(place[2]) < added.max() <= model.peak_m(place[2])


def test_footprint_is_round_and_moves_with_its_place() -> None:
    middle = np.array([[0.05, 0.05, PLACE[2]]])
    added = MODEL.change(middle, SHAPE, WINDOW_M)[0]
    np.testing.assert_allclose(added, np.rot90(added), atol=1e-15)
    np.testing.assert_allclose(added, added.T, atol=1e-15)
    moved = MODEL.change(middle + np.array([10 * PIXEL_M, 0.0, 0.0]), SHAPE, WINDOW_M)[0]
    np.testing.assert_allclose(moved[:, 10:], added[:, :-10], atol=1e-12)


def test_larger_pellets_are_wider_and_higher_and_peaks_invert() -> None:
    small, large = ball_m3(0.006), ball_m3(0.014)
    assert MODEL.radius_m(large) > MODEL.radius_m(small) and MODEL.peak_m(large) > MODEL.peak_m(small)
    peaks = np.array([MODEL.peak_m(small), MODEL.peak_m(large)])
    np.testing.assert_allclose(MODEL.volume_of_peak(peaks), [small, large], rtol=1e-9)


@pytest.mark.parametrize("flatness", [2.0, 5.0])
def test_gradients_are_those_of_finite_differences(flatness: float) -> None:
    model = replace(MODEL, flatness=flatness)
    cotangent = np.random.default_rng(0).normal(size=SHAPE)
    _, pull = model.step(PLACE, SHAPE, WINDOW_M)
    steps = np.array([1e-7, 1e-7, 1e-5 * PLACE[2]])
    for axis, step in enumerate(steps):
        ends = PLACE + np.outer([1, -1], step * np.eye(3)[axis])
        high, low = (model.change(ends, SHAPE, WINDOW_M) * cotangent).sum(axis=(1, 2))
        assert pull(cotangent)[axis] == pytest.approx((high - low) / (2 * step), rel=1e-5)


def test_model_survives_its_file(tmp_path: Path) -> None:
    (tmp_path / "places.json").write_bytes(place_model_bytes(MODEL))
    assert read_place_model(tmp_path / "places.json") == MODEL
    with pytest.raises(ContractError, match=r"cannot be read .*collect_pushes\.pellets"):
        read_place_model(tmp_path / "none.json")
    for broken in (b"{", place_model_bytes(MODEL).replace(b"0.006", b'"wide"'), b"{}"):
        with pytest.raises(ContractError, match=r"a\.json"):
            place_model_from(broken, "a.json")
    with pytest.raises(ContractError, match="flatness within"):
        place_model_from(place_model_bytes(MODEL).replace(b'"flatness": 4.0', b'"flatness": 40.0'), "a.json")


def rows(model: PlaceModel, count: int, noise_m: float = 0.0) -> list[dict[str, Any]]:
    """Pellets of a model on a flat slab, as the contract records them."""
    made = []
    for number in range(count):
        rng = np.random.default_rng(number)
        place = np.array([*rng.uniform(0.03, 0.07, 2), ball_m3(rng.uniform(0.006, 0.014))])
        before = np.full(SHAPE, 0.04) + noise_m * rng.normal(size=SHAPE)
        after = 0.04 + model.change(place[None], SHAPE, WINDOW_M)[0] + noise_m * rng.normal(size=SHAPE)
        after[:4, :4] = np.nan
        images = {
            name: {"bytes": encode_height_png(height, 1e-6), "path": None}
            for name, height in (("before", before), ("after", after))
        }
        made.append(
            {
                "kind": "place", "tool": "pellets", "order": number, "window_m": list(WINDOW_M),
                "action": [*place[:2].tolist(), 0.0, 0.0, 0.0], "volume_m3": float(place[2]),
                "height_per_unit_m": 1e-6, **images,
            }
        )  # fmt: skip
    return made


def test_fit_recovers_the_model_that_made_the_pellets() -> None:
    low_resolution = [row | {"kind": "push"} for row in rows(MODEL, 2)]  # pushes do not count
    found = fit_places(pa.Table.from_pylist(rows(MODEL, 8, 5e-5) + low_resolution))
    assert found.places == 8 and found.feeder == "pellets"
    assert found.kept == pytest.approx(MODEL.kept, rel=0.01)
    assert found.growth == pytest.approx(MODEL.growth, abs=0.01)
    assert found.flatness == pytest.approx(MODEL.flatness, rel=0.03)
    for diameter_m in (0.006, 0.014):
        assert found.radius_m(ball_m3(diameter_m)) == pytest.approx(MODEL.radius_m(ball_m3(diameter_m)), rel=0.01)
    assert 0 < found.unexplained < 0.01


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda made: made[:4], "holds 4 placed pellets and a place model needs 6"),
        (lambda made: [made[0] | {"tool": "syringe"}, *made[1:]], "several feeders"),
        (lambda made: [made[0] | {"volume_m3": None}, *made[1:]], "has the volume None"),
        (lambda made: [row | {"volume_m3": 5e-7} for row in made], "hardly differ"),
        (lambda made: [row | {"after": row["before"]} for row in made], "show no added material"),
    ],
)
def test_tables_without_enough_pellets_are_refused(change: Any, sentence: str) -> None:
    with pytest.raises(ContractError, match=sentence):
        fit_places(pa.Table.from_pylist(change(rows(MODEL, 7))))
