"""The virtual studio: simulated worlds of painting and of clay, whose parameters are hidden from every model."""
