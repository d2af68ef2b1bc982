"""Layers against the plain way of computing them: gather first, concatenate, then multiply."""

from contextlib import nullcontext

import numpy as np
import pytest
import tensorflow as tf
from helpers.network_cases import cloud, randomize_norms
from helpers.plain_networks import linear_norm_relu, local_pointnet

from models.association_head import fuse
from models.config import SetAbstractionConfig, SetUpconvConfig
from models.feature_propagation import FeaturePropagation, interpolation_indices
from models.layers import BatchNormReLU, LinearNormReLU, SharedMLP, fold_batch_norm, linear
from models.local_pointnet import LocalPointNet, Points
from models.probability_filter import foreground_probability, probability_filter
from models.set_abstraction import set_abstraction_indices
from models.set_upconv import SetUpconv, neighbors_within
from tf_ops.devices import without_fused_ops


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-4)


@pytest.mark.parametrize("training", [False, True])
@pytest.mark.parametrize("widths", [(16,), (8, 16), (8, 16, 24)])
@pytest.mark.parametrize("parts", ["xyz", "features", "all"])
def test_first_layer_before_grouping_is_exact(training, widths, parts):
    xyz, queries = cloud(2, 50), cloud(2, 20, seed=1)
    rng = np.random.default_rng(2)
    neighbors = tf.constant(rng.integers(0, 50, (2, 20, 6)), tf.int32)
    features = None if parts == "xyz" else rng.normal(size=(2, 50, 5)).astype("f4")
    query = rng.normal(size=(2, 20, 4)).astype("f4") if parts == "all" else None
    pair = rng.normal(size=(2, 20, 6, 2)).astype("f4") if parts == "all" else None
    mlp = LocalPointNet(
        0 if features is None else 5,
        widths,
        0.9,
        1.0,
        0 if query is None else 4,
        0 if pair is None else 2,
    )
    randomize_norms(mlp)
    expected = local_pointnet(mlp, xyz, features, queries, neighbors, training, query, pair)
    call = lambda: mlp(  # noqa: E731
        Points(xyz, features), Points(queries, query), neighbors, training=training, edges=pair
    )
    close(call(), expected)
    if not training:
        fold_batch_norm(mlp)
        close(call(), expected)


def test_gradients_of_the_rearranged_layer_are_exact():
    xyz, queries = cloud(2, 40), cloud(2, 10, seed=1)
    rng = np.random.default_rng(2)
    neighbors = tf.constant(rng.integers(0, 40, (2, 10, 6)), tf.int32)
    features = tf.constant(rng.normal(size=(2, 40, 5)), tf.float32)
    weight = tf.constant(rng.normal(size=(2, 10, 16)), tf.float32)
    mlp = LocalPointNet(5, (8, 16), 0.9, 1.0)
    randomize_norms(mlp)
    gradients = []
    for compute in (
        lambda: mlp(Points(xyz, features), Points(queries), neighbors, training=True),
        lambda: local_pointnet(mlp, xyz, features, queries, neighbors, True),
    ):
        with tf.GradientTape() as tape:
            tape.watch(features)
            loss = tf.reduce_sum(compute() * weight)
        gradients.append(tape.gradient(loss, [features, *mlp.trainable_variables]))
    for found, expected in zip(*gradients, strict=True):
        close(found, expected)


@pytest.mark.parametrize("training", [False, True])
def test_interpolation_after_the_first_layer_is_exact(training):
    fine, coarse = cloud(2, 30), cloud(2, 9, seed=1)
    rng = np.random.default_rng(2)
    features = rng.normal(size=(2, 9, 5)).astype("f4")
    skip = rng.normal(size=(2, 30, 3)).astype("f4")
    layer = FeaturePropagation(5, 3, (8, 12), 0.9)
    randomize_norms(layer)
    indices = interpolation_indices(fine, coarse)
    np.testing.assert_allclose(tf.reduce_sum(indices.weights, -1), 1.0, rtol=1e-5)
    gathered = tf.gather(features, indices.neighbors, batch_dims=1)
    interpolated = tf.reduce_sum(gathered * indices.weights[..., None], 2)
    x = linear_norm_relu(layer.first, {"coarse": interpolated, "skip": skip}, training)
    for rest in layer.rest.layers:
        x = linear_norm_relu(rest, {"x": x}, training)
    close(layer(features, skip, indices, training=training), x)


def test_interpolation_at_a_coarse_point_is_its_feature():
    coarse = cloud(1, 9)
    indices = interpolation_indices(coarse, coarse)
    assert np.all(indices.weights[..., 0] > 0.999)
    np.testing.assert_array_equal(indices.neighbors[0, :, 0], np.arange(9))


