"""Handwriting styles from demonstrations: recordings, TrajVAE, evaluation and drawing (thesis 5.3)."""
