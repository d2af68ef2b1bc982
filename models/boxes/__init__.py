"""Boxes: coding at points, decoding by clusters, score of a cluster."""
