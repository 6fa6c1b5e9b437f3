"""Blind tests of the gap finder: worlds that hide an effect, and the tables that a robot records in them."""
