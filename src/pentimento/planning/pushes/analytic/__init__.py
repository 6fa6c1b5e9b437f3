"""Analytic model of a push, its named causes, and the correction of a push network by them, without PyTorch."""
