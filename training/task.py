"""The interface between the training loop and the two trainings."""

from collections.abc import Iterable
from typing import Any, Protocol

import keras
import tensorflow as tf

from models.checkpoint import Variables
from training.config import ScheduleConfig


class SampleSet(Protocol):
    """Samples as a function of (index, position), picklable (DetectorSamples, PairSamples).

    Attributes:
        items: (index of the sequence, frame) of each sample of an epoch.
        roots: the data root of each item.
    """

    items: list[tuple[int, int]]
    roots: list[str]

    def __call__(self, index: int, position: int) -> Any:
        """The sample of an item at a position of the endless order, a structure of arrays."""


class TrainingTask(Protocol):
    """A network with its samples, losses and validation (DetectorTask, TrackerTask).

    Attributes:
        kind: "detector" or "tracker".
        best_metric, best_is_largest: the validation metric that selects best.npz.
        config: the training configuration, a dataclass; `schedule` is part of it.
        model: the network that is trained.
        auxiliary: variables that training needs and the network does not, by name.
        meta: further entries of a checkpoint's meta, among them "network".
        samples, validation_samples: the samples to train on and, without augmentation, to
            validate on.
    """

    kind: str
    best_metric: str
    best_is_largest: bool
    config: Any
    schedule: ScheduleConfig
    model: keras.Model
    auxiliary: Variables
    meta: dict[str, Any]
    samples: SampleSet
    validation_samples: SampleSet

    def prepare(self, sample: Any) -> Any:
        """A batch of samples -> the input of a training step, in the input pipeline."""

    def losses(self, batch: Any, training: bool) -> dict[str, tf.Tensor]:
        """Every loss term by name and their weighted sum as "loss"; shares of the joint batch."""

    def validation_step(self, batch: Any) -> list[Any]:
        """Outputs of one validation batch, in a graph."""

    def validate(self, batches: Iterable[tuple[Any, Any, list[Any]]]) -> dict[str, float]:
        """Validation metrics over (indices, batch, output of validation_step)."""
