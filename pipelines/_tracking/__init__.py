"""Records each execution of a stage as one run in MLflow. Only this package and `_review` import MLflow."""

from pipelines._tracking.dvc_files import input_digests
from pipelines._tracking.run import Run, tracked_run

__all__ = ["Run", "input_digests", "tracked_run"]
