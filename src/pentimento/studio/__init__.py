"""The virtual studio: a physical world in which a robot paints, and which no model is told about."""
