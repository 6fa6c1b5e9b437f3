"""Stroke, push, objective and goal models of a bundle, as graphs in onnxruntime and without PyTorch.

Graphs run on the CPU unless the environment variable ``PENTIMENTO_PROVIDER`` says otherwise. On the CPU, results are
deterministic for a given number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from pentimento.bundle.manifest import MAX_CELLS, ClayFacts, WordsFacts
from pentimento.bundle.reader import Bundle
from pentimento.bundle.sampler import Networks, NoiseSchedule
from pentimento.bundle.tokenizer import Tokenizer, read_tokenizer
from pentimento.bundle.views import random_views, resizing_matrix
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.planning.pushes.memory import FRESH, PushMemory
from pentimento.planning.pushes.rollout import Pull as PushPull
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.brush import Marks, Pull, Span, StrokeTiming
from pentimento.planning.strokes.target import fit_to_canvas
from pentimento.robots.refill import Depletion
from pentimento.robots.tools import Tool

# Set before the import, which would otherwise write an identifier of this computer into the user's home.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
import onnxruntime

Array = NDArray[np.float32]
Ask = Callable[..., list[NDArray[Any]]]
"""A graph's outputs by its name and inputs, as ``Graphs`` gives them."""

PROVIDER: Final = "PENTIMENTO_PROVIDER"
_PROVIDERS: Final = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "tensorrt": "TensorrtExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
}
_ERRORS_ONLY: Final = 3  # of onnxruntime's log

onnxruntime.disable_telemetry_events()


class Graphs:
    """A bundle's graphs; each is opened at its first use."""

    def __init__(self, bundle: Bundle, threads: int = 1) -> None:
        """Each graph uses this number of ``threads`` and the provider that ``PENTIMENTO_PROVIDER`` names.

        Raises:
            ConfigError: onnxruntime has no such provider here.
        """
        self.bundle = bundle
        self._threads, self._provider = threads, chosen_provider()
        self._opened: dict[str, Any] = {}

    def __call__(self, name: str, *arguments: NDArray[Any]) -> list[NDArray[Any]]:
        """A graph's outputs, for arguments in the order of the manifest's inputs.

        Raises:
            BundleError: the bundle has no such graph.
        """
        if name not in self._opened:
            self._opened[name] = _session(
                self.bundle.graph(name), self.bundle.weights(name), self._threads, self._provider
            )
        inputs = self.bundle.manifest.graphs[name].inputs
        given = {
            port.name: np.ascontiguousarray(argument, dtype=port.type)
            for port, argument in zip(inputs, arguments, strict=True)
        }
        outputs: list[NDArray[Any]] = self._opened[name].run(None, given)
        return outputs


def chosen_provider() -> str:
    """The part of onnxruntime that computes graphs: `PENTIMENTO_PROVIDER`, one of cpu, cuda, tensorrt and coreml.

    Raises:
        ConfigError: another name, or one that this installation of onnxruntime lacks.
    """
    name = os.environ.get(PROVIDER) or "cpu"
    if name not in _PROVIDERS:
        raise ConfigError(f"{PROVIDER} is {name!r}; it must be one of {', '.join(_PROVIDERS)}.")
    there = onnxruntime.get_available_providers()
    if _PROVIDERS[name] not in there:
        raise ConfigError(
            f"{PROVIDER} is {name!r}, but onnxruntime has {', '.join(there)} here; install its build for that device, "
            "or leave the variable out."
        )
    return _PROVIDERS[name]


