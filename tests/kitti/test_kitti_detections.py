"""Detections in the layout of a file for each sequence."""

import numpy as np
import pytest
from helpers.kitti_rows import DETECTION, write_rows

from common.errors import InputError
from kitti.detections import read_detections


def test_detections(tmp_path):
    rows = [DETECTION.format(frame=3, score=-1.5), DETECTION.format(frame=0, score=7)]
    rows += [rows[0].replace(",2,100", f",{number},100") for number in (3, 1)]
    found = read_detections(write_rows(tmp_path / "d.txt", rows))
    assert found.frame.tolist() == [0, 3, 3, 3]
    assert found.type.tolist() == ["Car", "Car", "Cyclist", "Pedestrian"]
    assert found.track_id.tolist() == [-1, -1, -1, -1]
    assert found.score.tolist() == [7, -1.5, -1.5, -1.5]
    assert found.alpha[0] == -1.5
    np.testing.assert_allclose(
        found.boxes[0], [20, -2, -1.7 + 0.75, 4.0, 1.6, 1.5, -0.3 - np.pi / 2]
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("1.5,1.6,4.0", "1.5,1e-300,4.0"), "columns 8-10: expected sizes h w l of at least"),
        (("1.5,1.6,4.0", "5e6,1.6,4.0"), "columns 8-10: expected sizes h w l of at most 1000 m"),
        ((",20.0,", ",1e308,"), "expected numbers of magnitude"),
        ((",2,100", ",4,100"), r"column 2: expected one of the types 1 \(Pedestrian\) 2 \(Car\)"),
        (("1.5,1.6,4.0", "1.5,1.6,0"), "columns 8-10: expected sizes"),
        ((",-1.5", ""), "expected 15 columns, found 14"),
        ((",0.3,", ",nan,"), "column 14: expected a finite number"),
        (("8,2", "-8,2"), "column 1: expected a frame number >= 0"),
        (("8,2", "50,2"), "column 1: frame beyond the sequence, expected 0 to 9"),
        ((",", " "), "expected 15 columns, found 1"),
    ],
)
def test_bad_detections(tmp_path, change, message):
    rows = [DETECTION.format(frame=0, score=1), DETECTION.format(frame=8, score=1).replace(*change)]
    with pytest.raises(InputError, match=rf"d\.txt:2: {message}"):
        read_detections(write_rows(tmp_path / "d.txt", rows), 10)


@pytest.mark.real
def test_all_real_detections_are_read(kitti_root):
    paths = sorted((kitti_root / "detections" / "pointrcnn_Car").glob("*.txt"))
    found = [read_detections(path) for path in paths]
    lines = sum(len(path.read_text().splitlines()) for path in paths)
    assert sum(map(len, found)) == lines
    assert all(np.isfinite(part.boxes).all() for part in found)
