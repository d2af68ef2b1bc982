"""The samples of a training as picklable functions of (index, position)."""

from functools import cached_property
from typing import Any

import numpy as np

from kitti.sequence import KittiSequence
from models.config import DetectorConfig
from training.config import AugmentationConfig, DetectorTrainingConfig, TrackerTrainingConfig
from training.sampling.frame_reader import FrameReader
from training.sampling.frames import LabelledFrame, frame_list, pair_list
from training.sampling.object_bank import ObjectBank
from training.sampling.samples import DetectorSample, PairSample, detector_sample, pair_sample
from training.sampling.single_scan import split_scan


class FrameItems:
    """(index of the sequence, frame) of each sample, and the labelled frames.

    Attributes:
        items: one for each sample of an epoch.
        roots: the data root of each item.
    """

    def __init__(
        self, sequences: list[KittiSequence], classes: tuple[str, ...], items: list[tuple[int, int]]
    ):
        self.sequences, self.classes, self.items = sequences, classes, items
        self.roots = [str(sequences[i].data_root) for i, _ in items]

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the reader with its cache."""
        return {key: value for key, value in vars(self).items() if key != "reader"}

    @cached_property
    def reader(self) -> FrameReader:
        """Frames of the sequences, the last few in memory."""
        return FrameReader(self.sequences, self.classes)

    def frame(self, index: int) -> LabelledFrame:
        """The labelled frame of an item."""
        return self.reader.read(*self.items[index])


class DetectorSamples(FrameItems):
    """A DetectorSample of every frame with a scan."""

    def __init__(
        self,
        sequences: list[KittiSequence],
        config: DetectorTrainingConfig,
        augmentation: AugmentationConfig,
    ):
        super().__init__(sequences, config.detector.box.classes, frame_list(sequences))
        self.num_points = config.detector.num_points
        self.config, self.augmentation = config, augmentation

    @cached_property
    def bank(self) -> ObjectBank | None:
        """The objects to paste, cut from the sequences at the first use."""
        return self.reader.bank if self.augmentation.pasted_objects else None

    def __getstate__(self) -> dict[str, Any]:
        """With the objects to paste: they are cut once, not in each worker."""
        return {**super().__getstate__(), "bank": self.bank}

    def __call__(self, index: int, position: int) -> DetectorSample:
        """The sample of an item at a position of the endless order; fixed by seed and position."""
        rng = np.random.default_rng([self.config.schedule.seed, position])
        return detector_sample(self.frame(index), self.config, self.augmentation, rng, self.bank)


class PairSamples(FrameItems):
    """A PairSample of every two adjacent scans (t-1, t), and of single scans where configured."""

    def __init__(
        self,
        sequences: list[KittiSequence],
        config: TrackerTrainingConfig,
        detector: DetectorConfig,
        augmentation: AugmentationConfig,
    ):
        items = pair_list(sequences, augmentation.single_scan_pairs)
        super().__init__(sequences, detector.box.classes, items)
        self.seed, self.num_points = config.schedule.seed, detector.num_points
        self.augmentation = augmentation

    def __call__(self, index: int, position: int) -> PairSample:
        """The sample, see `DetectorSamples`; without a scan t-1 made from scan t (`split_scan`)."""
        rng = np.random.default_rng([self.seed, position])
        sequence, t = self.items[index]
        current = self.frame(index)
        there = self.sequences[sequence]
        if t - 1 in there.frames and there.has_scan(t - 1):
            previous = self.reader.read(sequence, t - 1)
        else:
            previous, current = split_scan(current, rng)
        return pair_sample(previous, current, self.num_points, self.augmentation, rng)
