"""The stages: one thin module for each step in dvc.yaml, named like the step and its params section."""
