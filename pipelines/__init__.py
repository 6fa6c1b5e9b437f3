"""The stages: one thin module for each step in dvc.yaml, named like the step and its params section."""

import os

# Linear algebra adds up in another order on another number of threads, and outputs would differ. The libraries
# read this when they are loaded, hence here; PyTorch's threads are set in `_io.single_threaded`.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
