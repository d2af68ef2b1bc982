"""Shared by Table II and `profile`: costs of the blocks, and the detector in plain Keras."""
