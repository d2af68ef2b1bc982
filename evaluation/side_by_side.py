"""Several trackers on the same boxes, with the time of each."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from evaluation.config import NETWORK, EvaluateConfig
from evaluation.detections import DetectionProvider
from evaluation.network_cache import CachedPredictions
from evaluation.run import evaluate
from evaluation.scene import Scene
from tracking import PREDICTED_MOTION, WITH_APPEARANCE, FrameDetections

OURS = ("pointtracknet", "pointtracknet_no_probation")
SIDE_BY_SIDE = (*OURS, "sort", "deep_sort", "deep_sort_published", "ab3dmot")
NETWORK_PARTS = ("detect", "displacement", "appearance")


class TimedDetections:
    """A detection provider that measures the time of its consumer between two frames."""

    def __init__(self, provider: DetectionProvider):
        self.provider, self.seconds, self.count = provider, 0.0, 0

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """See `DetectionProvider.frames`."""
        for detections in self.provider.frames(scene):
            start = perf_counter()
            yield detections
            self.seconds += perf_counter() - start
            self.count += 1

    @property
    def seconds_per_frame(self) -> float:
        """Mean over all frames so far."""
        return self.seconds / max(self.count, 1)


def network_seconds(cached: CachedPredictions, scenes: list[Scene]) -> dict[str, float]:
    """Mean time per frame of detector, tracker network and pooling of the appearance."""
    seconds = np.concatenate([cached.seconds(scene) for scene in scenes]).mean(axis=0)
    return dict(zip(NETWORK_PARTS, map(float, seconds), strict=True))


def evaluate_cached(
    config: EvaluateConfig, cached: CachedPredictions, tracker: str, out: Path
) -> dict[str, Any]:
    """Evaluates one tracker on cached detections: the record of `evaluate`, with times per frame.

    `seconds_per_frame` holds the network's parts that this tracker needs (the displacement is
    PointTrackNet's, the appearance DEEP_SORT's), the tracker's own time, and their sum `total`.
    """
    timed = TimedDetections(cached)
    config = replace(config, detections=NETWORK, tracker=tracker, out=out)
    record = evaluate(config, provider=timed)
    network = network_seconds(cached, config.open_scenes())
    if tracker not in PREDICTED_MOTION:
        network["displacement"] = 0.0
    if tracker not in WITH_APPEARANCE:
        network["appearance"] = 0.0
    seconds = {**network, "tracker": timed.seconds_per_frame}
    return {**record, "seconds_per_frame": {**seconds, "total": sum(seconds.values())}}
