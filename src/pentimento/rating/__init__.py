"""Blind ratings of pictures by people: pages, their answers, and exact tests (thesis 4.5.3, 5.4.1, 6.6.1)."""
