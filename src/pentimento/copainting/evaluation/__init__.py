"""Evaluation of goal planners on started canvases: scores, and drawing in turns (thesis 6.5 to 6.8)."""
