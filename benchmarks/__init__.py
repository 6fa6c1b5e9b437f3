"""`make bench`: what the project's hot loops cost, side by side with their slow references."""
