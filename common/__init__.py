"""What every script needs: input errors, atomic files, progress, command-line flags, provenance."""
