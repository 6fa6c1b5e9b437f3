"""The stroke renderer: one compiled kernel, forward and backward, for planning in the workshop and on the robot."""

from pentimento.render.kernel import Fragments, StrokeGradients, render, render_backward

__all__ = ["Fragments", "StrokeGradients", "render", "render_backward"]
