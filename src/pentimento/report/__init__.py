"""The report: what the pipeline made, as one HTML page that explains each of its pictures."""
