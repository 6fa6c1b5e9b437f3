"""Diagnosis of any simulator: which named causes make measured actions differ from what a model predicts."""
