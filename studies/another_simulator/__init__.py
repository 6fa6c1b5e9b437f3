"""A second simulator of strokes, for the diagnosis only: it shares no form with the studio or the models."""
