"""The stroke renderer: one compiled kernel, forward and backward, for planning in the workshop and on the robot."""

from pentimento.render.errors import RenderInputError
from pentimento.render.kernel import Fragments, StrokeGradients, render, render_backward
from pentimento.render.strokes import PixelStrokes

__all__ = ["Fragments", "PixelStrokes", "RenderInputError", "StrokeGradients", "render", "render_backward"]
