"""Scans that do not fit the labels or the calibration of their sequence are refused."""

import contextlib

import numpy as np
import pytest
from helpers import two_cars

from common.errors import InputError
from kitti.check_points import check_points
from kitti.scans.scan_files import read_scan, write_scan
from kitti.sequence import KittiSequence

FRAMES = 4


def sequence(root, change=None) -> KittiSequence:
    """Sequence 0000 of two cars, its scans changed; rings of ground make a full turn."""
    two_cars.write_sequence(root, frames=FRAMES)
    opened = KittiSequence(root, 0)
    angle, away = np.meshgrid(np.linspace(-np.pi, np.pi, 200), (6.0, 9.0, 14.0, 20.0))
    ring = np.stack([away * np.cos(angle), away * np.sin(angle), np.full(away.shape, -1.7)], -1)
    ring = np.pad(ring.reshape(-1, 3), ((0, 0), (0, 1)))
    for t in range(FRAMES):
        points = np.concatenate([read_scan(opened.scan_path(t)), ring])
        write_scan(opened.scan_path(t), points if change is None else change(points))
    return opened


def test_scans_that_hold_their_objects_are_taken(tmp_path):
    check_points(sequence(tmp_path))


@pytest.mark.parametrize("order", [[1, 0, 2, 3], [1, 2, 0, 3]])
def test_other_orders_of_the_axes_are_refused(tmp_path, order):
    opened = sequence(tmp_path, lambda points: points[:, order])
    with pytest.raises(InputError, match=r"velodyne/0000: .*expected x ahead, y left, z up"):
        check_points(opened)


def test_a_mirrored_full_turn_is_known_by_the_labels(tmp_path):
    opened = sequence(tmp_path, lambda points: points * np.float32([1, -1, 1, 1]))
    with pytest.raises(InputError, match=r"velodyne/0000: 0 of 8 labelled boxes hold a point"):
        check_points(opened)


def test_labels_of_another_sequence_are_refused(tmp_path):
    opened = sequence(tmp_path)
    rows = [line.split() for line in opened.label_path.read_text().splitlines()]
    for row in rows:
        row[13] = str(float(row[13]) + 9.0)  # metres to the right
    opened.label_path.write_text("".join(" ".join(row) + "\n" for row in rows))
    with pytest.raises(InputError, match=r"0 of \d labelled boxes hold a point"):
        check_points(KittiSequence(tmp_path, 0))


@pytest.mark.parametrize(
    ("kept", "column", "value", "tells"),
    [
        (8, 4, "0", True),
        (4, 4, "0", True),
        (3, 4, "0", False),
        (8, 4, "2", False),  # largely occluded
        (8, 15, "39", True),
        (8, 15, "41", False),  # metres ahead
    ],
)
def test_few_far_or_hidden_objects_do_not_tell(tmp_path, kept, column, value, tells):
    opened = sequence(tmp_path, lambda points: points * np.float32([1, -1, 1, 1]))
    rows = [line.split() for line in opened.label_path.read_text().splitlines()][:kept]
    for row in rows:
        row[column] = value
    opened.label_path.write_text("".join(" ".join(row) + "\n" for row in rows))
    refused = pytest.raises(InputError, match=f"0 of {kept} labelled boxes")
    with refused if tells else contextlib.nullcontext():
        check_points(KittiSequence(tmp_path, 0))


def test_a_sequence_without_scans_is_not_judged(tmp_path):
    two_cars.write_sequence(tmp_path, frames=3, missing=(0, 1, 2))
    check_points(KittiSequence(tmp_path, 0))
