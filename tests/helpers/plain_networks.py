"""Golden reference of both networks: gather, concatenate, multiply, normalise, pool.

Every layer is computed for every neighbour from the variables of a network, with TensorFlow's own
ops; nothing of the fast path of models/ is used.
"""

import tensorflow as tf

from models.detector import point_features
from models.feature_propagation import interpolation_indices
from models.layers import EPSILON, LinearNormReLU, SharedMLP
from models.local_pointnet import LocalPointNet
from models.set_abstraction import set_abstraction_indices
from models.set_upconv import neighbors_within


def norm_relu(y, norm, training):
    """BatchNorm and ReLU over all but the last axis."""
    if training:
        mean, variance = tf.nn.moments(y, list(range(y.shape.rank - 1)))
    else:
        mean, variance = norm.moving_mean.value, norm.moving_variance.value
    scale = norm.gamma.value / tf.sqrt(variance + EPSILON)
    return tf.nn.relu((y - mean) * scale + norm.beta.value)


def linear_norm_relu(layer: LinearNormReLU, inputs, training):
    """Linear - BatchNorm - ReLU over the concatenated inputs."""
    x = tf.concat([inputs[name] for name in layer.kernels], -1)
    kernel = tf.concat([k.value for k in layer.kernels.values()], 0)
    return norm_relu(tf.tensordot(x, kernel, 1), layer.norm, training)


def shared_mlp(mlp: SharedMLP, x, training):
    """A chain of layers."""
    for layer in mlp.layers:
        x = linear_norm_relu(layer, {"x": x}, training)
    return x


def local_pointnet(
    local: LocalPointNet, xyz, features, center_xyz, index, training, center=None, edges=None
):
    """max over neighbours j of MLP([f_j ; x_j - x_i ; q_i ; e_ij])."""
    gather = lambda values: tf.gather(values, index, batch_dims=1)  # noqa: E731
    spread = lambda values: tf.broadcast_to(  # noqa: E731
        values[:, :, None], [*index.shape, values.shape[-1]]
    )
    inputs = {"xyz": gather(xyz) - spread(center_xyz)}
    if features is not None:
        inputs["neighbors"] = gather(features)
    if center is not None:
        inputs["centers"] = spread(center)
    if edges is not None:
        inputs["edges"] = edges
    x = linear_norm_relu(local.first, inputs, training)
    return tf.reduce_max(shared_mlp(local.rest, x, training), 2)


def set_upconv(layer, xyz, features, fine_xyz, skip, index, training):
    """Pooled coarse features beside the skip connection, last layer."""
    pooled = local_pointnet(layer.local, xyz, features, fine_xyz, index, training)
    inputs = {"pooled": pooled} if skip is None else {"pooled": pooled, "skip": skip}
    return linear_norm_relu(layer.last, inputs, training)


def feature_propagation(layer, features, skip, indices, training):
    """MLP([interpolated coarse features ; skip])."""
    near = tf.gather(features, indices.neighbors, batch_dims=1)
    inputs = {"coarse": tf.reduce_sum(near * indices.weights[..., None], 2)}
    if skip is not None:
        inputs["skip"] = skip
    return shared_mlp(layer.rest, linear_norm_relu(layer.first, inputs, training), training)


def detector_head(detector, inputs, training):
    """The detector's head (B, Q, C) and FC1 (B, Q, 128) from DetectorInputs."""
    xyz, kind = inputs.level_xyz, detector.config.point_features
    features = [point_features(xyz[0], kind)]
    for i, block in enumerate(detector.set_abstraction):
        index = inputs.abstraction[i].groups
        features.append(
            local_pointnet(block.local, xyz[i], features[i], xyz[i + 1], index, training)
        )
    x = features[-1]
    for i, block in enumerate(detector.set_upconv):
        skip, index = features[-2 - i], inputs.upconv[i]
        x = set_upconv(block, xyz[-1 - i], x, xyz[-2 - i], skip, index, training)
    skip = point_features(inputs.query_xyz, kind)
    x = feature_propagation(detector.feature_propagation, x, skip, inputs.propagation, training)
    fc1 = shared_mlp(detector.fc1, x, training)
    return fc1 @ detector.fc2.kernel.value + detector.fc2.bias.value, fc1


def fused(head, previous, current, index):
    """e_ij of every pair by Table III's definition."""
    before = tf.broadcast_to(previous[:, :, None], [*index.shape, previous.shape[-1]])
    after = tf.gather(current, index, batch_dims=1)
    if head.fusion == "elementwise_product":
        return before * after
    product = tf.reduce_sum(before * after, -1, keepdims=True)
    if head.fusion == "dot_product":
        return product / previous.shape[-1]
    norms = [tf.sqrt(tf.reduce_sum(x * x, -1, keepdims=True) + 1e-8) for x in (before, after)]
    return product / (norms[0] * norms[1])


def tracker_displacement(network, previous, current, training):
    """Association displacement (B, N', 3) of TrackerInputs of frames t-1 and t."""
    config, pairs = network.config, previous.xyz.shape[0]
    xyz, features = (
        tf.concat([getattr(previous, name), getattr(current, name)], 0)
        for name in ("xyz", "features")
    )
    levels = []
    for block, layer in zip((network.sa1, network.sa2), config.set_abstraction, strict=True):
        indices, centers = set_abstraction_indices(xyz, layer)
        features = local_pointnet(block.local, xyz, features, centers, indices.groups, training)
        xyz = centers
        levels.append((xyz, features))
    (xyz1, features1), (xyz2, features2) = levels
    head, before, after = network.association, slice(0, pairs), slice(pairs, None)
    index = neighbors_within(head.num_neighbors, head.radius, xyz2[after], xyz2[before])
    edges = None
    if head.fusion != "concat":
        edges = fused(head, features2[before], features2[after], index)
    own, other = (features2[before], features2[after]) if head.has_features else (None, None)
    embedding = local_pointnet(
        head.local, xyz2[after], other, xyz2[before], index, training, own, edges
    )
    refinement, kept = network.refinement, previous.xyz
    indices, xyz3 = set_abstraction_indices(xyz2[before], config.refinement_abstraction)
    x = local_pointnet(
        refinement.sa3.local, xyz2[before], embedding, xyz3, indices.groups, training
    )
    fp1, fp2 = config.refinement_upconv
    index = neighbors_within(fp1.num_neighbors, fp1.radius, xyz3, xyz2[before])
    x = set_upconv(refinement.fp1, xyz3, x, xyz2[before], embedding, index, training)
    index = neighbors_within(fp2.num_neighbors, fp2.radius, xyz2[before], xyz1[before])
    x = set_upconv(
        refinement.fp2, xyz2[before], x, xyz1[before], features1[before], index, training
    )
    indices = interpolation_indices(kept, xyz1[before])
    x = feature_propagation(refinement.fp3, x, None, indices, training)
    x = shared_mlp(refinement.fc1, x, training)
    return x @ refinement.fc2.kernel.value + refinement.fc2.bias.value
