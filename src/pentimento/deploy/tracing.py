"""From a function of PyTorch tensors to an ONNX graph: the same bytes for the same function, and nothing of where.

Gradients are part of the function: it is traced with them into primitive operators first (``make_fx``), for the
exporter cannot differentiate.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import onnx
import torch
from torch import Tensor
from torch.fx.experimental.proxy_tensor import make_fx

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
