"""Strokes of any shape: as a hand draws them, or Bézier curves, planned alike (thesis 5.3.5, 5.3.6)."""
