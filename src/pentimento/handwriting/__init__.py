"""Strokes that people drew: recordings read, repaired, brought to a standard frame; and hands that are made up."""
