"""The strokes of a known model, shared with the tests of stroke dynamics."""

from tests.dynamics.strokes.conftest import made_by_truth

__all__ = ["made_by_truth"]
