"""Input errors, atomic files, progress, command-line flags, provenance."""
