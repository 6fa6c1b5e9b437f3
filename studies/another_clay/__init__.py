"""A second simulator of pushes, for the diagnosis alone: it shares no form with the studio or the models."""