def _session(content: bytes, weights: Mapping[str, bytes], threads: int, provider: str) -> Any:
    """A graph from its bytes and those of its tensors in other files; no file is opened.

    Raises:
        ConfigError: the provider does not start.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = _ERRORS_ONLY
    if weights:
        options.add_external_initializers_from_files_in_memory(
            [*weights], [*weights.values()], [len(data) for data in weights.values()]
        )
    session = onnxruntime.InferenceSession(content, options, providers=[provider])
    if session.get_providers()[0] != provider:  # onnxruntime goes on without one that does not start
        raise ConfigError(f"{provider} of onnxruntime does not start here; leave {PROVIDER} out, or mend its driver.")
    return session


class _GraphModel:
    """What the brushes below share, as ``planning.strokes.brush.Brush`` has it."""

    def __init__(self, graphs: Graphs, name: str) -> None:
        """``name`` is one of the manifest's brushes."""
        self._graphs, self._name = graphs, name
        self._facts = graphs.bundle.manifest.brushes[name]
        inputs = graphs.bundle.manifest.graphs[f"{name}_marks"].inputs
        self._columns = [port.name for port in inputs if port.name in self._facts.fitted]

    @property
    def fitted(self) -> Mapping[str, Span]:
        """The columns of the strokes contract that marks depend on."""
        return self._facts.fitted

    @property
    def timing(self) -> StrokeTiming:
        """Timing of the robot that it was fitted on."""
        return self._facts.timing

    @property
    def depletion(self) -> Depletion | None:
        """How the tool's load runs out."""
        return self._facts.depletion

    @property
    def path_points(self) -> int:
        """Number of points of each path."""
        return self._facts.path_points

    def gain(self, places_m: Array) -> Array | None:
        """See ``planning.strokes.brush.Brush``."""
        if not self._facts.has_gain:
            return None
        return self._graphs(f"{self._name}_gain", places_m)[0]

    def _marks(
        self, arrays: Iterable[Array], inherited: Mapping[str, Array]
    ) -> tuple[Marks, Callable[[Marks], list[Array]]]:
        """The marks of strokes that are given by these arrays, and the pull-back to the gradient of each of them."""
        given = [array.copy() for array in arrays]  # strokes are moved in place before the pull
        given += [inherited[column] for column in self._columns]
        outputs = self._graphs(f"{self._name}_marks", *given)

        def pull(cotangent: Marks) -> list[Array]:
            back = [array for array in cotangent if array is not None]
            return self._graphs(f"{self._name}_pull", *given, *back)

        pickup = outputs.pop() if self._facts.picks_up else None
        points, radius, density, softness, paint = outputs
        return Marks(points, radius, density, softness, paint, pickup), pull


class GraphBrush(_GraphModel):
    """A stroke model of the bundle as a ``planning.strokes.brush.BezierBrush``."""

    def marks(self, strokes: Strokes, inherited: Mapping[str, Array]) -> tuple[Marks, Pull]:
        """See ``planning.strokes.brush.BezierBrush``."""
        marks, pull = self._marks(strokes.arrays(), inherited)
        return marks, lambda cotangent: Strokes(*pull(cotangent))


class GraphPathBrush(_GraphModel):
    """A stroke model of the bundle as a ``planning.strokes.brush.PathBrush``."""

    def __init__(self, graphs: Graphs, name: str, tool: Tool) -> None:
        """``name`` is one of the manifest's brushes that take paths."""
        super().__init__(graphs, name)
        self.tool = tool

    def path_marks(
        self, paths: Array, color: Array, inherited: Mapping[str, Array]
    ) -> tuple[Marks, Callable[[Marks], tuple[Array, Array]]]:
        """See ``planning.strokes.brush.PathBrush``."""
        marks, pull = self._marks((paths, color), inherited)

        def pull_both(cotangent: Marks) -> tuple[Array, Array]:
            of_paths, of_color = pull(cotangent)
            return of_paths, of_color

        return marks, pull_both


