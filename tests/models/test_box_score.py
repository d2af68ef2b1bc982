"""Features of clusters, the scorer, and its file."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.special import expit, logit

from common.errors import InputError
from models.boxes.box_decoding import Proposals, cluster
from models.boxes.box_score import FILE_NAME, BoxScorer, default_min_score, load_scorer, save_scorer
from models.boxes.cluster_features import FC1, VIEW, _view, cluster_features
from models.config import DecodingConfig

CARS = np.float32(
    [[10, 0, 0, 4, 2, 1.6, 0], [30, 5, 0, 4, 2, 1.6, 0.5], [30, 7.4, 0, 4, 2, 1.6, 0.5]]
)
SCORER = BoxScorer("abc", 0.4, 0.5, ("votes", "range"), (2.0, 0.3), (1.0, 0.2), (1.5, -0.5))


def proposals(counts=(30, 12, 3), quality=False) -> Proposals:
    """Some proposals for each of three cars, the third beside the second."""
    rng = np.random.default_rng(0)
    owner = np.repeat(np.arange(3), counts)
    boxes = CARS[owner] + rng.normal(0, 0.02, (len(owner), 7)).astype("f4")
    likely = rng.uniform(0.5, 1, len(owner)).astype("f4")
    fc1 = np.eye(3, dtype="f4")[owner] * np.arange(1, len(owner) + 1, dtype="f4")[:, None]
    classes = np.tile(np.float32([0.7, 0.3]), (len(owner), 1))
    return Proposals(boxes, likely, classes, fc1, likely / 2 if quality else None)


def features(**kwargs):
    rng = np.random.default_rng(1)
    clusters = cluster(proposals(**kwargs), DecodingConfig())
    inside = CARS[0, :3] + rng.uniform(-0.5, 0.5, (50, 3))
    outside = rng.uniform((5, -30, -2), (60, 30, -1.5), (500, 3))
    points = np.concatenate([inside, outside]).astype("f4")
    return clusters, cluster_features(clusters, points, np.repeat([0.9, 0.1], (50, 500)))


def test_features_describe_the_cluster():
    clusters, found = features()
    assert all(values.shape == (3,) and np.isfinite(values).all() for values in found.values())
    np.testing.assert_allclose(np.expm1(found["votes"]), [30, 12, 3])
    np.testing.assert_allclose(np.expm1(found["points"]), [50, 0, 0])
    assert found["foreground inside"][0] == pytest.approx(0.9)
    np.testing.assert_allclose(found["range"] * 50, np.hypot(*clusters.boxes[:, :2].T), rtol=1e-5)
    assert found["near a better one"][0] == 0  # none is better than the best
    assert found["near a better one"][2] > 0.25 > found["near a better one"][1]
    assert found["much better one"][2] > 0
    assert found["truncation"].max() == 0
    np.testing.assert_allclose(found["class"], 0.7, rtol=1e-5)


def test_features_equal_those_by_the_plain_formulas():
    """Pooling column by column over a (K, P) mask; quantiles of all azimuths."""
    clusters, found = features(quality=True)
    voters, given = clusters.votes > 0, clusters.proposals
    columns = {f"{FC1} {i}": values for i, values in enumerate(given.features.T)}
    for name, values in (columns | {"quality": given.quality}).items():
        np.testing.assert_allclose(found[f"{name} mean"], voters @ values / voters.sum(-1), 1e-6)
        maximum = np.where(voters, values, -np.inf).max(-1)
        np.testing.assert_array_equal(found[f"{name} maximum"], maximum)
    np.testing.assert_allclose(found["agreement"], logit(clusters.agreement.clip(0.01, 0.99)), 1e-5)


@pytest.mark.parametrize("count", [1, 2, 500, 15000])
def test_the_view_is_bounded_by_quantiles_of_the_azimuths(count):
    points = np.random.default_rng(count).uniform((-3, -30, -2), (60, 30, 1), (count, 3))
    points = points.astype(np.float32)
    azimuth = np.arctan2(points[:, 1], np.maximum(points[:, 0], 0.1)).astype(np.float64)
    np.testing.assert_allclose(_view(points), np.quantile(azimuth, VIEW), atol=1e-6)


def test_scores_of_extreme_logits_are_finite():
    with np.errstate(all="raise"):
        found = SCORER.scores({"votes": np.array([-1e6, 2, 1e6]), "range": np.full(3, 0.3)})
    np.testing.assert_allclose(found, expit([-1.5e6, 0.5, 1.5e6]), atol=1e-300)


def test_features_of_fc1_are_pooled_over_the_voters():
    _, found = features()
    assert found[f"{FC1} 0 mean"].tolist() == pytest.approx([15.5, 0, 0])
    assert found[f"{FC1} 1 maximum"].tolist() == pytest.approx([0, 42, 0])


def test_predicted_quality_is_a_feature_where_there_is_one():
    assert "quality mean" not in features()[1]
    found = features(quality=True)[1]
    np.testing.assert_allclose(found["quality maximum"], found["probability maximum"] / 2)


def test_a_box_over_the_edge_of_the_view_is_truncated():
    edge = Proposals(np.tile(CARS[:1], (5, 1)), np.ones(5, "f4"), np.ones((5, 1), "f4"))
    points = np.random.default_rng(0).uniform((9, 0, -1), (11, 8, 1), (1000, 3))
    found = cluster_features(cluster(edge, DecodingConfig()), points, np.ones(1000))
    assert 0.4 < found["truncation"][0] < 0.6


def test_scores_are_probabilities_of_the_named_features():
    given = {"range": np.array([0.3, 0.5]), "votes": np.array([2.0, 4.0]), "other": np.zeros(2)}
    expected = expit([0.5, 0.5 + 1.5 * 2 - 0.5])
    np.testing.assert_allclose(SCORER.scores(given), expected)


def test_a_feature_that_the_detector_lacks_is_named():
    with pytest.raises(InputError, match=r"scorer\.json: unknown feature 'range'"):
        SCORER.scores({"votes": np.array([2.0])})


def test_a_file_that_cannot_be_read_is_not_passed_over(tmp_path):
    (tmp_path / FILE_NAME).symlink_to(FILE_NAME)
    for read in (default_min_score, lambda folder: load_scorer(folder, "abc")):
        with pytest.raises(InputError, match="Too many levels of symbolic links"):
            read(tmp_path)


def test_a_scorer_is_stored_beside_its_detector(tmp_path):
    save_scorer(tmp_path, SCORER)
    assert load_scorer(tmp_path, "abc") == SCORER
    with pytest.raises(InputError, match="fitted for another detector"):
        load_scorer(tmp_path, "abd")


def test_a_scorer_with_two_features_for_each_channel_is_stored(tmp_path):
    names, numbers = tuple(f"FC1 {i} mean" for i in range(300)), (0.5,) * 300
    many = BoxScorer("abc", 0.4, 0.0, names, numbers, numbers, numbers)
    save_scorer(tmp_path, many)
    assert load_scorer(tmp_path, "abc") == many


def test_a_missing_scorer_is_noted_in_one_line(tmp_path, capsys):
    assert load_scorer(tmp_path, "abc") is None
    assert capsys.readouterr().err.endswith("not found, boxes are scored by agreement\n")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 2}, "expected scorer format 1, found 2"),
        ({"mean": [1.0]}, "expected 2 means, scales and weights"),
        ({"scale": [1.0, 0.0]}, "positive scales"),
        ({"scale": [1.0, 1e-300]}, "positive scales of at least 1e-09"),
        ({"min_score": 1.5}, "min_score: expected within"),
        ({"bias": "high"}, "bias"),
        ({"weight": None}, "weight"),
        ({"extra": 1}, "extra"),
    ],
)
def test_bad_files_are_refused(tmp_path, change, message):
    values = {**dataclasses.asdict(SCORER), **change}
    (tmp_path / FILE_NAME).write_text(json.dumps(values))
    with pytest.raises(InputError, match=message):
        load_scorer(tmp_path, "abc")
