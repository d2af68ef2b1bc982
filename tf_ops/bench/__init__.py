"""Benchmark of the ops against CPU libraries: `make bench`."""
