"""The refinement module (section III.3): association features -> displacement of kept points."""

import keras
import tensorflow as tf

from models.config import TrackerConfig
from models.feature_propagation import FeaturePropagation
from models.layers import SharedMLP
from models.local_pointnet import Points
from models.set_abstraction import SetAbstraction
from models.set_upconv import SetUpconv
from models.tracker_indices import FrameIndices


class Refinement(keras.layers.Layer):
    """SA3, two set upconv (FP1, FP2), one feature propagation (FP3), FC1, FC2.

    The skip connection of FP1, the association features, is FlowNet3D's; the paper names that of
    FP2 alone.

    Args:
        channels: of the association head's features.
        skip_channels: of the features of the tracker's SA1, the skip connection of FP2.
    """

    def __init__(self, channels: int, skip_channels: int, config: TrackerConfig, **kwargs):
        super().__init__(**kwargs)
        momentum = config.batch_norm_momentum
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
        self, indices: FrameIndices, features1: tf.Tensor, association: tf.Tensor, training: bool
    ) -> tf.Tensor:
        """Association displacement (B, N', 3), metres, of the kept points of frame t-1.

        Args:
            indices: of frame t-1.
            features1: (B, 2048, 64) of the tracker's SA1. association: (B, 512, 128).
        """
        i, xyz2 = indices, indices.xyz2
        x = self.sa3(xyz2, association, i.xyz3, i.sa3, training=training)
        x = self.fp1(Points(i.xyz3, x), Points(xyz2, association), i.fp1, training=training)
        x = self.fp2(Points(xyz2, x), Points(i.xyz1, features1), i.fp2, training=training)
        x = self.fp3(x, None, i.fp3, training=training)
        return self.fc2(self.fc1(x, training=training))
