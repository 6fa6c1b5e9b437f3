"""Captioned scenes, ordinary edits of them, and ink: what people would draw and say."""
