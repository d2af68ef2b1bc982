"""Moving objects: own traffic in a town, and replayed label files."""
