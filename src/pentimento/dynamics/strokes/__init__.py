"""Stroke dynamics: models of the mark that a single stroke leaves, trained on recorded strokes."""
