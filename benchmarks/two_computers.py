"""Whether two computers paint the same: a robot's, with another processor, and the workshop's.

    python -m benchmarks.two_computers write reference.npz --bundle models/bundle      # on one
    python -m benchmarks.two_computers compare reference.npz --bundle models/bundle    # on the other

The first writes the inputs and results of the compiled renderer and the print objective, forward and backward, and of
the graphs of a bundle, if one is given. The second computes them again from the same inputs and prints the largest
difference of each part; it ends with 1 where one exceeds its tolerance. Neither needs PyTorch. Results are not equal
bit by bit: other vector instructions add in another order. In single precision the renderer may differ by 1e-5, or by
twice as much as single from double precision, since both computers round; in double precision by 1e-9; a graph by the
tolerance that its bundle states for the comparison with PyTorch.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Mapping
from itertools import groupby, product
from pathlib import Path
from typing import Any, Final, NamedTuple

import llvmlite.binding as llvm
import numpy as np
from numpy.typing import NDArray

from benchmarks.random_strokes import Case, Kind, arrays_of, as_painting
from pentimento.bundle.graphs import Graphs
from pentimento.bundle.manifest import Port
from pentimento.bundle.reader import open_bundle
from pentimento.contracts.errors import PentimentoError
from pentimento.render import render, render_backward
from pentimento.render.reconstruction_loss import seen, squared_error, srgb_of

Arrays = dict[str, NDArray[Any]]

KINDS: Final[tuple[Kind, ...]] = ("plain", "varying", "pickup")
STROKES, POINTS, SIDE_PX = 100, 32, 128
DISTANCE_PX: Final = 4
"""Viewing distance of the objective."""
TOLERANCES: Final = {"float32": 1e-5, "float64": 1e-9}
"""Of the renderer and the objective: norm of the difference over the norm of the result."""
DYNAMIC: Final = 24
"""What stands for a graph's dynamic sizes: strokes, places, and pixels of a picture's side."""
LARGEST: Final = 0.05
"""Maximum of a graph's random inputs: in metres, of a size with canvases."""
_SEED: Final = 1


class Difference(NamedTuple):
    """How far a result is from the other computer's."""

    name: str
    """``<part>, <result>``"""
    max_absolute: float
    relative: float
    """Norm of the difference over the norm of the result."""
    tolerance: float

    @property
    def part(self) -> str:
        return self.name.partition(", ")[0]


def render_inputs() -> Arrays:
    """Random strokes and canvases of each kind, a pull on their images, and a target for the objective."""
    rng = np.random.default_rng(_SEED)
    inputs: Arrays = {}
    for kind in KINDS:
        arrays = arrays_of(Case(STROKES, POINTS, SIDE_PX, kind=kind))
        inputs |= {f"{kind}/{number}": array for number, array in enumerate(arrays)}
        inputs[f"{kind}/pull"] = rng.standard_normal(arrays[5].shape).astype(np.float32)
        inputs[f"{kind}/target"] = rng.uniform(0, 1, (SIDE_PX, SIDE_PX, 3)).astype(np.float32)
    return inputs


def render_outputs(inputs: Mapping[str, NDArray[Any]]) -> Arrays:
    """Images, all gradients, and the print objective of each image with its gradient, in both precisions."""
    outputs: Arrays = {}
    for kind, precision in product(KINDS, TOLERANCES):
        own = {name: array.astype(precision) for name, array in inputs.items() if name.startswith(f"{kind}/")}
        strokes, canvas = as_painting(*(own[f"{kind}/{number}"] for number in range(7 if kind == "pickup" else 6)))
        image, fragments = render(strokes, canvas)
        gradients = render_backward(strokes, fragments, own[f"{kind}/pull"])
        target = srgb_of(seen(own[f"{kind}/target"], DISTANCE_PX))
        light = np.ascontiguousarray(image[0, ..., :3])
        slope = np.zeros_like(light)
        loss = squared_error(light, target, DISTANCE_PX, slope, 1.0)
        named = {f"gradient of {name}": array for name, array in gradients._asdict().items() if array is not None}
        named |= {"picture": image, "objective": np.array(loss), "gradient of the objective": slope}
        outputs |= {f"{kind} {precision}, {name}": array for name, array in named.items()}
    return outputs


def graph_inputs(graphs: Graphs) -> Arrays:
    """Random values for each input of each graph: up to ``LARGEST``, and 0 where they are indices or tokens."""
    rng = np.random.default_rng(_SEED)
    return {
        f"{name}/{port.name}": _random(port, rng)
        for name, entry in sorted(graphs.bundle.manifest.graphs.items())
        for port in entry.inputs
    }


