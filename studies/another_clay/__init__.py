"""A second simulator of pushes, for the gap finder alone: it shares no form with the studio or the models."""
