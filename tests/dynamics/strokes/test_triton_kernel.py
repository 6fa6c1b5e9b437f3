"""The GPU's renderer against the dense reference and the CPU's kernel.

Where a CUDA device is met, the comparisons run on it. Otherwise they run in Triton's interpreter, in a process of
their own: Triton reads TRITON_INTERPRET when it is imported. Without Triton nothing here can run, and it says so.
"""

import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from pentimento.dynamics.strokes.autograd import render_strokes
from pentimento.dynamics.strokes.reference import render_reference
from pentimento.render.kernel import RenderInputError
from tests.render.paintings import painting

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("triton") is None,
    reason="Triton is not installed: the GPU's renderer is NOT tested (pip install 'triton==3.7.1' to interpret it)",
)
INTERPRETED = os.environ.get("TRITON_INTERPRET") == "1"
NAMES = ("points", "radius", "density", "softness", "color", "canvas")
SHAPE = (23, 35)
DEVICE = torch.device("cuda" if torch.cuda.is_available() and not INTERPRETED else "cpu")
in_either = pytest.mark.skipif(
    DEVICE.type == "cpu" and not INTERPRETED,
    reason="no CUDA device: test_triton_kernel_agrees_in_the_interpreter runs this in Triton's interpreter",
)

Render = Callable[..., torch.Tensor]


@pytest.fixture
def render_triton() -> Render:
    kernel = importlib.import_module("pentimento.dynamics.strokes.triton_kernel")
    return lambda *inputs: kernel.render_triton(*painting(*inputs))


def strokes(
    count: int, points: int, seed: int, shape: tuple[int, int] = SHAPE, dtype: torch.dtype = torch.float32
) -> list[torch.Tensor]:
    """Random strokes that cross, some partly off the canvas, with everything varying along them; and a canvas."""
    rng = np.random.default_rng(seed)
    start = rng.uniform((0, 0), (shape[1], shape[0]), (count, 1, 2))
    steps = np.cumsum(rng.normal(0, 2.5, (count, points, 2)), axis=1)
    arrays = [
        (start + steps)[None],
        rng.uniform(1, 4, (1, count, points)),
        rng.uniform(0.3, 1, (1, count, points)),
        rng.uniform(0.4, 1.5, (1, count, points)),
        rng.uniform(0, 1, (1, count, 3)),
        rng.uniform(0, 1, (1, *shape, 3)),
    ]
    return [torch.tensor(a, dtype=dtype, device=DEVICE) for a in arrays]


def with_gradients(render: Render, inputs: list[torch.Tensor]) -> tuple[torch.Tensor, tuple[torch.Tensor, ...]]:
    """The image and the gradients of a random weighting of it, on the CPU in float64."""
    inputs = [x.detach().requires_grad_(True) for x in inputs]
    image = render(*inputs)
    weight = torch.randn(image.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).to(image)
    gradients = torch.autograd.grad((image * weight).sum(), inputs)
    return image.detach().double().cpu(), tuple(g.double().cpu() for g in gradients)


def reference(*inputs: torch.Tensor) -> torch.Tensor:
    return torch.stack([render_reference(*painting(*one)) for one in zip(*inputs, strict=True)])


def assert_like(render: Render, oracle: Render, inputs: list[torch.Tensor]) -> None:
    """Values to 1e-5; of each gradient the norm of the difference to 1e-4 of the norm."""
    image, ours = with_gradients(render, inputs)
    wanted, theirs = with_gradients(oracle, [x.double().cpu() for x in inputs])
    assert float((image - wanted).abs().max()) <= 1e-5
    for name, a, b in zip(NAMES, ours, theirs, strict=True):
        assert bool(torch.isfinite(a).all()), name
        assert float((a - b).norm()) <= 1e-4 * float(b.norm()), name


