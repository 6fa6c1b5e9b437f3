"""Reads MLflow's history: the runs, the differences between two of them, and their agreement with dvc.lock."""