def _random(port: Port, rng: np.random.Generator) -> NDArray[Any]:
    shape = [size if isinstance(size, int) else DYNAMIC for size in port.shape]
    return np.zeros(shape, np.int64) if port.type == "int64" else rng.uniform(0, LARGEST, shape).astype(np.float32)


def graph_outputs(graphs: Graphs, inputs: Mapping[str, NDArray[Any]]) -> Arrays:
    """All outputs of all graphs, by ``<graph>, <output>``."""
    outputs: Arrays = {}
    for name, entry in sorted(graphs.bundle.manifest.graphs.items()):
        found = graphs(name, *(inputs[f"{name}/{port.name}"] for port in entry.inputs))
        outputs |= {f"{name}, {port.name}": array for port, array in zip(entry.outputs, found, strict=True)}
    return outputs


def differences(
    outputs: Arrays, reference: Mapping[str, NDArray[Any]], tolerances: Mapping[str, float]
) -> Iterator[Difference]:
    """Of each result. ``tolerances`` are those of graphs by name."""
    for name, found in outputs.items():
        expected = np.asarray(reference[name], np.float64)
        part = name.partition(", ")[0]
        if part in tolerances:
            tolerance = tolerances[part]
        else:
            kind, precision = part.split()
            double = name.replace(part, f"{kind} float64")
            # The smaller one: a wrong result of either computer must not raise the tolerance.
            rounding = min(relative_norm(each[name] - each[double], each[double]) for each in (outputs, reference))
            tolerance = max(TOLERANCES[precision], 2 * rounding)
        apart = found - expected
        yield Difference(name, float(np.abs(apart).max(initial=0.0)), relative_norm(apart, expected), tolerance)


def relative_norm(apart: NDArray[Any], of: NDArray[Any]) -> float:
    """The norm of a difference over the norm of the result; 0 where there is no difference."""
    return float(np.linalg.norm(apart) / np.linalg.norm(of)) if apart.any() else 0.0


def write(file: Path, bundle: Path | None) -> None:
    """Write inputs and results of this computer."""
    inputs, graphs = render_inputs(), None if bundle is None else Graphs(open_bundle(bundle))
    outputs = render_outputs(inputs)
    if graphs is not None:
        of_graphs = graph_inputs(graphs)
        inputs |= of_graphs
        outputs |= graph_outputs(graphs, of_graphs)
    kept = {f"input {name}": array for name, array in inputs.items()}
    kept |= {f"output {name}": array for name, array in outputs.items()}
    digest = "" if graphs is None else graphs.bundle.digest
    np.savez_compressed(file, computer=np.array(computer()), digest=np.array(digest), **kept)  # type: ignore[arg-type]


def compare(file: Path, bundle: Path | None) -> bool:
    """Print how far this computer's results are from those of the file; whether all are within their tolerance."""
    with np.load(file, allow_pickle=False) as kept:
        arrays = {name: kept[name] for name in kept.files}
    inputs, reference = (
        {name.removeprefix(part): array for name, array in arrays.items() if name.startswith(part)}
        for part in ("input ", "output ")
    )
    graphs = None if bundle is None else Graphs(open_bundle(bundle, str(arrays["digest"])))
    outputs, tolerances = render_outputs(inputs), {}
    if graphs is not None:
        outputs |= graph_outputs(graphs, inputs)
        tolerances = {name: entry.tolerance for name, entry in graphs.bundle.manifest.graphs.items()}
    print(
        f"{arrays['computer']} wrote {file}; compared on {computer()}. "
        "Of each part the result nearest to its tolerance:"
    )
    print(f"{'relative':>9} {'tolerance':>9} {'max absolute':>13}")
    found = [*differences(outputs, reference, tolerances)]
    worst = [max(each, key=_share) for _, each in groupby(found, key=lambda difference: difference.part)]
    for difference in worst:
        figures = f"{difference.relative:9.1e} {difference.tolerance:9.1e} {difference.max_absolute:13.1e}"
        print(f"{figures}  {difference.name}{'' if _share(difference) <= 1 else '  DIFFERS'}")
    return all(_share(difference) <= 1 for difference in worst)


def _share(difference: Difference) -> float:
    """The difference in units of its tolerance; infinite where a result is not finite."""
    share = difference.relative / difference.tolerance
    return share if math.isfinite(share) else math.inf


def computer() -> str:
    """The processor that Numba compiles for."""
    return f"{llvm.get_host_cpu_name()} ({llvm.get_process_triple()})"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("write", "compare"))
    parser.add_argument("file", type=Path, help="an .npz file")
    parser.add_argument("--bundle", type=Path, help="folder; the same on both computers")
    given = parser.parse_args(arguments)
    try:
        if given.what == "write":
            write(given.file, given.bundle)
            return 0
        return 0 if compare(given.file, given.bundle) else 1
    except (PentimentoError, OSError) as error:
        print(error, file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
