"""The header reader agrees with the onnx package, and refuses everything else with a message."""

from collections.abc import Callable

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from pentimento.bundle.onnx_header import External, read_header
from pentimento.contracts.errors import ContractError
from tests.bundle.tiny_bundle import graph


@given(st.integers(1, 30), st.integers(1, 12), st.lists(st.integers(0, 7), max_size=4), st.booleans())
def test_header_of_a_written_model(opset: int, ir_version: int, shape: list[int], whole: bool) -> None:
    model = graph(opset, ir_version)
    array = np.zeros(shape, np.int64 if whole else np.float32)
    model.graph.initializer.append(numpy_helper.from_array(array, "more"))
    header = read_header(model.SerializeToString())
    assert (header.opsets, header.ir_version) == ({"": opset}, ir_version)
    assert (header.inputs, header.outputs) == ({"x": ("n", 2)}, {"y": ("n", 2)})
    assert header.largest_tensor_bytes == max(array.nbytes, 8)
    assert not header.external


def test_header_reads_nested_graphs_and_tensors() -> None:
    inner = helper.make_graph(
        [helper.make_node("Constant", [], ["c"], value=numpy_helper.from_array(np.zeros(100, np.float32)))],
        "inner", [], [helper.make_tensor_value_info("c", TensorProto.FLOAT, [100])],
    )  # fmt: skip
    model = graph()
    model.graph.node.append(helper.make_node("If", ["x"], ["z"], then_branch=inner, else_branch=inner))
    header = read_header(model.SerializeToString())
    assert header.largest_tensor_bytes == 400
    assert list(header.outputs) == ["y"]  # outputs of the inner graph are not outputs of the model


def _outside(tensor: TensorProto, **place: object) -> None:
    """Say that a tensor lies in another file."""
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    for key, value in place.items():
        tensor.external_data.add(key=key, value=str(value))


def test_header_says_where_tensors_in_other_files_lie() -> None:
    model = graph()
    _outside(model.graph.initializer[0], location="a.weights", offset=64, length=8)
    assert read_header(model.SerializeToString()).external == [External("a.weights", 64, 8)]


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        ({}, "needs location, offset and length"),
        ({"location": "a", "offset": 0}, "needs location, offset and length"),
        ({"location": "a", "offset": 0, "length": 8, "checksum": "0"}, "needs location, offset and length"),
        ({"location": "a", "offset": -8, "length": 8}, "needs location, offset and length"),
        ({"location": "a", "offset": "0x0", "length": 8}, "needs location, offset and length"),
        ({"location": "a", "offset": 0, "length": 9}, "needs 8 bytes, and 9 are named"),
    ],
)
def test_header_rejects_tensors_whose_place_is_not_said_in_full(place: dict[str, object], sentence: str) -> None:
    model = graph()
    _outside(model.graph.initializer[0], **place)
    with pytest.raises(ContractError, match=sentence):
        read_header(model.SerializeToString())


def test_header_rejects_tensors_in_two_places_and_in_operators() -> None:
    whole = {"location": "a", "offset": 0, "length": 8}
    marks: tuple[Callable[[TensorProto], object], ...] = (
        lambda tensor: tensor.external_data.add(key="location", value="a"),  # the graph holds it, too
        lambda tensor: setattr(tensor, "data_location", TensorProto.EXTERNAL),
        lambda tensor: (_outside(tensor, **whole), setattr(tensor, "data_location", TensorProto.DEFAULT)),
        lambda tensor: (_outside(tensor, **whole), tensor.external_data.add(key="location", value="b")),
    )
    for mark in marks:
        model = graph()
        mark(model.graph.initializer[0])
        with pytest.raises(ContractError, match="in another file"):
            read_header(model.SerializeToString())
    model, constant = graph(), numpy_helper.from_array(np.zeros(2, np.float32))
    _outside(constant, **whole)
    model.graph.node.append(helper.make_node("Constant", [], ["c"], value=constant))
    with pytest.raises(ContractError, match="in another file and in the graph"):
        read_header(model.SerializeToString())


def test_header_rejects_foreign_operators_functions_and_sparse_tensors() -> None:
    model = graph(domain="com.example")
    with pytest.raises(ContractError, match=r"com\.example"):
        read_header(model.SerializeToString())
    model = graph()
    model.functions.add(name="f", domain="")
    with pytest.raises(ContractError, match="field 25 of the model"):
        read_header(model.SerializeToString())
    model = graph()
    model.graph.sparse_initializer.add()
    with pytest.raises(ContractError, match="field 15 of the graph"):
        read_header(model.SerializeToString())


def test_header_rejects_tensors_of_inconsistent_size() -> None:
    model = graph()
    model.graph.initializer[0].dims[0] = 2**40
    with pytest.raises(ContractError, match="needs 8796093022208 bytes and has 8"):
        read_header(model.SerializeToString())
    model.graph.initializer[0].ClearField("raw_data")
    model.graph.initializer[0].float_data.append(1.0)  # numbers stored one by one: their size follows from the shape
    assert read_header(model.SerializeToString()).largest_tensor_bytes == 2**43


@settings(max_examples=300)
@given(st.integers(0, 10_000), st.integers(1, 255), st.integers(0, 200))
def test_header_of_a_damaged_file_raises_contract_error_or_returns(at: int, flip: int, cut: int) -> None:
    data = bytearray(graph().SerializeToString())
    data[at % len(data)] ^= flip
    try:
        read_header(bytes(data[: len(data) - cut]))
    except ContractError as error:
        assert str(error).endswith(".")


def test_header_of_a_truncated_file_differs() -> None:
    data = graph().SerializeToString()
    whole = read_header(data)
    for length in range(len(data)):
        try:
            part = read_header(data[:length])
        except ContractError:
            continue
        assert part != whole or length >= len(data) - 4  # all but the list of operator sets


def test_header_rejects_an_empty_file() -> None:
    with pytest.raises(ContractError, match="0 graphs"):
        read_header(b"")
    assert onnx.load_from_string(graph().SerializeToString()).graph.node  # the onnx package reads ours
