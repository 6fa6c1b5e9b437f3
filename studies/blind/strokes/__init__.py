"""Simulated worlds of strokes."""

INTRODUCTION = """\
A world is drawn by seed in the virtual studio, whose physics shares no functional form with the vocabulary of causes.
Half of the tools have a footprint that the base model cannot represent. All tables have decoy columns.

*Pixels* selects causes with the same base and candidates by the likelihood of pixels (BIC, forward selection).
Tables in raster order are diagnosed twice: as recorded, and extended by the 16 actions that the first verdict proposes.
The out-of-distribution test is another session of the same world: 56 strokes, pressed in the deeper half of the tool's
range and in the faster half of its speeds."""
