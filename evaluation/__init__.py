"""Sequences -> boxes -> tracker -> result files -> figures: the parts of evaluate.py."""
