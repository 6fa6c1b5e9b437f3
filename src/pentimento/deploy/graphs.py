"""Export of PyTorch functions to ONNX graphs, with reproducible bytes, and their comparison with PyTorch.

Functions may compute gradients. They are traced into primitive operators (`make_fx`) before the export, because the
exporter cannot differentiate.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.fx.experimental.proxy_tensor import make_fx

from pentimento.bundle.manifest import ALIGNED_BYTES, Port
from pentimento.contracts.errors import PentimentoError
from pentimento.deploy.decompositions import Resizing, exportable

OPSET: Final = 20
"""Version of ONNX's operators, supported by onnxruntime from 1.17 on."""
IR_VERSION: Final = 10
"""Version of ONNX's format."""
INLINE_BYTES: Final = 2**25
"""Tensors of more bytes lie beside their graph, where others can share them. A smaller graph stays one file: its copies
cost less than the runtime itself.
"""
_CHECKED_BYTES: Final = 2**31 - 2**24  # of tensors within a graph: a protocol buffer ends at 2^31 - 1 bytes
_SMALL_BYTES: Final = 1024  # of a tensor that stays in the graph, since the shapes that it may hold are needed there
_NUDGE: Final = 1e-5  # relative change of inputs; less is averaged out before it acts as rounding does
_NUDGES: Final = 8  # random changes of an example, because whether rounding crosses a kink is random
Function = Callable[..., tuple[Tensor, ...]]


def export(
    function: Function,
    examples: Sequence[Tensor],
    inputs: Sequence[str],
    *,
    outputs: Sequence[str],
    free: Sequence[dict[int, str]] | None = None,
    resizing: Resizing | None = None,
) -> onnx.ModelProto:
    """The graph of a function of tensors that may differentiate inside, by `torch.autograd.grad`.

    Args:
        function: takes tensors of the examples' shapes and returns a tuple of tensors.
        inputs, outputs: the names of arguments and results.
        free: the dynamic dimensions of each input, by name; None: all sizes are those of the examples. A dynamic size
            must differ from every other size in the examples, or the exporter confuses them.
        resizing: where the function resizes pictures, the object that it sets the matrices of.
    """
    # Weights are real tensors; arguments are symbolic.
    traced = make_fx(
        function,
        decomposition_table=exportable(resizing or Resizing()),
        tracing_mode="real" if free is None else "symbolic",
        _allow_non_fake_inputs=True,
    )(*examples)
    traced.graph.eliminate_dead_code()
    traced.recompile()
    return export_module(traced, examples, inputs, outputs=outputs, free=free)


def export_module(
    module: torch.nn.Module,
    examples: Sequence[Tensor],
    inputs: Sequence[str],
    *,
    outputs: Sequence[str],
    free: Sequence[dict[int, str]] | None = None,
) -> onnx.ModelProto:
    """The graph of a module that is not differentiated; arguments as of `export`."""
    named: dict[str, Any] = {name: torch.export.Dim(name) for sizes in free or () for name in sizes.values()}
    shapes = None
    if free is not None:
        shapes = tuple({axis: named[name] for axis, name in sizes.items()} for sizes in free)
    with _quiet():
        program = torch.onnx.export(
            module.eval(),
            tuple(examples),
            dynamo=True,
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_shapes=shapes,
            opset_version=OPSET,
            external_data=False,
            verbose=False,
        )
    assert program is not None  # dynamo=True always gives one
    return _bare(program.model_proto)


