"""Colour paintings of twelve photographs, scored after execution, for planners at equal numbers of strokes."""