def test_moving_averages_move_towards_the_batch():
    layer = LinearNormReLU({"x": 3}, 4, momentum=0.75)
    x = cloud(1, 100)[0]
    layer({"x": x}, training=True)
    y = x @ layer.kernels["x"].numpy()
    np.testing.assert_allclose(layer.norm.moving_mean, 0.25 * y.mean(0), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(layer.norm.moving_variance, 0.75 + 0.25 * y.var(0), rtol=1e-4)


def test_set_abstraction_groups_within_the_radius():
    xyz = cloud(2, 200)
    config = SetAbstractionConfig(32, 1.0, (8,), 8)
    indices, centers = set_abstraction_indices(xyz, config)
    grouped = tf.gather(xyz, indices.groups, batch_dims=1)
    distance = tf.norm(grouped - centers[:, :, None], axis=-1)
    assert float(tf.reduce_max(distance)) < 1.0
    np.testing.assert_array_equal(centers, tf.gather(xyz, indices.sampled, batch_dims=1))


def test_neighbors_beyond_the_radius_give_way_to_the_nearest():
    coarse = np.array([[[0, 0, 0], [1, 0, 0], [50, 0, 0]]], "f4")
    fine = np.array([[[0.1, 0, 0]]], "f4")
    found = neighbors_within(3, 2.0, coarse, fine)
    np.testing.assert_array_equal(found, [[[0, 1, 0]]])


def test_set_upconv_with_and_without_skip():
    coarse, fine = cloud(1, 5), cloud(1, 20, seed=1)
    features = np.ones((1, 5, 4), "f4")
    neighbors = neighbors_within(3, 8.0, coarse, fine)
    for channels in (0, 6):
        layer = SetUpconv(4, channels, SetUpconvConfig(8.0, (8, 8, 16), 3), 0.9)
        skip = np.ones((1, 20, 6), "f4") if channels else None
        found = layer(Points(coarse, features), Points(fine, skip), neighbors, training=False)
        assert found.shape == (1, 20, 16)


@pytest.mark.parametrize("fusion", ["cosine_distance", "dot_product", "elementwise_product"])
def test_fused_value_of_each_pair(fusion):
    rng = np.random.default_rng(2)
    previous = rng.normal(size=(2, 5, 4)).astype(np.float32)
    current = rng.normal(size=(2, 7, 4)).astype(np.float32)
    previous[0, 0] = 0.0  # a point that all its channels' ReLU cut off
    neighbors = rng.integers(0, 7, (2, 5, 3)).astype(np.int32)
    found = fuse(fusion, *map(tf.constant, (previous, current, neighbors))).numpy()
    for b, i, k in np.ndindex(2, 5, 3):
        one, other = previous[b, i], current[b, neighbors[b, i, k]]
        sizes = max(np.linalg.norm(one) * np.linalg.norm(other), 1e-8)
        expected = {
            "cosine_distance": [one @ other / sizes],
            "dot_product": [one @ other / 4],
            "elementwise_product": one * other,
        }[fusion]
        np.testing.assert_allclose(found[b, i, k], expected, rtol=1e-4, atol=1e-6)


def test_shared_mlp_keeps_leading_axes():
    mlp = SharedMLP(3, (8, 4), 0.9)
    assert mlp(tf.zeros([2, 5, 7, 3]), training=True).shape == (2, 5, 7, 4)


def test_probability_filter_keeps_the_most_probable_first():
    margin = np.array([[0.1, 3.0, -2.0, 1.0]], "f4")
    logits = np.stack([np.zeros_like(margin), margin], -1)
    rows = probability_filter(tf.constant(logits), 3)
    np.testing.assert_array_equal(rows, [[1, 3, 0]])
    np.testing.assert_allclose(foreground_probability(logits), 1 / (1 + np.exp(-margin)), rtol=1e-5)


def test_probability_filter_repeats_where_there_are_too_few_points():
    rows = probability_filter(tf.constant([[[0.0, 1.0], [0.0, 2.0]]]), 5)
    np.testing.assert_array_equal(rows, [[1, 0, 1, 0, 1]])


def test_each_part_of_a_fresh_layer_has_an_equal_share():
    tf.keras.utils.set_random_seed(0)
    layer = LinearNormReLU({"many": 128, "few": 3}, 256, 0.9, sizes={"few": 0.25})
    rng = np.random.default_rng(0)
    many = rng.normal(0, 0.5**0.5, (2000, 128)).astype("f4")
    few = rng.normal(0, 0.25, (2000, 3)).astype("f4")
    shares = [
        np.std(linear(tf.constant(x), layer.kernels[part].value))
        for part, x in (("many", many), ("few", few))
    ]
    assert shares[0] == pytest.approx(shares[1], rel=0.1)


@pytest.mark.parametrize("fused", [True, False])
def test_variance_where_the_mean_is_large(fused):
    """Mean 3000, standard deviation 1: E[x^2] - E[x]^2 in float32 has no digit left."""
    rng = np.random.default_rng(0)
    x = (3000.0 + rng.normal(size=(4000, 8))).astype(np.float32)
    norm = BatchNormReLU(8, momentum=0.0)
    with nullcontext() if fused else without_fused_ops():
        y = norm(tf.constant(x))
    exact = x.astype(np.float64)
    np.testing.assert_allclose(norm.moving_mean, exact.mean(0), rtol=1e-6)
    np.testing.assert_allclose(norm.moving_variance, exact.var(0), rtol=2e-3)
    expected = (exact - exact.mean(0)) / np.sqrt(exact.var(0) + 1e-3)
    np.testing.assert_allclose(y, np.maximum(expected, 0), atol=2e-3)
