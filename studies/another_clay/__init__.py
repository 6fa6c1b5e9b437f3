"""A second simulator of pushes, for the diagnosis only: it shares no form with the studio or the models."""
