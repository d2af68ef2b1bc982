"""Sequences -> boxes -> tracker -> result files -> metrics: the parts of evaluate.py."""
