"""x"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
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

from pentimento.bundle.manifest import Port
from pentimento.contracts.errors import PentimentoError
from pentimento.deploy.decompositions import Resizing, exportable

OPSET: Final = 20
"""Of ONNX's operators. onnxruntime reads it from 1.17 on."""
IR_VERSION: Final = 10
"""Of ONNX's format."""
Function = Callable[..., tuple[Tensor, ...]]


def export(
    function: Function,
    examples: Sequence[Tensor],
    inputs: Sequence[str],
    outputs: Sequence[str],
    free: Sequence[dict[int, str]] | None = None,
    resizing: Resizing | None = None,
) -> onnx.ModelProto:
    """The graph of a function of tensors that may differentiate inside, by ``torch.autograd.grad``.

    Args:
        function: takes tensors of the examples' shapes and gives a tuple of tensors.
        inputs, outputs: the names of arguments and results.
        free: of each input the dimensions whose size is left open, by name; None: all sizes are those of the examples.
            An open size must differ in the examples from every other size, or it is taken to be that one.
        resizing: where the function resizes pictures, what it puts the matrices for that into.
    """
    # Weights are real tensors beside symbolic arguments.
    traced = make_fx(
        function,
        decomposition_table=exportable(resizing or Resizing()),
        tracing_mode="real" if free is None else "symbolic",
        _allow_non_fake_inputs=True,
    )(*examples)
    traced.graph.eliminate_dead_code()
    traced.recompile()
    return export_module(traced, examples, inputs, outputs, free)


def export_module(
    module: torch.nn.Module,
    examples: Sequence[Tensor],
    inputs: Sequence[str],
    outputs: Sequence[str],
    free: Sequence[dict[int, str]] | None = None,
) -> onnx.ModelProto:
    """The graph of a module that is not differentiated; arguments as of ``export``."""
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
    """The graph with nothing of how it was made, and each array once."""
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
        content = (array.data_type, tuple(array.dims), array.raw_data)
        renamed[array.name] = first.setdefault(content, array.name)
        if renamed[array.name] == array.name:
            kept.append(array)
    for node in graph.node:
        node.input[:] = [renamed.get(name, name) for name in node.input]
    del graph.initializer[:]
    graph.initializer.extend(kept)
    onnx.checker.check_model(model)
    return model


@contextmanager
def _quiet() -> Iterator[None]:
    """The exporter warns of what is meant here: of packages it could use, and of graphs traced in training mode."""
    exporter = logging.getLogger("torch.onnx")
    level = exporter.level
    exporter.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        exporter.setLevel(level)


Examples = Callable[[int], Sequence[Tensor]]
"""The arguments of one call, anew for each number, of open sizes that change with it."""

_NUDGE = 1e-5  # of an input: with less, noise that is averaged on its way does not do what rounding on the way does
_NUDGES = 8  # of an example: whether rounding crosses a kink is chance


class ParityError(PentimentoError):
    """An exported graph does not compute what it was exported from."""


@dataclass(frozen=True, eq=False)
class Graph:
    """An exported graph."""

    content: bytes
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    parity: dict[str, float]
    """Of each output: norm of the difference from PyTorch's over the norm of PyTorch's, the largest of all examples."""
    models: tuple[str, ...]
    """Which models it came from."""


def compared(
    name: str,
    model: onnx.ModelProto,
    function: Callable[..., Sequence[Tensor]],
    examples: Sequence[Sequence[Tensor]],
    units: Mapping[str, str],
    tolerance: float,
    models: tuple[str, ...],
) -> Graph:
    """A graph whose answers were compared with those of the function that it came from.

    An example that differs by more where the function itself is not determined to within the tolerance (a gradient
    on a kink, say) shows nothing and is passed over.

    Args:
        units: of each input and output, in words.
        tolerance: the most by which an output may differ, as a share of its norm.

    Raises:
        ParityError: an output differs by more, or no example could be compared.
    """
    content = model.SerializeToString(deterministic=True)
    inputs, outputs = (_ports(values, units) for values in (model.graph.input, model.graph.output))
    runtime = session(content)
    parity = {port.name: 0.0 for port in outputs}
    undetermined = 0
    for arguments in examples:
        expected = _answers(function, arguments)
        given = {port.name: argument.numpy() for port, argument in zip(inputs, arguments, strict=True)}
        found = [relative_difference(*pair) for pair in zip(runtime.run(None, given), expected, strict=True)]
        if max(found) > tolerance and _unsteadiness(function, arguments, expected) > tolerance:
            undetermined += 1
            continue
        parity = {key: max(before, now) for (key, before), now in zip(parity.items(), found, strict=True)}
    if undetermined == len(examples):
        raise ParityError(
            f"The graph {name} cannot be compared: at each of {undetermined} examples, PyTorch's own answer moves by "
            f"more than the tolerance of {tolerance:g} with the sixth digit of its input."
        )
    worst = max(parity, key=lambda key: parity[key])
    if not parity[worst] <= tolerance:
        raise ParityError(
            f"The graph {name} gives {worst} with a relative difference of {parity[worst]:.2g} from PyTorch's, above "
            f"the tolerance of {tolerance:g}: look for an operator that is exported otherwise, or for an epsilon."
        )
    rounded = {key: float(f"{error:.2g}") for key, error in parity.items()}
    return Graph(content, inputs, outputs, rounded, models)


def relative_difference(answer: NDArray[Any], wanted: NDArray[Any]) -> float:
    """Norm of the difference over the norm of what is wanted; the norm of the answer where nothing is wanted.

    NaN must stand where it is wanted; elsewhere, or for another shape, the difference is infinite.
    """
    if answer.shape != wanted.shape or not np.array_equal(np.isnan(answer), np.isnan(wanted)):
        return float("inf")
    known = ~np.isnan(wanted)
    difference = np.linalg.norm((answer[known] - wanted[known]).astype(np.float64))
    size = np.linalg.norm(wanted[known].astype(np.float64))
    return float(difference / size if size > 0 else difference)


def _answers(function: Callable[..., Sequence[Tensor]], arguments: Sequence[Tensor]) -> list[NDArray[Any]]:
    return [value.detach().numpy() for value in function(*arguments)]


def _unsteadiness(
    function: Callable[..., Sequence[Tensor]], arguments: Sequence[Tensor], expected: Sequence[NDArray[Any]]
) -> float:
    """The most by which an answer moves, as a share of its norm, when every input moves by ``_NUDGE`` of itself."""
    numbers = torch.Generator().manual_seed(0)
    moves = []
    for _ in range(_NUDGES):
        nudged = [
            argument * (1 + _NUDGE * torch.randn(argument.shape, generator=numbers))
            if argument.is_floating_point()
            else argument
            for argument in arguments
        ]
        answers = _answers(function, nudged)
        moves += [relative_difference(answer, wanted) for answer, wanted in zip(answers, expected, strict=True)]
    return max(moves)


def session(content: bytes) -> onnxruntime.InferenceSession:
    """A graph, opened on one thread of the processor."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def generator(name: str, number: int) -> torch.Generator:
    """Random numbers of a graph's example."""
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
