"""A second simulator of strokes, for the diagnosis alone: it shares no form with the studio or the models."""
