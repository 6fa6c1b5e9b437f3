"""Captioned scenes with regions, edits of them, and pictures in ink."""
