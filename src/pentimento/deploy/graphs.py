"""A graph to deploy: exported, compared with PyTorch on fresh examples, and ready to be listed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.bundle.manifest import Port
from pentimento.contracts.errors import PentimentoError

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
