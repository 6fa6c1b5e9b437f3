"""Exported graphs: gradients, dynamic sizes, reproducible bytes without paths, and the comparison with PyTorch."""

import numpy as np
import pytest
import torch
from torch import Tensor

from pentimento.bundle.onnx_header import read_header
from pentimento.deploy.graphs import (
    IR_VERSION,
    OPSET,
    ParityError,
    compared,
    export,
    generator,
    relative_difference,
    session,
)
from pentimento.dynamics.strokes.mechanisms.geometry import at_lengths

WEIGHT = torch.linspace(-1, 1, 6).reshape(2, 3)
UNITS = {"x": "1", "value": "1", "slope": "1"}


def value_and_slope(x: Tensor) -> tuple[Tensor, Tensor]:
    """Σ tanh(W xᵢ)², with its gradient; the weight is used twice."""
    leaf = x.detach().requires_grad_(True)
    with torch.enable_grad():
        value = torch.tanh(leaf @ WEIGHT.T).square().sum() + (leaf @ WEIGHT.T).sum()
    return value.detach(), torch.autograd.grad(value, leaf)[0]


def rows(count: int) -> Tensor:
    return torch.randn(count, 3, generator=generator("rows", count))


def test_exports_gradient_with_dynamic_size() -> None:
    model = export(value_and_slope, [rows(7)], ["x"], outputs=["value", "slope"], free=[{0: "rows"}])
    graph = compared(
        "tanh",
        model,
        value_and_slope,
        examples=[[rows(1)], [rows(4)], [rows(50)]],
        units=UNITS,
        tolerance=1e-5,
        models=("m",),
    )
    assert graph.inputs[0].shape == ("rows", 3) and graph.outputs[1].shape == ("rows", 3)
    assert set(graph.parity) == {"value", "slope"} and max(graph.parity.values()) < 1e-5
    header = read_header(graph.content)
    assert (header.opsets, header.ir_version) == ({"": OPSET}, IR_VERSION)


def test_export_is_reproducible_and_has_no_paths() -> None:
    one, again = (export(value_and_slope, [rows(2)], ["x"], outputs=["value", "slope"]) for _ in range(2))
    content = one.SerializeToString(deterministic=True)
    assert content == again.SerializeToString(deterministic=True)
    assert not any(word in content for word in (b"/", b".py", b"torch."))
    stored = [array.raw_data for array in one.graph.initializer if len(array.raw_data) == 24]
    assert len(stored) == len(set(stored))  # each array once


def test_rejects_graph_that_differs_from_its_function() -> None:
    model = export(value_and_slope, [rows(2)], ["x"], outputs=["value", "slope"])

    def other(x: Tensor) -> tuple[Tensor, Tensor]:
        value, slope = value_and_slope(x)
        return value, 1.001 * slope

    with pytest.raises(ParityError, match=r"graph tanh gives slope with a relative difference of 0\.00"):
        compared("tanh", model, other, examples=[[rows(2)]], units=UNITS, tolerance=1e-4, models=())
    assert compared("tanh", model, other, examples=[[rows(2)]], units=UNITS, tolerance=1e-2, models=()).parity[
        "slope"
    ] == pytest.approx(1e-3, rel=0.01)
    assert session(model.SerializeToString(), {}).get_inputs()[0].shape == [2, 3]


def test_comparison_skips_examples_at_kinks_only() -> None:
    """Beside x = 1 the slope of |x − 1| is the sign of a rounding error."""

    def kinked(x: Tensor) -> tuple[Tensor, Tensor]:
        leaf = x.detach().requires_grad_(True)
        with torch.enable_grad():
            value = (leaf - 1).abs().sum()
        return value.detach() + 1, torch.autograd.grad(value, leaf)[0]

    def steeper(x: Tensor) -> tuple[Tensor, Tensor]:
        value, slope = kinked(x)
        return value, 1.01 * slope

    kink, plain = torch.ones(1, 3) + 1e-7, torch.tensor([[0.5, 2.0, 3.0]])
    model = export(kinked, [plain], ["x"], outputs=["value", "slope"])

    def flipped_there(x: Tensor) -> tuple[Tensor, Tensor]:
        value, slope = kinked(x)
        return value, -slope if x is kink else slope

    assert (
        compared(
            "kink", model, flipped_there, examples=[[kink], [plain]], units=UNITS, tolerance=1e-4, models=()
        ).parity["slope"]
        == 0
    )
    with pytest.raises(ParityError, match="relative difference"):
        compared("kink", model, steeper, examples=[[kink], [plain]], units=UNITS, tolerance=1e-4, models=())
    with pytest.raises(ParityError, match="at each of 1 examples"):
        compared("kink", model, flipped_there, examples=[[kink]], units=UNITS, tolerance=1e-4, models=())


def test_relative_difference_is_infinite_for_other_shapes_and_nan() -> None:
    wanted = np.array([3.0, 4.0], np.float32)
    assert relative_difference(wanted, wanted) == 0
    assert relative_difference(wanted * 1.5, wanted) == pytest.approx(0.5)
    assert relative_difference(1000 * wanted * 1.5, 1000 * wanted) == pytest.approx(0.5)
    assert relative_difference(np.full(2, 0.5), np.zeros(2)) == pytest.approx(0.5**0.5)
    assert relative_difference(wanted[:1], wanted) == np.inf
    assert relative_difference(np.array([3.0, np.nan]), wanted) == np.inf
    assert relative_difference(np.array([3.0, np.nan]), np.array([3.0, np.nan])) == 0


def test_exports_gradient_of_a_field_along_a_path() -> None:
    """A flat tool's mark is read off its path in between the points."""
    arc = torch.linspace(0, 1, 6).expand(1, 3, 6)

    def pulled(place: Tensor, field: Tensor) -> tuple[Tensor, Tensor]:
        leaves = [value.detach().requires_grad_(True) for value in (place, field)]
        with torch.enable_grad():
            there = at_lengths(leaves[0], arc, leaves[1]).square().sum()
        return torch.autograd.grad(there, leaves)

    numbers = generator("along", 3)
    examples = [torch.rand(1, 3, 4, generator=numbers), torch.rand(1, 3, 6, 2, generator=numbers)]
    model = export(pulled, examples, ["place", "field"], outputs=["to_place", "to_field"])
    units = dict.fromkeys(("place", "field", "to_place", "to_field"), "1")
    assert (
        max(
            compared(
                "along", model, pulled, examples=[examples], units=units, tolerance=1e-5, models=()
            ).parity.values()
        )
        < 1e-5
    )
