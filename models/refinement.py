"""The refinement module (section III.3): association features -> displacement of kept points."""

from __future__ import annotations

import keras
import tensorflow as tf

from models.config import TrackerConfig
from models.feature_propagation import FeaturePropagation, interpolation_indices
from models.layers import SharedMLP
from models.local_pointnet import Points
from models.set_abstraction import SetAbstraction, set_abstraction_indices
from models.set_upconv import SetUpconv, neighbors_within


class Refinement(keras.layers.Layer):
    """SA3, two set upconv (FP1, FP2), one feature propagation (FP3), FC1, FC2.

    Args:
        channels: of the association head's features.
        skip_channels: of the features of the tracker's SA1, the skip connection of FP2.
    """

    def __init__(self, channels: int, skip_channels: int, config: TrackerConfig, **kwargs):
        super().__init__(**kwargs)
        self.config, momentum = config, config.batch_norm_momentum
        fp1, fp2 = config.refinement_upconv
        self.sa3 = SetAbstraction(channels, config.refinement_abstraction, momentum, name="sa3")
        self.fp1 = SetUpconv(self.sa3.channels, channels, fp1, momentum, name="fp1")
        self.fp2 = SetUpconv(self.fp1.channels, skip_channels, fp2, momentum, name="fp2")
        self.fp3 = FeaturePropagation(
            self.fp2.channels, 0, config.propagation_widths, momentum, name="fp3"
        )
        self.fc1 = SharedMLP(self.fp3.channels, (config.fc1_width,), momentum, name="fc1")
        self.fc2 = keras.layers.Dense(3, name="fc2")
        self.fc2.build((None, config.fc1_width))
        self.built = True

    def call(
        self, kept_xyz: tf.Tensor, level1: Points, association: Points, training: bool
    ) -> tf.Tensor:
        """Association displacement (B, N', 3), metres, of the kept points of frame t-1.

        Args:
            kept_xyz: (B, N', 3) kept points. level1: points and features of the tracker's SA1.
            association: points of SA2 with the association head's features.
        """
        config, xyz1, xyz2 = self.config, level1.xyz, association.xyz
        indices, xyz3 = set_abstraction_indices(xyz2, config.refinement_abstraction)
        x = self.sa3(xyz2, association.features, xyz3, indices, training=training)
        fp1, fp2 = config.refinement_upconv
        index = neighbors_within(fp1.num_neighbors, fp1.radius, xyz3, xyz2)
        x = self.fp1(Points(xyz3, x), association, index, training=training)
        index = neighbors_within(fp2.num_neighbors, fp2.radius, xyz2, xyz1)
        x = self.fp2(Points(xyz2, x), level1, index, training=training)
        x = self.fp3(x, None, interpolation_indices(kept_xyz, xyz1), training=training)
        return self.fc2(self.fc1(x, training=training))
