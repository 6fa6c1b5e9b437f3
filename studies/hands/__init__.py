"""TrajVAE on strokes that people drew: how near, what few strokes add, and whether samples can be told from people."""
