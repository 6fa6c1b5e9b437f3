"""What the sculptor can do, in the studio (thesis 7.4.2, 7.5.2): alphabet, smoothing, long horizons, noise, pellets,
rims.

Each experiment writes one JSON file into a folder and can be run again for other seeds; `page.py` makes
docs/sculpting.md of them.
"""
