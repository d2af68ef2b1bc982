"""Studies of parameters and readings that the paper leaves open; no table of the paper."""
