"""Reading MLflow's history: which runs there are, what differs between two of them, whether DVC agrees."""
