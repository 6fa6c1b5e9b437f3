"""TrajVAE on people's strokes: reconstruction error, gain from few strokes, and discrimination of its samples."""
