"""Blind tests of the gap finder on pushes."""
