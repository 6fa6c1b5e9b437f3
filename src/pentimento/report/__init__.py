"""The report: the pipeline's results as one HTML page."""