@pytest.mark.skipif(INTERPRETED, reason="this is the interpreter")
@pytest.mark.skipif(torch.cuda.is_available(), reason="a CUDA device is at hand: the same tests run there")
def test_triton_kernel_agrees_in_the_interpreter() -> None:
    """Every comparison below, in a process in which Triton interprets its programs on the CPU."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-rfEs", __file__]
    root = Path(__file__).parents[2]
    done = subprocess.run(
        command, cwd=root, env={**os.environ, "TRITON_INTERPRET": "1"}, capture_output=True, text=True, timeout=110
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "in Triton's interpreter" not in done.stdout, f"comparisons were skipped:\n{done.stdout}"


@in_either
@pytest.mark.parametrize("points", [1, 2, 5])
def test_values_and_gradients_agree_with_the_reference(render_triton: Render, points: int) -> None:
    assert_like(render_triton, reference, strokes(5, points, seed=points))


@in_either
def test_strokes_of_one_density_and_softness_take_the_nearest_segment(render_triton: Render) -> None:
    """The segment with the smallest D/R, also where another covers the pixel more; thin and thick parts, next to each
    other."""
    inputs = strokes(4, 6, seed=12)
    inputs[1] = inputs[1].sub(1).mul(2)
    inputs[2], inputs[3] = torch.full_like(inputs[2], 0.8), torch.full_like(inputs[3], 0.3)
    assert_like(render_triton, reference, inputs)


@in_either
def test_triton_and_cpu_agree_to_rounding_in_float64(render_triton: Render) -> None:
    """All but the floor under the radius, which Triton rounds to float32."""
    inputs = strokes(3, 3, seed=3, dtype=torch.float64)
    image, ours = with_gradients(render_triton, inputs)
    wanted, theirs = with_gradients(reference, [x.cpu() for x in inputs])
    torch.testing.assert_close(image, wanted, atol=1e-9, rtol=0)
    for a, b in zip(ours, theirs, strict=True):
        assert float((a - b).norm()) <= 1e-9 * float(b.norm())


@in_either
@pytest.mark.parametrize("shape", [(1, 1), (16, 16), (3, 41)])
def test_canvases_of_any_size(render_triton: Render, shape: tuple[int, int]) -> None:
    inputs = strokes(3, 3, seed=11, shape=shape)
    assert_like(render_triton, reference, inputs)


@in_either
def test_paintings_of_a_batch_are_their_own(render_triton: Render) -> None:
    pairs = zip(strokes(3, 3, seed=1), strokes(3, 3, seed=2), strict=True)
    assert_like(render_triton, reference, [torch.cat(pair) for pair in pairs])


@in_either
def test_later_strokes_cover_earlier_ones(render_triton: Render) -> None:
    points = torch.tensor([[[10.0, 10.0], [20.0, 10.0]]] * 2, device=DEVICE)[None]
    ones = torch.ones(1, 2, 2, device=DEVICE)
    color = torch.tensor([[[1.0, 0, 0], [0, 0, 1.0]]], device=DEVICE)
    image = render_triton(points, 3 * ones, ones, 0 * ones, color, torch.ones(1, *SHAPE, 3, device=DEVICE))
    assert image[0, 10, 15].tolist() == [0, 0, 1]


@in_either
def test_gradient_reaches_a_stroke_of_zero_density(render_triton: Render) -> None:
    inputs = strokes(1, 2, seed=7)
    inputs[2].zero_()
    image, (_, _, g_density, _, _, _) = with_gradients(render_triton, inputs)
    torch.testing.assert_close(image, inputs[5].double().cpu())
    assert float(g_density.abs().min()) > 0
    assert_like(render_triton, reference, inputs)


@in_either
@pytest.mark.parametrize(
    ("points", "radius"),
    [
        ([[10.0, 9.0], [10.0, 9.0], [14.0, 9.0]], [3.0, 2.0, 2.0]),  # a repeated point
        ([[10.0, 9.0], [10.0, 9.0], [10.0, 9.0]], [3.0, 2.0, 2.0]),  # no length, on a pixel's centre
        ([[5.0, 9.2], [12.0, 9.3], [15.0, 8.0]], [0.0, 0.0, 0.0]),  # no width
        ([[-500.0, 9.0], [12.0, 9.3], [15.0, 8000.0]], [3.0, 2.0, 2.0]),  # from far away
    ],
)
def test_degenerate_strokes_are_finite(render_triton: Render, points: list[list[float]], radius: list[float]) -> None:
    inputs = strokes(1, 3, seed=2)
    inputs[0], inputs[1] = torch.tensor([[points]], device=DEVICE), torch.tensor([[radius]], device=DEVICE)
    image, gradients = with_gradients(render_triton, inputs)
    wanted, _ = with_gradients(reference, [x.double().cpu() for x in inputs])
    assert float((image - wanted).abs().max()) <= 1e-4
    assert all(bool(torch.isfinite(g).all()) for g in gradients)


@in_either
def test_radius_below_the_minimum_has_no_gradient(render_triton: Render) -> None:
    inputs = strokes(1, 3, seed=2)
    inputs[0] = torch.tensor([[[[5.3, 9.02], [12.4, 9.01], [18.2, 9.03]]]], device=DEVICE)
    inputs[1] = torch.full_like(inputs[1], 0.01)
    assert_like(render_triton, reference, inputs)
    _, (g_points, g_radius, *_) = with_gradients(render_triton, inputs)
    assert not g_radius.any()
    assert bool(g_points.any())


@in_either
@pytest.mark.parametrize("count", [0, 3])
def test_strokes_that_leave_no_ink_leave_the_canvas(render_triton: Render, count: int) -> None:
    inputs = strokes(count, 4, seed=6)
    inputs[0] = inputs[0] + 1000
    image, gradients = with_gradients(render_triton, inputs)
    torch.testing.assert_close(image, inputs[5].double().cpu(), atol=0, rtol=0)
    assert all(not g.any() for g in gradients[:5])
    assert bool((gradients[5] != 0).all())


@in_either
def test_no_gradient_wanted_gives_the_same_image(render_triton: Render) -> None:
    inputs = strokes(3, 3, seed=4)
    kept = render_triton(*[x.clone().requires_grad_(True) for x in inputs])
    assert torch.equal(render_triton(*inputs), kept.detach())


@in_either
def test_bad_inputs_are_named(render_triton: Render) -> None:
    bad = strokes(2, 3, seed=1)
    bad[1][0, 1, 2] = float("nan")
    with pytest.raises(RenderInputError, match=r"radius\[0, 1, 2\] is nan"):
        render_triton(*bad)
    with pytest.raises(RenderInputError, match=r"color must have shape \(1, 2, 3\), not \(1, 3, 3\)"):
        render_triton(*[*strokes(2, 3, seed=1)[:4], *strokes(3, 3, seed=1)[4:]])
    with pytest.raises(RenderInputError, match=r"canvas is torch\.float64"):
        render_triton(*strokes(2, 3, seed=1)[:5], strokes(2, 3, seed=1)[5].double())
    with pytest.raises(RenderInputError, match="float32, or all float64"):
        render_triton(*[x.half() for x in strokes(2, 3, seed=1)])


@pytest.mark.skipif(INTERPRETED, reason="the interpreter compiles nothing")
def test_tensors_of_the_cpu_are_sent_back(render_triton: Render) -> None:
    with pytest.raises(RenderInputError, match="needs tensors on a GPU, not on cpu"):
        render_triton(*[x.cpu() for x in strokes(2, 3, seed=1)])


@pytest.mark.skipif(INTERPRETED, reason="the interpreter compiles nothing")
@pytest.mark.parametrize(("name", "constants"), [("paint_tile", {"KEEP": True}), ("unpaint_tile", {})])
@pytest.mark.parametrize("real", ["fp32", "fp64"])
def test_the_programs_compile_for_a_gpu(
    name: str, constants: dict[str, int], real: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To machine code, without a GPU: the interpreter lets pass what the compiler does not."""
    monkeypatch.setenv("TRITON_CACHE_DIR", str(tmp_path))
    compiler = importlib.import_module("triton.compiler")
    target = importlib.import_module("triton.backends.compiler").GPUTarget("cuda", 80, 32)
    program = getattr(importlib.import_module("pentimento.dynamics.strokes.triton_programs"), name)
    constants = {**constants, "SIDE": 16}
    lists = dict.fromkeys(["tile_start", "visit_stroke", "visit_start", "slot"], "*i64")
    lists |= {"segment": "*i32", "winner": "*i16", "constant": "*i8"} | dict.fromkeys(constants, "constexpr")
    sizes = dict.fromkeys(["n_points", "height", "width", "tiles_x", "tiles"], "i32")
    signature = {argument: (lists | sizes).get(argument, f"*{real}") for argument in program.arg_names}
    compiled = compiler.compile(compiler.ASTSource(program, signature, constants), target=target)
    assert len(compiled.asm["cubin"]) > 1000


