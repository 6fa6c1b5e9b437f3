"""Tensors that several graphs of a bundle hold, stored once.

`semantic` and `text` contain the same layers of the encoder. Graphs of the same models that have much in common refer
to one file of tensors; what each of them computes does not change.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import onnx

from pentimento.deploy.graphs import INLINE_BYTES, Graph, Weights, packed, tensor_key

Tensor = tuple[onnx.TensorProto, memoryview]


def share_weights(graphs: Mapping[str, Graph], min_bytes: int = INLINE_BYTES) -> dict[str, Graph]:
    """The graphs, in their order; those of the same models that have `min_bytes` in common refer to one file.

    The file has the name of the first of them and holds each of their tensors once. All other graphs stay as they are.
    """
    result = dict(graphs)
    for models in dict.fromkeys(graph.models for graph in graphs.values()):
        of_models = {name: graph for name, graph in graphs.items() if graph.models == models}
        opened = {name: onnx.ModelProto.FromString(graph.content) for name, graph in of_models.items()}
        tensors = {name: _tensors_outside(opened[name], graph.weights) for name, graph in of_models.items()}
        holders = Counter(tensor_key(*tensor) for each in tensors.values() for tensor in each)
        in_common = {
            name: sum(len(tensor[1]) for tensor in each if holders[tensor_key(*tensor)] > 1)
            for name, each in tensors.items()
        }
        sharing = [name for name, size in in_common.items() if size >= min_bytes]
        if len(sharing) < 2:
            continue
        weights = packed([tensor for name in sharing for tensor in tensors[name]], f"{sharing[0]}.weights")
        for name in sharing:
            content = opened[name].SerializeToString(deterministic=True)
            result[name] = replace(graphs[name], content=content, weights=weights)
    return result


def _tensors_outside(model: onnx.ModelProto, weights: Weights | None) -> list[Tensor]:
    """The tensors that a graph keeps in a file, with their bytes."""
    data = memoryview(b"" if weights is None else weights.content)
    found = []
    for array in model.graph.initializer:
        if array.data_location == onnx.TensorProto.EXTERNAL:
            place = {entry.key: entry.value for entry in array.external_data}
            start = int(place["offset"])
            found.append((array, data[start : start + int(place["length"])]))
    return found
