"""Geometric appearance vectors and label motion."""

import numpy as np
import pytest

from kitti.boxes import transform_boxes
from tracking import LabelMotion, assign_label_ids, geometric_appearance
from tracking.appearance import Gallery

CAR = np.array([5.0, 1.0, -1.0, 4.0, 1.8, 1.5, 0.4])


def points_on(box: np.ndarray, seed: int, n: int = 200) -> np.ndarray:
    """Points inside `box`, piled up by a power law that depends on the seed."""
    rng = np.random.default_rng(seed)
    local = (rng.uniform(0, 1, (n, 3)) ** rng.uniform(0.3, 3, 3) - 0.5) * box[3:6] * 0.99
    cosine, sine = np.cos(box[6]), np.sin(box[6])
    return local @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]) + box[:3]


def test_unit_length_and_zeros_without_points():
    boxes = np.array([CAR, CAR + np.array([50.0, 0, 0, 0, 0, 0, 0])])
    looks = geometric_appearance(points_on(CAR, 0), boxes)
    assert looks.shape == (2, 27)
    assert np.linalg.norm(looks[0]) == pytest.approx(1.0)
    assert not looks[1].any()
    assert geometric_appearance(points_on(CAR, 0), boxes[:0]).shape == (0, 27)


def test_shares_by_hand():
    # two points at the back (first slice along l), low and high
    box = np.array([0.0, 0.0, 0.0, 4.0, 2.0, 1.6, 0.0])
    points = np.array([[-1.9, 0.1, -0.7], [-1.9, 0.1, 0.7]])
    look = geometric_appearance(points, box[None])[0]
    expected = np.zeros(27)
    expected[0] = 1.0  # length
    expected[8 + 4] = 1.0  # width: 0.05 of it to the left of the middle
    expected[16] = expected[16 + 7] = 0.5  # height
    expected[26] = 1.4 / 5.0  # extent in height
    assert look == pytest.approx(expected / np.linalg.norm(expected))


def test_the_same_car_elsewhere_looks_the_same_and_another_does_not():
    motion = np.eye(4)
    motion[:2, :2] = [[np.cos(1.1), -np.sin(1.1)], [np.sin(1.1), np.cos(1.1)]]
    motion[:3, 3] = [10.0, -4.0, 0.3]
    points = points_on(CAR, 1)
    here = geometric_appearance(points, CAR[None])[0]
    there = transform_boxes(CAR[None], motion)
    moved = geometric_appearance(points @ motion[:3, :3].T + motion[:3, 3], there)[0]
    other = geometric_appearance(points_on(CAR, 2), CAR[None])[0]
    assert here @ moved > 0.999
    assert here @ other < 0.95


def test_gallery_gives_the_least_distance_and_nan_where_there_is_none():
    gallery = Gallery(2)
    assert np.isnan(gallery.distances(np.eye(3))).all()
    gallery.add(np.zeros(3))
    assert np.isnan(gallery.distances(np.eye(3))).all()
    for vector in np.eye(3):
        gallery.add(vector)  # a budget of two: the first is forgotten
    probes = np.array([[1.0, 0, 0], [0, 0.6, 0.8], [0, 0, 0]])
    assert gallery.distances(probes)[:2] == pytest.approx([1.0, 0.2])
    assert np.isnan(gallery.distances(probes)[2])


def test_label_motion_is_found_by_label_id():
    before, after = np.zeros((3, 7)), np.zeros((2, 7))
    before[:, 0], after[:, 0] = [0.0, 10.0, 20.0], [23.0, 1.0]
    motion = LabelMotion(before, np.array([4, 5, 6]), after, np.array([6, 4]))
    found = motion.displacement(np.array([6, 5, 4, -1]))
    assert found[[0, 2]] == pytest.approx(np.array([[3.0, 0, 0], [1.0, 0, 0]]))
    assert np.isnan(found[[1, 3]]).all()
    assert motion.displacement(np.zeros(0, int)).shape == (0, 3)


def test_detections_take_the_id_of_the_label_they_overlap_most():
    labels = np.array([CAR, CAR + np.array([20.0, 0, 0, 0, 0, 0, 0])])
    detections = np.array([labels[1], labels[0], labels[0], labels[0]])
    detections[1, 2] += 0.3
    detections[3, 0] += 40.0
    assert assign_label_ids(detections, labels, np.array([7, 8])).tolist() == [8, -1, 7, -1]
    assert assign_label_ids(detections[:0], labels, np.array([7, 8])).shape == (0,)
    assert assign_label_ids(detections, labels[:0], np.zeros(0, int)).tolist() == [-1] * 4
