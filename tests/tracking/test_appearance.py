"""The gallery of appearance vectors, and label motion."""

import numpy as np
import pytest

from tracking import LabelMotion, assign_label_ids
from tracking.appearance import Gallery

CAR = np.array([5.0, 1.0, -1.0, 4.0, 1.8, 1.5, 0.4])


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
