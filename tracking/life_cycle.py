"""Birth, hits, misses and death of tracks, shared by all trackers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tracking.frame_detections import BOX_SIZE, FrameDetections
from tracking.interface import Tracks


@dataclass
class Track:
    """One tracked object.

    Attributes:
        id: from 0 within one tracker.
        state: its motion (a Kalman filter, or box and displacement).
        score, type: of the detection matched last.
        detection: row of this frame's detections that was matched, -1 while lost.
        hits: detections matched so far, the first one included.
        hit_streak: matches in a row, up to and including the last one; birth is not a match.
        time_since_update: frames since the last match; 0 if matched in this frame.
        confirmed: True after the probation (set by the tracker).
    """

    id: int
    state: Any
    score: float
    type: str
    detection: int
    hits: int = 1
    hit_streak: int = 0
    time_since_update: int = 0
    confirmed: bool = False


class LifeCycle:
    """The tracks of one sequence, in order of birth; ids count from 0 in each instance."""

    def __init__(self) -> None:
        self.tracks: list[Track] = []
        self.frame_count = 0
        self._next_id = 0

    def begin_frame(self) -> None:
        """Starts a frame, in which no track is matched yet."""
        self.frame_count += 1
        for track in self.tracks:
            track.time_since_update += 1
            track.detection = -1

    def birth(self, state: Any, detections: FrameDetections, row: int) -> Track:
        """A new track with the next id, from row `row` of this frame's detections."""
        score, kind = float(detections.scores[row]), str(detections.types[row])
        track = Track(self._next_id, state, score, kind, int(row))
        self._next_id += 1
        self.tracks.append(track)
        return track

    def hit(self, track: Track, detections: FrameDetections, row: int) -> None:
        """Records that `track` was matched with row `row` of this frame's detections."""
        track.hit_streak = 1 if track.time_since_update > 1 else track.hit_streak + 1
        track.hits += 1
        track.time_since_update = 0
        track.score, track.type = float(detections.scores[row]), str(detections.types[row])
        track.detection = int(row)

    def drop(self, is_dead: Callable[[Track], bool]) -> None:
        """Removes the tracks for which `is_dead` holds; their ids are not reused."""
        self.tracks = [track for track in self.tracks if not is_dead(track)]

    def report(
        self, is_shown: Callable[[Track], bool], box_of: Callable[[Track], np.ndarray]
    ) -> Tracks:
        """The tracks for which `is_shown` holds, with boxes by `box_of`."""
        shown = [track for track in self.tracks if is_shown(track)]
        return Tracks(
            boxes=np.array([box_of(track) for track in shown]).reshape(-1, BOX_SIZE),
            ids=np.array([track.id for track in shown], np.int64),
            scores=np.array([track.score for track in shown], np.float64),
            types=np.array([track.type for track in shown], "<U16"),
            detections=np.array([track.detection for track in shown], np.int64),
        )
