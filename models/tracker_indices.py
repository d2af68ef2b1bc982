"""Points of every level of the tracker and the indices between them, from coordinates alone."""

from typing import NamedTuple

import tensorflow as tf

from models.config import TrackerConfig
from models.feature_propagation import InterpolationIndices, interpolation_indices
from models.set_abstraction import SetAbstractionIndices, set_abstraction_indices
from models.set_upconv import neighbors_within
from tf_ops.devices import on_cpu


class FrameIndices(NamedTuple):
    """Indices of one frame, for its encoding and for its refinement as frame t-1."""

    kept_xyz: tf.Tensor  # (B, N', 3) metres, level frame
    xyz1: tf.Tensor  # (B, 2048, 3) points of SA1
    xyz2: tf.Tensor  # (B, 512, 3) points of SA2
    xyz3: tf.Tensor  # (B, 32, 3) points of SA3
    sa1: SetAbstractionIndices
    sa2: SetAbstractionIndices
    sa3: SetAbstractionIndices
    fp1: tf.Tensor  # (B, 512, 8) int32, rows of SA3
    fp2: tf.Tensor  # (B, 2048, 8) int32, rows of SA2
    fp3: InterpolationIndices  # from the points of SA1 to the kept points

    @property
    def kept_rows(self) -> tf.Tensor:
        """(B, 512) int32: rows of the points of SA2 among the kept points."""
        return tf.gather(self.sa1.sampled, self.sa2.sampled, batch_dims=1)


@on_cpu
def frame_indices(kept_xyz: tf.Tensor, config: TrackerConfig) -> FrameIndices:
    """All indices of a frame's kept points (B, N', 3), in one block on the CPU without features."""
    sa1, xyz1 = set_abstraction_indices(kept_xyz, config.set_abstraction[0])
    sa2, xyz2 = set_abstraction_indices(xyz1, config.set_abstraction[1])
    sa3, xyz3 = set_abstraction_indices(xyz2, config.refinement_abstraction)
    fp1, fp2 = config.refinement_upconv
    return FrameIndices(
        kept_xyz,
        xyz1,
        xyz2,
        xyz3,
        sa1,
        sa2,
        sa3,
        neighbors_within(fp1.num_neighbors, fp1.radius, xyz3, xyz2),
        neighbors_within(fp2.num_neighbors, fp2.radius, xyz2, xyz1),
        interpolation_indices(kept_xyz, xyz1),
    )
