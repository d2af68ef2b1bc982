"""The data that the training tests share."""

from pathlib import Path

import pytest
from helpers.two_cars import write_sequence


@pytest.fixture(scope="session")
def tiny_data(tmp_path_factory) -> Path:
    """Sequence 0000 with five frames, 0001 with three."""
    root = write_sequence(tmp_path_factory.mktemp("tiny_kitti"), frames=5)
    return write_sequence(root, 1, frames=3)
