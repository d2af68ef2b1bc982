"""Submission to the KITTI server: one zip with a result file per testing sequence."""

import zipfile
from collections.abc import Sequence
from pathlib import Path

from common.files import atomic_path

SUBMISSION = "submission.zip"
_EPOCH = (1980, 1, 1, 0, 0, 0)  # zip's earliest date: the same results give the same bytes


def write_submission(path: str | Path, files: Sequence[Path]) -> None:
    """Zips result files 00XX.txt, all at the root of the archive (the devkit's layout)."""
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for file in sorted(files):
            entry = zipfile.ZipInfo(file.name, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, file.read_bytes())
