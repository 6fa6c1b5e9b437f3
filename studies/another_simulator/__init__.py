"""A second simulator of strokes, for the gap finder alone: it shares no form with the studio or the models."""
