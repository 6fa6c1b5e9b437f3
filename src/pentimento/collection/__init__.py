"""Designed strokes and pushes, executed and recorded."""
