"""Settings of every test: no network, one thread, no colours."""

import os

os.environ.update(
    HF_HUB_OFFLINE="1",
    MLFLOW_DISABLE_TELEMETRY="true",
    DO_NOT_TRACK="true",
    OMP_NUM_THREADS="1",
    NO_COLOR="1",
    MPLBACKEND="Agg",
)
