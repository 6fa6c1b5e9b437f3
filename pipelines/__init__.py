"""The stages: one thin module for each step in dvc.yaml, named like the step and its params section."""

import os

# Linear algebra adds up in another order on another number of threads, and outputs would differ. The libraries
# read this when they are loaded, hence here; PyTorch's threads are set in `_io.single_threaded`.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
# What is read from a folder must not depend on whether there is a network; a tokenizer's file even tells. Who wants
# published weights fetched sets it to 0.
os.environ.setdefault("HF_HUB_OFFLINE", "1")
