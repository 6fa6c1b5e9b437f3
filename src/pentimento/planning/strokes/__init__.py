"""Plans of strokes: Bézier curves or paths decoded from a latent, behind one interface."""
