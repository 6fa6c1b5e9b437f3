"""Studies: the large blind tests and the tables and figures that take hours."""