class GraphClay:
    """A network of a push model as a ``planning.pushes.rollout.PushModel``, without memory; see ``bundle.clays``."""

    def __init__(self, ask: Ask, name: str, facts: ClayFacts) -> None:
        """Its graphs are ``<name>_after`` and ``<name>_pull``."""
        self._ask, self._name, self._facts = ask, name, facts

    @property
    def window_m(self) -> NDArray[np.float64]:
        """[4], canvas frame: the area of the height maps."""
        return np.array(self._facts.window_m)

    @property
    def end_effector(self) -> str:
        """Name of the end-effector that it was fitted on."""
        return self._facts.end_effector

    def after(self, height_m: Array, actions: NDArray[np.float64], memory: PushMemory = FRESH) -> Array:
        """See ``planning.pushes.rollout.PushModel``.

        Raises:
            ContractError: heights of another shape, or that are not finite.
        """
        if len(actions) == 0:
            return np.empty((0, *height_m.shape), dtype=np.float32)
        given = np.asarray(actions, dtype=np.float32)
        after: Array = self._ask(f"{self._name}_after", self._checked(height_m), given)[0]
        return after

    def step(self, height_m: Array, action: NDArray[np.float64], memory: PushMemory = FRESH) -> tuple[Array, PushPull]:
        """See ``planning.pushes.rollout.PushModel``.

        Raises:
            ContractError: heights of another shape, or that are not finite.
        """
        # Copies, since both may change before the pull.
        height, given = self._checked(height_m).copy(), np.array(action, dtype=np.float32)

        def pull(cotangent: Array) -> tuple[Array, NDArray[np.float64]]:
            back = np.asarray(cotangent, dtype=np.float32)
            to_height, to_action = self._ask(f"{self._name}_pull", height, given, back)
            return to_height, to_action.astype(np.float64)

        return self._ask(f"{self._name}_after", height, given[None])[0][0], pull

    def _checked(self, height_m: Array) -> Array:
        if height_m.shape != self._facts.shape:
            raise ContractError(
                f"The height map is {list(height_m.shape)} and the push model was exported for "
                f"{list(self._facts.shape)} over {list(self._facts.window_m)} m: scan that window."
            )
        if not np.isfinite(height_m).all():
            raise ContractError("The height map has holes (NaN) or infinite heights; fill them before planning.")
        return np.asarray(height_m, dtype=np.float32)


class SemanticObjective:
    """Distance of a picture's patch features from a target's (thesis 4.4): a ``planning.objectives.Objective``."""

    def __init__(self, graphs: Graphs, target: Array, seed: int) -> None:
        """For a target [H, W, 3] in linear light; each call draws new views from a seeded generator."""
        self._graphs, self._target = graphs, target
        self._inputs = _Views(graphs, target.shape, seed)

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The value for an image of the target's size, and its gradient."""
        value, gradient = self._graphs("semantic", image, self._target, *self._inputs())
        return float(value), gradient


class TextObjective:
    """1 - cos of a picture and a caption, averaged over views (thesis 4.1): a ``planning.objectives.Objective``."""

    def __init__(self, graphs: Graphs, caption: str, shape: tuple[int, ...], seed: int) -> None:
        """For images of a height and width; each call draws new views from a seeded generator."""
        self._graphs, self._caption = graphs, caption_vector(graphs, caption)
        self._inputs = _Views(graphs, shape, seed)

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The value for an image [H, W, 3] in linear light, and its gradient."""
        value, gradient = self._graphs("text", image, self._caption, *self._inputs())
        return float(value), gradient


@dataclass(frozen=True, eq=False)
class GraphMeaning:
    """What the bundle's encoder sees, a ``planning.strokes.scene.Meaning``."""

    graphs: Graphs
    seed: int

    def text(self, words: str, shape: tuple[int, int]) -> TextObjective:
        """The text objective for these words, for images of this height and width."""
        return TextObjective(self.graphs, words, shape, self.seed)

    def semantic(self, target: Array) -> SemanticObjective:
        """The semantic objective for a target [H, W, 3] in linear light."""
        return SemanticObjective(self.graphs, target, self.seed)


class _Views:
    """Further inputs of the encoder graphs: new views at each call, and the matrices that resize."""

    def __init__(self, graphs: Graphs, shape: tuple[int, ...], seed: int) -> None:
        facts = graphs.bundle.manifest.encoder
        self._views, self._rng = facts.views, np.random.default_rng(seed)
        self._matrices = [resizing_matrix(side, facts.image_px) for side in shape[:2]]

    def __call__(self) -> list[Array]:
        return [random_views(self._views, self._rng), *self._matrices]


class PictureStyle:
    """A picture's style by local features (thesis 4.2), a ``planning.strokes.scene.Style``."""

    def __init__(self, graphs: Graphs, picture_srgb: NDArray[np.uint8], seed: int) -> None:
        """``seed`` is for drawing cells where pictures have too many to pair them all."""
        self._graphs, self._picture, self._seed = graphs, picture_srgb, seed

    def picture(self, shape: tuple[int, int]) -> Array:
        """The picture's largest centred part with the proportions of ``shape``, linear light [H, W, 3]."""
        return np.asarray(fit_to_canvas(self._picture, shape), dtype=np.float32)

    def objective(self, shape: tuple[int, int]) -> StyleObjective:
        """The style objective for images of this height and width.

        Raises:
            ConfigError: the bundle has no style graphs for that size.
        """
        return StyleObjective(self._graphs, self.picture(shape), self._seed)


