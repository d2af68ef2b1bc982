"""Outputs of the frozen detector for training pairs, stored on disk and shared by several trackers.

Scans, augmentation and the detector's pass do not depend on the tracker. A pair has one file for
each row of Table IV, because each uses other points and features; features are kept as float16.
"""

from pathlib import Path

import numpy as np
import tensorflow as tf

from common.files import write_arrays
from common.progress import Progress
from models.config import FUSED_FEATURES
from models.detector import Detector
from models.tracker import TrackerInputs, all_fused_features
from training.config import TrackerTrainingConfig
from training.sampling.pipeline import Order, SampleErrors, dataset, micro_batches
from training.tracker_task import KeptBatch, TrackerTask, both_frames, keep


def pair_path(folder: Path, fused_features: str, number: int) -> Path:
    """The file of a pair for a row of Table IV."""
    return folder / fused_features / f"{number:06d}.npz"


def store_pairs(task: TrackerTask, order: Order, count: int, folder: Path) -> None:
    """Writes the first `count` pairs of an order, except those that are there already.

    Args:
        task: its samples, detector and tracker configuration.
        order: of the samples; `count` is rounded up to whole batches.
        folder: of the files, see `pair_path`.
    """
    size, tracker = order.batch_size, task.config.tracker
    steps = -(-count // size)
    last = (pair_path(folder, FUSED_FEATURES[-1], (step + 1) * size - 1) for step in range(steps))
    first = next((step for step, path in enumerate(last) if not path.is_file()), steps)
    if first == steps:
        return
    errors = SampleErrors()
    batches = dataset(
        errors.kept(task.samples),
        task.prepare,
        lambda: micro_batches(order, first, steps, 0, 1, 1),
        size,
    )
    choices = all_fused_features(tracker)

    @tf.function(jit_compile=False)
    def pass_detector(batch):
        outputs = task.detector(batch.inputs, training=False)
        return {name: keep(batch, outputs, choice) for name, choice in choices.items()}

    title = "pairs through the detector"
    with errors.raised(), Progress(steps * size, title, "pairs", initial=first * size) as bar:
        for step, batch in enumerate(batches, start=first):
            found = tf.nest.map_structure(lambda x: x.numpy(), pass_detector(batch))
            for name in FUSED_FEATURES:
                for i in range(size):
                    pair = tf.nest.map_structure(lambda x, i=i: x[[i, size + i]], found[name])
                    _write(pair_path(folder, name, step * size + i), pair)
            bar.update(size)


def _write(path: Path, pair: KeptBatch) -> None:
    frames = pair.frames._replace(features=pair.frames.features.astype(np.float16))
    arrays = {**frames._asdict(), "displacement": pair.displacement, "foreground": pair.foreground}
    write_arrays(path, **arrays)


class StoredPairs:
    """The stored pairs of a row of Table IV, as `training.task.SampleSet`."""

    def __init__(self, folder: Path, fused_features: str, count: int):
        self.folder, self.fused_features = folder, fused_features
        self.items = [(0, number) for number in range(count)]
        self.roots = [str(folder)] * count

    def __call__(self, index: int, position: int) -> KeptBatch:
        """Arrays (2, N', ...) of a pair, which was augmented before it was stored."""
        with np.load(pair_path(self.folder, self.fused_features, index)) as file:
            frames = TrackerInputs(file["rows"], file["xyz"], file["features"].astype(np.float32))
            return KeptBatch(frames, file["displacement"], file["foreground"])


class StoredPairsTask(TrackerTask):
    """The training of a tracker on stored pairs, without validation."""

    def __init__(self, config: TrackerTrainingConfig, detector: Detector, folder: Path, count: int):
        super().__init__(config, detector, [], [])
        self.samples = StoredPairs(folder, config.tracker.fused_features, count)

    def prepare(self, sample: KeptBatch) -> KeptBatch:
        """A batch of stored pairs; there are no indices to make."""
        return both_frames(sample)

    def detect(self, batch: KeptBatch) -> KeptBatch:
        """The batch itself, which already holds the detector's outputs."""
        return batch
