"""Simulated worlds of pushes."""

INTRODUCTION = """\
A clay world is drawn by seed in the virtual studio, whose physics shares no functional form with the vocabulary of
causes. Material, slab, arm, scanner and tool are perturbed; half of the tools are not ball-shaped. All tables have
decoy columns. A table has 96 single actions and 24 repeated three times: 168 rows of 64 × 64 pixels around the push.
The effect's energy is measured on the same surface with and without the effect."""