def _bare(model: onnx.ModelProto) -> onnx.ModelProto:
    """The graph without metadata of the export, and with each array stored once."""
    del model.metadata_props[:]
    model.doc_string = ""
    model.producer_version = ""
    if model.ir_version != IR_VERSION or [(o.domain, o.version) for o in model.opset_import] != [("", OPSET)]:
        raise NotImplementedError(
            f"The exporter wrote IR version {model.ir_version} and the operator sets {model.opset_import}; say so here."
        )
    graph = model.graph
    graph.doc_string = ""
    graph.name = "graph"
    del graph.metadata_props[:]
    del graph.value_info[:]  # shapes in between: onnxruntime infers them
    for part in (*graph.node, *graph.input, *graph.output, *graph.initializer):
        del part.metadata_props[:]
        part.doc_string = ""
    first: dict[tuple[Any, ...], str] = {}
    renamed: dict[str, str] = {}
    kept = []
    for array in graph.initializer:
        renamed[array.name] = first.setdefault(tensor_key(array, array.raw_data), array.name)
        if renamed[array.name] == array.name:
            kept.append(array)
    for node in graph.node:
        node.input[:] = [renamed.get(name, name) for name in node.input]
    del graph.initializer[:]
    graph.initializer.extend(kept)
    if sum(len(array.raw_data) for array in graph.initializer) <= _CHECKED_BYTES:  # a larger one, onnxruntime checks
        onnx.checker.check_model(model)
    return model


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the exporter's warnings about optional packages and graphs in training mode, which do not apply here."""
    exporter = logging.getLogger("torch.onnx")
    level = exporter.level
    exporter.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        exporter.setLevel(level)


class ParityError(PentimentoError):
    """An exported graph does not compute what it was exported from."""


@dataclass(frozen=True, eq=False)
class Weights:
    """A file of tensors beside the graphs that refer to it."""

    file: str
    """Its name."""
    content: bytes


@dataclass(frozen=True, eq=False)
class Graph:
    """An exported graph."""

    content: bytes
    weights: Weights | None
    """Where its large tensors lie; None where the content holds all."""
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    parity: dict[str, float]
    """For each output, the norm of the difference from PyTorch over the norm of PyTorch's result, the maximum over
    examples.
    """
    tolerance: float
    """Upper bound of `parity`."""
    models: tuple[str, ...]
    """The models that it was exported from."""


def compared(
    name: str,
    model: onnx.ModelProto,
    function: Callable[..., Sequence[Tensor]],
    *,
    examples: Sequence[Sequence[Tensor]],
    units: Mapping[str, str],
    tolerance: float,
    models: tuple[str, ...],
) -> Graph:
    """A graph whose results were compared with those of its function.

    An example is skipped if the graph differs by more than the tolerance, but the function itself is not determined to
    within the tolerance there, such as a gradient at a kink.

    Args:
        units: of each input and output, in words.
        tolerance: maximum difference of an output, relative to its norm.

    Raises:
        ParityError: an output differs by more, or no example could be compared.
    """
    inputs, outputs = (_ports(values, units) for values in (model.graph.input, model.graph.output))
    weights = _separated(model, f"{name}.weights")
    content = model.SerializeToString(deterministic=True)
    runtime = session(content, {} if weights is None else {weights.file: weights.content})
    parity = {port.name: 0.0 for port in outputs}
    undetermined = 0
    for arguments in examples:
        expected = _results(function, arguments)
        given = {port.name: argument.numpy() for port, argument in zip(inputs, arguments, strict=True)}
        found = [relative_difference(*pair) for pair in zip(runtime.run(None, given), expected, strict=True)]
        if max(found) > tolerance and _sensitivity(function, arguments, expected) > tolerance:
            undetermined += 1
            continue
        parity = {key: max(before, now) for (key, before), now in zip(parity.items(), found, strict=True)}
    if undetermined == len(examples):
        raise ParityError(
            f"The graph {name} cannot be compared: at each of {undetermined} examples, PyTorch's own result moves by "
            f"more than the tolerance of {tolerance:g} with the sixth digit of its input."
        )
    worst = max(parity, key=lambda key: parity[key])
    if not parity[worst] <= tolerance:
        raise ParityError(
            f"The graph {name} gives {worst} with a relative difference of {parity[worst]:.2g} from PyTorch's, above "
            f"the tolerance of {tolerance:g}: look for an operator that is exported otherwise, or for an epsilon."
        )
    rounded = {key: float(f"{error:.2g}") for key, error in parity.items()}
    return Graph(content, weights, inputs, outputs, rounded, tolerance, models)


