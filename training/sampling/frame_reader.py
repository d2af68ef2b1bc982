"""Reads labelled frames of a list of sequences with a small cache, and cuts their objects."""

from collections.abc import Iterator
from functools import lru_cache
from threading import Lock

import numpy as np

from kitti.sequence import KittiSequence
from training.sampling.frames import LabelledFrame, frame_list, read_frame
from training.sampling.object_bank import ObjectBank

KEPT = 64  # frames in memory
FRAMES_PER_ROOT = 300
"""Frames of a data root that are searched for objects to paste: bounds time and memory."""


class FrameReader:
    """Reads labelled frames of a list of sequences, keeping the last few."""

    def __init__(self, sequences: list[KittiSequence], classes: tuple[str, ...]):
        self.sequences, self.classes = sequences, classes
        self.read = lru_cache(maxsize=KEPT)(self._read)
        self._lock, self._bank = Lock(), None

    def _read(self, index: int, t: int) -> LabelledFrame:
        return read_frame(self.sequences[index], t, self.classes)

    @property
    def bank(self) -> ObjectBank:
        """Objects cut from the sequences, at the first use; the same for the same sequences."""
        with self._lock:  # the input pipeline calls from several threads
            if self._bank is None:
                self._bank = ObjectBank.of_frames(self._frames_to_cut())
            return self._bank

    def _frames_to_cut(self) -> Iterator[tuple[str, LabelledFrame]]:
        """`FRAMES_PER_ROOT` frames of each data root, evenly spread, with the root's name."""
        of_root: dict[str, list[tuple[int, int]]] = {}
        for index, t in frame_list(self.sequences):
            of_root.setdefault(str(self.sequences[index].data_root), []).append((index, t))
        for root, items in of_root.items():
            count = min(len(items), FRAMES_PER_ROOT)
            for row in np.linspace(0, len(items) - 1, count).round().astype(int):
                yield root, self._read(*items[row])
