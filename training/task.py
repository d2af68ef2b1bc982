"""The interface between the training loop and the two trainings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import keras
import tensorflow as tf

from models.checkpoint import Variables
from training.config import ScheduleConfig


class TrainingTask(Protocol):
    """A network with its samples, losses and validation (DetectorTask, TrackerTask).

    Attributes:
        kind: "detector" or "tracker".
        best_metric, best_is_largest: the validation metric that selects best.npz.
        config: the training configuration, a dataclass; `schedule` is part of it.
        model: the network that is trained.
        auxiliary: variables that training needs and the network does not, by name.
        meta: further entries of a checkpoint's meta, among them "network".
        items, validation_items: frames or pairs, one for each sample of an epoch.
        validation_roots: the data root of each validation item.
    """

    kind: str
    best_metric: str
    best_is_largest: bool
    config: Any
    schedule: ScheduleConfig
    model: keras.Model
    auxiliary: Variables
    meta: dict[str, Any]
    items: list[tuple[int, int]]
    validation_items: list[tuple[int, int]]
    validation_roots: list[str]

    def make(self, index: int, position: int) -> Any:
        """The sample of an item at a position of the endless order of samples (NumPy arrays)."""

    def make_validation(self, index: int, position: int) -> Any:
        """A validation sample without augmentation; the same each time."""

    def prepare(self, sample: Any) -> Any:
        """A batch of samples -> the input of a training step, in the input pipeline."""

    def losses(self, batch: Any, training: bool) -> dict[str, tf.Tensor]:
        """Every loss term by name and their weighted sum as "loss"; shares of the joint batch."""

    def validation_step(self, batch: Any) -> list[Any]:
        """Outputs of one validation batch, in a graph."""

    def validate(self, batches: Iterable[tuple[Any, Any, list[Any]]]) -> dict[str, float]:
        """Validation metrics over (indices, batch, output of validation_step)."""
