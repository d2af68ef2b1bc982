"""Scan files: formats, layouts of raw files, folders of scans, arrays of points."""
