"""From a picture to strokes, and from strokes to a painting: plan, execute some, look, replan the rest."""
