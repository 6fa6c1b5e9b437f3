"""Models of what strokes and pushes do."""
