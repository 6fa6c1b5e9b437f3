"""Pentimento: robots that paint and sculpt, look at what they did, and change course."""

__version__ = "0.1.0"
