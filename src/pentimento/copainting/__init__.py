"""Co-painting: captioned scenes, synthesised pairs of partial and full paintings, a goal planner, and its
evaluation."""
