"""Configuration of the two trainings; section IV.B of the paper unless noted otherwise."""

from dataclasses import dataclass, field

from common.errors import InputError
from models.config import (
    MAX_POINTS,
    MAX_WEIGHT,
    DetectionLossWeights,
    DetectorConfig,
    TrackerConfig,
    TrackingLossWeights,
    note,
)

MIN_STEP = 1e-12
"""Least learning rate, epsilon and norm of the gradients: with 0 nothing is learned, or 0 / 0."""


@dataclass(frozen=True)
class AugmentationConfig:
    """Random changes of a training sample; both frames of a pair change alike (our choices)."""

    flip: bool = note(True, "mirror left and right, half of the time")
    rotation: float = note(0.35, "about the vertical, uniform in [-x, x] radians", 0, 3.15)
    scale: float = note(0.05, "uniform in [1 - x, 1 + x]", 0, 0.9)
    height: float = note(0.2, "of the whole scan, uniform in [-x, x] metres", 0, 100)
    dropout: float = note(
        0.3,
        "share of the points left out, uniform in [0, x]; in the frames of a pair uniform in "
        "[0, u], with one u of the pair uniform in [0, x]",
        0,
        0.95,
    )
    object_shift: float = note(
        2.0,
        "D of section IV.D: every labelled object moves by a length from [0, D] metres",
        0,
        1000,
    )
    object_shift_share: float = note(0.6, "share of the samples whose objects are shifted", 0, 1)
    pasted_objects: int = note(
        0,
        "objects of other training scans that are pasted into a sample of the detector (SECOND)",
        0,
        100,
    )
    single_scan_pairs: bool = note(
        False, "pairs from scans without an adjacent one too: halves of its points, ego motion"
    )
    hidden_vehicles: float = note(
        0.0,
        "share of the vehicles of a pair that are hidden in one of its frames, where most of their "
        "points are left out; their displacement stays the true one",
        0,
        1,
    )


@dataclass(frozen=True)
class ScheduleConfig:
    """Optimizer and length of a training."""

    epochs: int = note(16, "length of the training", 0, 10**6)
    frames_per_epoch: int = note(0, "samples in an epoch; 0: all of them", 0, 10**7)
    batch_size: int = note(
        8, "of all replicas together: 8 for the detector, 6 for the tracker", 1, 4096
    )
    learning_rate_min: float = note(1e-4, "lower bound of the cyclical learning rate", 0, 1)
    learning_rate_max: float = note(1e-3, "upper bound of the cyclical learning rate", MIN_STEP, 1)
    cycle_epochs: int = note(8, "a full cycle, up and down", 1, 10**6)
    beta1: float = note(0.9, "Adam", 0, 0.9999)
    beta2: float = note(0.999, "Adam", 0, 0.999999)
    epsilon: float = note(1e-8, "Adam", MIN_STEP, 1)
    frozen_batch_norm_from: float = note(
        0.75,
        "share of the training after which batch normalisation uses its moving averages, frozen, "
        "as at inference; the moments of a few frames are far from those of all; 1: never",
        0,
        1,
    )
    clip_norm: float = note(10.0, "largest global norm of the gradients; our choice", MIN_STEP, 1e6)
    checkpoint_minutes: float = note(5.0, "time between checkpoints within an epoch")
    keep_checkpoints: int = note(
        3, "checkpoints of the last epochs that are kept besides the best", 1
    )
    validation_frames: int = note(
        64, "samples of each data root in the validation after an epoch; 0: all"
    )
    seed: int = note(0, "of initial weights, order, sampling and augmentation", 0, 2**32 - 1)

    def __post_init__(self):
        low, high = self.learning_rate_min, self.learning_rate_max
        if low > high:
            raise InputError(
                f"learning_rate_min: expected at most learning_rate_max ({high:g}), found {low:g}"
            )


@dataclass(frozen=True)
class DetectorTrainingConfig:
    """train_det.py"""

    detector: DetectorConfig = field(default_factory=DetectorConfig)
    loss: DetectionLossWeights = field(default_factory=DetectionLossWeights)
    focal_gamma: float = note(2.0, "gamma of equation (4); the focal loss paper's value", 0, 20)
    object_balance: float = note(
        0.5, "box losses of a point weigh 1 / (points of its object)^x; 0: all points alike", 0, 4
    )
    query_points: int = note(
        0,
        "points at which mask and boxes are trained: all foreground and a random part of the "
        "background, re-weighted to the full background count; 0: all N points",
        0,
        MAX_POINTS,
    )
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)


@dataclass(frozen=True)
class TrackerTrainingConfig:
    """train_track.py"""

    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    loss: TrackingLossWeights = field(default_factory=TrackingLossWeights)
    deep_supervision: float = note(
        1.0,
        "weight of equation (5) on a linear head on the association features, in training alone; "
        "0: none",
        0,
        MAX_WEIGHT,
    )
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    schedule: ScheduleConfig = field(default_factory=lambda: ScheduleConfig(batch_size=6))