def _separated(model: onnx.ModelProto, file: str) -> Weights | None:
    """Move the large tensors of a large graph into a file beside it; None for a small graph."""
    arrays = model.graph.initializer
    if sum(len(array.raw_data) for array in arrays) <= INLINE_BYTES:
        return None
    return packed(((array, array.raw_data) for array in arrays if len(array.raw_data) >= _SMALL_BYTES), file)


def packed(tensors: Iterable[tuple[onnx.TensorProto, bytes | memoryview]], file: str) -> Weights:
    """Move tensors, given with their bytes, out of their graphs into one file, those that `tensor_key` equates once."""
    kept: list[bytes | memoryview] = []
    offsets: dict[tuple[Any, ...], int] = {}
    at = 0
    for array, data in tensors:
        key = tensor_key(array, data)
        if key not in offsets:
            gap = -at % ALIGNED_BYTES
            offsets[key] = at + gap
            kept += [bytes(gap), data]
            at = offsets[key] + len(data)
        del array.external_data[:]
        for name, value in (("location", file), ("offset", offsets[key]), ("length", len(data))):
            array.external_data.add(key=name, value=str(value))
        array.data_location = onnx.TensorProto.EXTERNAL
        array.ClearField("raw_data")
    return Weights(file, b"".join(kept))


def tensor_key(array: onnx.TensorProto, data: bytes | memoryview) -> tuple[Any, ...]:
    """Equal for tensors of the same type, shape and bytes; a graph holds no two such tensors."""
    return array.data_type, tuple(array.dims), data


def relative_difference(result: NDArray[Any], expected: NDArray[Any]) -> float:
    """Norm of the difference over the norm of the expected result; norm of the difference if the expected result is
    zero.

    Infinite for another shape, or if NaN is at other positions than in the expected result.
    """
    if result.shape != expected.shape or not np.array_equal(np.isnan(result), np.isnan(expected)):
        return float("inf")
    known = ~np.isnan(expected)
    difference = np.linalg.norm((result[known] - expected[known]).astype(np.float64))
    size = np.linalg.norm(expected[known].astype(np.float64))
    return float(difference / size if size > 0 else difference)


def _results(function: Callable[..., Sequence[Tensor]], arguments: Sequence[Tensor]) -> list[NDArray[Any]]:
    return [value.detach().numpy() for value in function(*arguments)]


def _sensitivity(
    function: Callable[..., Sequence[Tensor]], arguments: Sequence[Tensor], expected: Sequence[NDArray[Any]]
) -> float:
    """Maximum relative change of a result when every input changes by `_NUDGE` of itself."""
    numbers = torch.Generator().manual_seed(0)
    moves = []
    for _ in range(_NUDGES):
        nudged = [
            argument * (1 + _NUDGE * torch.randn(argument.shape, generator=numbers))
            if argument.is_floating_point()
            else argument
            for argument in arguments
        ]
        results = _results(function, nudged)
        moves += [relative_difference(result, expected) for result, expected in zip(results, expected, strict=True)]
    return max(moves)


def session(content: bytes, weights: Mapping[str, bytes]) -> onnxruntime.InferenceSession:
    """A graph and its tensors by the names of their files, opened on one thread of the CPU."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    if weights:
        options.add_external_initializers_from_files_in_memory(
            [*weights], [*weights.values()], [len(data) for data in weights.values()]
        )
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def generator(name: str, number: int) -> torch.Generator:
    """The random generator of a graph's example."""
    seed = int.from_bytes(name.encode()[-6:], "little") + number
    return torch.Generator().manual_seed(seed)


def _ports(values: Sequence[onnx.ValueInfoProto], units: Mapping[str, str]) -> tuple[Port, ...]:
    ports = []
    for value in values:
        tensor = value.type.tensor_type
        shape = tuple(size.dim_param or size.dim_value for size in tensor.shape.dim)
        whole = tensor.elem_type == onnx.TensorProto.INT64
        ports.append(Port(value.name, shape, "int64" if whole else "float32", units[value.name]))
    return tuple(ports)