class StyleObjective:
    """Earth Mover's Distance between the sets of local features of an image and of a style picture.

    As ``semantics.style`` has it; a ``planning.objectives.Objective``.
    """

    def __init__(self, graphs: Graphs, style: Array, seed: int) -> None:
        """For the features of ``style``, [H, W, 3] in linear light.

        Raises:
            ConfigError: the bundle has no style graphs for that size.
        """
        styles, (height, width) = graphs.bundle.manifest.styles, style.shape[:2]
        names = [name for name, facts in styles.items() if (facts.height_px, facts.width_px) == (height, width)]
        if not names:
            known = ", ".join(f"{facts.height_px} x {facts.width_px}" for facts in styles.values()) or "none"
            raise ConfigError(
                f"The bundle has style graphs for pictures of {known} px, not of {height} x {width} px: plan in one of "
                "its settings, or deploy another."
            )
        self._graphs, self._name = graphs, names[0]
        self._cells = graphs.bundle.manifest.styles[self._name].cells
        self._style = graphs(f"{self._name}_features", style)[0]
        self._rng = np.random.default_rng(seed)

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The value for an image of the style picture's size, and its gradient.

        Raises:
            ContractError: the image is not finite.
        """
        features = self._graphs(f"{self._name}_features", image)[0]
        if not np.isfinite(features).all():
            raise ContractError("The image has pixels that are not finite, and so no local features; look for NaN.")
        drawn, others = self._drawn(), self._style[self._drawn()]
        _, columns = linear_sum_assignment(distances(features[drawn], others))
        partners = others[columns]
        value, gradient = self._graphs(f"{self._name}_pull", image, drawn, partners)
        return float(value), gradient

    def _drawn(self) -> NDArray[np.int64]:
        """The cells to pair: all, or ``MAX_CELLS`` at random."""
        if self._cells <= MAX_CELLS:
            return np.arange(self._cells)
        return self._rng.permutation(self._cells)[:MAX_CELLS]


def distances(points: Array, others: Array) -> NDArray[np.float64]:
    """Euclidean distances [N, N] from each of ``points`` [N, D] to each of ``others`` [N, D]."""
    squares = np.zeros((len(points), len(others)))
    for one, other in zip(points.T.astype(np.float64), others.T.astype(np.float64), strict=True):
        squares += np.square(one[:, None] - other)
    return np.asarray(np.sqrt(squares))


def caption_vector(graphs: Graphs, caption: str) -> Array:
    """The unit vector [D] of a caption; a caption longer than the encoder's input is truncated."""
    tokens = tokenizer(graphs.bundle, graphs.bundle.manifest.encoder.words).encode([caption])
    vector: Array = graphs("caption", tokens)[0][0]
    return vector


def tokenizer(bundle: Bundle, words: WordsFacts) -> Tokenizer:
    """One of the bundle's tokenizers."""
    return read_tokenizer(bundle.folder / words.vocabulary, bundle.folder / words.merges, words.tokens)


def goal_networks(graphs: Graphs) -> Networks:
    """The goal planner's networks for ``bundle.sampler.complete``."""

    def one(name: str, *arguments: NDArray[Any]) -> Array:
        output: Array = graphs(name, *arguments)[0]
        return output

    return Networks(
        read=lambda tokens: one("goal_text", tokens),
        encode=lambda pictures: one("goal_encode", pictures),
        predict=lambda noisy, timestep, text: one("goal_denoise", noisy, np.array([timestep]), text),
        decode=lambda latents: one("goal_decode", latents),
        scaling=graphs.bundle.manifest.goal.scaling,
    )


def noise_schedule(bundle: Bundle) -> NoiseSchedule:
    """The goal planner's noise schedule."""
    goal = bundle.manifest.goal
    alphas = np.array(goal.alphas_cumprod, dtype=np.float32)
    return NoiseSchedule(alphas, goal.final_alpha, goal.prediction, goal.spacing, goal.offset)
