"""Lens, canvas, colour and touch calibration."""
