"""The blind benchmark of the diagnosis: simulated worlds of strokes and of pushes whose hidden causes it must name."""