@pytest.mark.skipif(DEVICE.type == "cpu", reason="no CUDA device: a painting's size and memory are NOT tested")
class TestOnCuda:
    """At the size of a painting, for which the interpreter would take many minutes."""

    def test_a_painting_agrees_with_the_cpu_kernel(self, render_triton: Render) -> None:
        assert_like(
            render_triton,
            lambda *inputs: render_strokes(*painting(*inputs)),
            strokes(400, 32, seed=0, shape=(512, 512)),
        )

    def test_gradients_are_the_same_at_every_run(self, render_triton: Render) -> None:
        inputs = strokes(400, 32, seed=1, shape=(512, 512))
        first, second = (with_gradients(render_triton, inputs)[1] for _ in range(2))
        assert all(torch.equal(a, b) for a, b in zip(first, second, strict=True))

    def test_memory_does_not_grow_with_the_canvas(self, render_triton: Render) -> None:
        beyond_images = []
        for side in (512, 2048):
            inputs = [x.requires_grad_(True) for x in strokes(400, 32, seed=0, shape=(512, 512))[:5]]
            canvas = torch.zeros(1, side, side, 3, device=DEVICE)
            torch.cuda.reset_peak_memory_stats()
            start = torch.cuda.memory_allocated()
            render_triton(*inputs, canvas).sum().backward()
            images = 4 * canvas.numel() * canvas.element_size()  # painted, its gradient twice, the canvas's
            beyond_images.append(torch.cuda.max_memory_allocated() - start - images)
        small, large = beyond_images
        assert large <= 1.5 * max(small, 1)
