"""Small configurations and clouds that the network tests share."""

import dataclasses

import numpy as np

from models.config import DetectorConfig, SetAbstractionConfig, SetUpconvConfig, TrackerConfig

SMALL_DETECTOR = DetectorConfig(
    num_points=128,
    set_abstraction=(
        SetAbstractionConfig(64, 1.0, (8, 16), 8),
        SetAbstractionConfig(32, 2.0, (16, 16), 8),
        SetAbstractionConfig(16, 4.0, (16, 32), 8),
        SetAbstractionConfig(8, 8.0, (32, 32), 8),
    ),
    set_upconv=(
        SetUpconvConfig(8.0, (32, 32), 4),
        SetUpconvConfig(4.0, (16, 32), 4),
        SetUpconvConfig(2.0, (16, 32), 4),
    ),
    propagation_widths=(32, 32),
    fc1_width=16,
)
SMALL_TRACKER = TrackerConfig(
    num_kept_points=48,
    set_abstraction=(
        SetAbstractionConfig(32, 0.5, (8, 16), 8),
        SetAbstractionConfig(16, 1.0, (16, 16), 8),
    ),
    association_neighbors=8,
    association_widths=(16, 16),
    refinement_abstraction=SetAbstractionConfig(4, 4.0, (16, 16), 8),
    refinement_upconv=(SetUpconvConfig(4.0, (16, 16), 4), SetUpconvConfig(1.0, (16, 16), 4)),
    propagation_widths=(16, 16),
    fc1_width=16,
)


def cloud(batch: int, count: int, seed: int = 0, extent: float = 6.0) -> np.ndarray:
    """(batch, count, 3) float32 points, uniform in a box, metres."""
    rng = np.random.default_rng(seed)
    return rng.uniform([0, -extent, -1], [2 * extent, extent, 1], (batch, count, 3)).astype("f4")


def tracker_with(**changes) -> TrackerConfig:
    """SMALL_TRACKER with other fields."""
    return dataclasses.replace(SMALL_TRACKER, **changes)


def randomize_norms(model, seed: int = 0) -> None:
    """Gives every BatchNorm other statistics than 0 and 1, as after training."""
    rng = np.random.default_rng(seed)
    for variable in model.weights:
        shape = variable.shape
        if variable.name in ("moving_mean", "beta"):
            variable.assign(rng.normal(0, 0.3, shape))
        elif variable.name in ("moving_variance", "gamma"):
            variable.assign(rng.uniform(0.5, 1.5, shape))
