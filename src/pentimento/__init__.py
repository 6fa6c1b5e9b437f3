"""Pentimento: robots that paint and sculpt, look at what they did, and change course."""

from pentimento._compiled import ensure_cache

__version__ = "0.1.0"

ensure_cache()
