"""Several trackers on the very same boxes, with the time each of them takes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from evaluation.config import NETWORK, EvaluateConfig
from evaluation.recording import RecordedNetwork
from evaluation.run import evaluate
from evaluation.scene import Scene
from evaluation.sources import BoxSource, Detected
from kitti.object_shift import ObjectShift
from kitti.sequence import open_sequences

SIDE_BY_SIDE = ("pointtracknet", "sort", "deep_sort", "ab3dmot")


class TimedSource:
    """A box source that measures how long its reader takes between two frames."""

    def __init__(self, source: BoxSource):
        self.source, self.seconds, self.count = source, 0.0, 0

    def frames(self, scene: Scene) -> Iterator[Detected]:
        """See `BoxSource.frames`."""
        for detected in self.source.frames(scene):
            start = perf_counter()
            yield detected
            self.seconds += perf_counter() - start
            self.count += 1

    @property
    def seconds_per_frame(self) -> float:
        """Mean over all frames so far."""
        return self.seconds / max(self.count, 1)


def displaced_scenes(config: EvaluateConfig) -> list[Scene]:
    """The scenes of a configuration under its displacement."""
    model = None
    if config.displacement:
        model = ObjectShift(distance=config.displacement, seed=config.seed)
    sequences = open_sequences(config.data_root, config.seqs, config.subset)
    return [Scene(sequence, model) for sequence in sequences]


def network_seconds(recorded: RecordedNetwork, scenes: list[Scene]) -> dict[str, float]:
    """Mean time per frame of the detector's pass and of the tracker's."""
    detect, displace = np.concatenate([recorded.seconds(scene) for scene in scenes]).mean(axis=0)
    return {"detect": float(detect), "displacement": float(displace)}


def evaluate_recorded(
    config: EvaluateConfig, recorded: RecordedNetwork, tracker: str, out: Path
) -> dict[str, Any]:
    """One tracker on recorded boxes: what `evaluate` returns and writes to `out`, and its times.

    `seconds_per_frame` holds the network's passes that this tracker needs (the baselines need no
    displacement), the tracker's own time, and their sum `total`.
    """
    timed = TimedSource(recorded)
    config = replace(config, detections=NETWORK, tracker=tracker, out=out)
    record = evaluate(config, source=timed)
    network = network_seconds(recorded, displaced_scenes(config))
    if tracker != "pointtracknet":
        network["displacement"] = 0.0
    seconds = {**network, "tracker": timed.seconds_per_frame}
    return {**record, "seconds_per_frame": {**seconds, "total": sum(seconds.values())}}
