"""Evaluation of goal planners on started canvases: scores, drawing in turns and preferences (thesis 6.5 to 6.8)."""
