"""Plans of strokes and of pushes: from a goal to actions, optimised through a model of what each action does."""
