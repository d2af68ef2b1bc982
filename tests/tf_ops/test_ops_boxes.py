"""box_iou_3d against shapely and hand-made cases, suppress_boxes against plain loops."""

import numpy as np
import pytest
import shapely
import tensorflow as tf

from tf_ops import box_iou_3d, suppress_boxes

InvalidArgument = tf.errors.InvalidArgumentError


def random_boxes(count: int, seed: int = 0, spread: float = 4.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-spread, spread, (count, 3)) * [1, 1, 0.3]
    size, yaw = rng.uniform(0.3, 5, (count, 3)), rng.uniform(-7, 7, (count, 1))
    return np.concatenate([centre, size, yaw], 1).astype(np.float32)


def corners(boxes: np.ndarray) -> np.ndarray:
    """(M, 7) -> (M, 4, 2), counter-clockwise from the front left."""
    x, y, _, length, width, _, yaw = boxes.astype(np.float64).T
    along = np.stack([np.cos(yaw), np.sin(yaw)], -1) * 0.5 * length[:, None]
    across = np.stack([-np.sin(yaw), np.cos(yaw)], -1) * 0.5 * width[:, None]
    centre = np.stack([x, y], -1)
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return np.stack([centre + a * along + b * across for a, b in signs], 1)


def reference_iou(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """3-D IoU by shapely."""
    p, q = shapely.polygons(corners(a))[:, None], shapely.polygons(corners(b))[None]
    shared = shapely.area(shapely.intersection(p, q))
    areas = shapely.area(p), shapely.area(q)
    low, high = ([x[:, 2] + s * 0.5 * x[:, 5] for x in (a, b)] for s in (-1, 1))
    tall = np.minimum.outer(high[0], high[1]) - np.maximum.outer(low[0], low[1])
    volume = shared * np.maximum(tall, 0)
    volumes = areas[0] * a[:, None, 5], areas[1] * b[None, :, 5]
    return volume / (sum(volumes) - volume)


@pytest.mark.parametrize("seed", range(3))
def test_iou_matches_shapely(seed):
    a, b = random_boxes(70, seed), random_boxes(60, seed + 10)
    expected = reference_iou(a, b)
    assert 0.2 < (expected > 0).mean() < 0.9
    np.testing.assert_allclose(box_iou_3d(a, b), expected, atol=2e-6)


def test_iou_by_hand():
    unit = [0, 0, 0, 2, 2, 2, 0]
    others = [
        unit,
        [1, 0, 0, 2, 2, 2, 0],  # half shared: 4 / 12
        [0, 0, 1, 2, 2, 2, 0],  # the same in z alone
        [2, 0, 0, 2, 2, 2, 0],  # a face in common
        [0, 0, 0, 2, 2, 2, np.pi / 2],
        [0, 0, 0, 2, 2, 2, np.pi / 4],  # an octagon: 8 (sqrt 2 - 1) of 4
        [0, 0, 0, 0, 2, 2, 0],  # empty
    ]
    octagon = 8 * (np.sqrt(2) - 1)
    diagonal = octagon / (8 - octagon)
    expected = [1, 1 / 3, 1 / 3, 0, 1, diagonal, 0]
    np.testing.assert_allclose(box_iou_3d([unit], others), [expected], atol=1e-6)
    assert box_iou_3d([others[6]], [others[6]]).numpy() == 0


def test_boxes_in_batches():
    a, b = random_boxes(12), random_boxes(10, 1)
    batched = box_iou_3d(a.reshape(2, 6, 7), b.reshape(2, 5, 7)).numpy()
    alone = np.stack([box_iou_3d(a[:6], b[:5]), box_iou_3d(a[6:], b[5:])])
    np.testing.assert_array_equal(batched, alone)


@pytest.mark.parametrize("shape", [(1, 7), (2, 7), (71, 7), (3, 20, 7)])
def test_boxes_with_themselves(shape):
    """Of one tensor each pair is computed once; of two equal ones twice."""
    boxes = tf.constant(random_boxes(int(np.prod(shape[:-1]))).reshape(shape))
    mutual = box_iou_3d(boxes, boxes).numpy()
    np.testing.assert_array_equal(mutual, np.swapaxes(mutual, -1, -2))
    np.testing.assert_allclose(mutual, box_iou_3d(boxes, tf.identity(boxes) + 0.0), atol=1e-6)


def test_empty():
    none, some = np.zeros((0, 7), np.float32), random_boxes(3)
    assert box_iou_3d(none, some).shape == (0, 3)
    assert box_iou_3d(some, none).shape == (3, 0)
    assert box_iou_3d(np.zeros((0, 2, 7)), np.zeros((0, 3, 7))).shape == (0, 2, 3)


def test_slivers_and_copies():
    """Where rounding is at its worst: boxes without width, turned by quarters, or twice there."""
    boxes = random_boxes(120)
    boxes[1::4, 4] *= 1e-7
    boxes[2::4, :6] = boxes[::4, :6]
    boxes[3::4, 6] = np.arange(30) * np.pi / 2
    boxes[3::4, :3] = np.round(boxes[3::4, :3])
    iou = box_iou_3d(boxes, boxes).numpy()
    assert np.isfinite(iou).all() and iou.min() >= 0 and iou.max() <= 1
    np.testing.assert_allclose(iou, iou.T, atol=1e-5)
    expected = reference_iou(boxes[::4], boxes[2::4])
    np.testing.assert_allclose(box_iou_3d(boxes[::4], boxes[2::4]), expected, atol=2e-6)


def test_nearly_parallel_edges():
    """Turned from a parallel position by 1 down to the least float; with edges in common."""
    still = np.float32([[3, -2, 0, 4, 2, 1, 0], [4, -2, 0, 4, 2, 1, 0], [3, -2, 0, 2, 4, 1, 0]])
    angles = 10.0 ** -np.arange(46)
    turned = np.tile(still[0], (4 * len(angles), 1))
    turned[:, 6] = np.concatenate([angles, -angles, angles + np.pi / 2, np.pi - angles])
    expected = reference_iou(still, turned)
    np.testing.assert_allclose(box_iou_3d(still, turned), expected, atol=2e-6)


def suppress_one_by_one(boxes, weight, vote_iou, nms_iou, max_boxes):
    """Reference: every box is looked at in turn."""
    tensor = tf.constant(boxes)
    iou = box_iou_3d(tensor, tensor).numpy()
    votes = np.where(iou >= np.float32(vote_iou), iou, 0.0).astype(np.float64) * weight
    support = np.cumsum(votes, -1)[:, -1]  # one after the other, as the op adds them
    owner, kept = np.full(len(boxes), -1), []
    for best in np.argsort(-support, kind="stable"):
        if owner[best] < 0 and len(kept) < max_boxes:
            owner[(owner < 0) & (iou[best] > np.float32(nms_iou))] = len(kept)
            owner[best] = len(kept)
            kept.append(best)
    return kept, owner, iou[kept]


@pytest.mark.parametrize("max_boxes", [1, 5, 300])
@pytest.mark.parametrize("vote_iou", [0.0, 0.4])
def test_suppression_equals_that_of_one_box_after_another(vote_iou, max_boxes):
    """Also for equal supports, and for empty boxes, which do not even overlap themselves."""
    boxes = random_boxes(200, spread=30.0)
    boxes[50:120] = boxes[:70]
    boxes[120:190] = boxes[0]
    boxes[7::20, 3:6] = 0
    weight = np.random.default_rng(0).integers(0, 3, len(boxes)).astype(np.float32)
    weight[50:120] = weight[:70]
    limits = {"vote_iou": vote_iou, "nms_iou": 0.02, "max_boxes": max_boxes}
    kept, owner, iou = suppress_boxes(boxes, weight, **limits)
    expected = suppress_one_by_one(boxes, weight, **limits)
    np.testing.assert_array_equal(kept, expected[0])
    np.testing.assert_array_equal(owner, expected[1])
    np.testing.assert_allclose(iou, expected[2], atol=1e-6)
    assert max_boxes < 300 or np.count_nonzero(owner.numpy() == owner.numpy()[7]) == 1


def test_suppression_of_nothing():
    none = np.zeros((0, 7), np.float32)
    kept, owner, iou = suppress_boxes(none, none[:, 0], vote_iou=0.4, nms_iou=0.02, max_boxes=3)
    assert (kept.shape, owner.shape, iou.shape) == ((0,), (0,), (0, 0))


def test_suppression_in_a_graph():
    """The shape function, with an unknown number of boxes."""
    shapes = []

    @tf.function(input_signature=[tf.TensorSpec([None, 7]), tf.TensorSpec([None])])
    def run(boxes, weight):
        found = suppress_boxes(boxes, weight, vote_iou=0.4, nms_iou=0.02, max_boxes=3)
        shapes.extend(x.shape.as_list() for x in found)
        return found

    kept, owner, iou = run(random_boxes(9, spread=30.0), np.ones(9, np.float32))
    assert shapes == [[None], [None], [None, None]]
    assert (len(kept), owner.shape, iou.shape) == (3, (9,), (3, 9))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_not_finite(bad):
    boxes, broken = random_boxes(3), random_boxes(3)
    broken[1, 6] = bad
    for call in (
        lambda: box_iou_3d(boxes, broken),
        lambda: box_iou_3d(broken, boxes),
    ):
        with pytest.raises(InvalidArgument, match=r"\[1, 6\] is -?(nan|inf)"):
            call()


def test_other_errors():
    boxes, negative = random_boxes(3), random_boxes(3)
    negative[2, 4] = -1
    with pytest.raises(InvalidArgument, match="boxes1: box 2 has the negative size -1"):
        box_iou_3d(negative, boxes)
    with pytest.raises(InvalidArgument, match=r"\(M, 7\) or \(B, M, 7\), received \[3,6\]"):
        box_iou_3d(boxes, boxes[:, :6])


def test_suppression_errors():
    boxes, ones, negative = random_boxes(3), np.ones(3, np.float32), random_boxes(3)
    limits = {"vote_iou": 0.4, "nms_iou": 0.02, "max_boxes": 3}
    negative[1, 3] = -1
    with pytest.raises(InvalidArgument, match=r"received \[3,7\] and \[2\]"):
        suppress_boxes(boxes, ones[:2], **limits)
    with pytest.raises(InvalidArgument, match="boxes: box 1 has the negative size -1"):
        suppress_boxes(negative, ones, **limits)
    with pytest.raises(InvalidArgument, match=r"weight\[0\] is -?nan"):
        suppress_boxes(boxes, ones * np.nan, **limits)
    for name in ("vote_iou", "nms_iou"):
        for bad in (np.nan, np.inf):
            with pytest.raises(InvalidArgument, match="vote_iou and nms_iou must be finite"):
                suppress_boxes(boxes, ones, **{**limits, name: bad})
