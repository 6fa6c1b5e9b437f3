"""Co-painting: captioned scenes, partial paintings, and a goal planner that learns to complete them."""
