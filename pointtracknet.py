"""PointTrackNet as a library: scans in, tracks out, one call per scan.

tracker = Tracker.load()
for frame, path in find_scans("scans").items():
    tracks = tracker.update(read_scan(path))
    print(frame, tracks.ids, tracks.boxes)
"""

import math
from pathlib import Path

import numpy as np

from common.errors import InputError
from common.notes import note
from evaluation.detections import NetworkStream
from kitti.calibration import Calibration, read_calibration, standard_mounting
from kitti.camera_view import image_size_of, in_camera_view
from kitti.scans.point_arrays import as_points
from models.inference import StreamingNetwork
from models.weights import load_networks
from tracking import Tracks, make_tracker, track_frame

__all__ = ["Tracker", "Tracks"]


def default_weights() -> Path:
    """`weights` of the working directory if detector.npz is in it, else those beside this file."""
    here = Path("weights")
    shipped = Path(__file__).resolve().parent / "weights"
    return here if (here / "detector.npz").is_file() else shipped


class Tracker:
    """Detector, tracker network and Algorithm 1 on one stream of scans.

    Args:
        network: both networks.
        calib: mounting of the scanner and view of the camera, or the path of their file; by default
            `kitti.calibration.standard_mounting`. The networks take the points in the
            camera's view, as in training.
        image_size: width and height of the camera's image in pixels, where the calibration does
            not define it (see `kitti.camera_view.image_size_of`).
        parameters: fields of `tracking.association_to_trajectory.AssociationParameters`.
    """

    def __init__(
        self,
        network: StreamingNetwork,
        calib: Calibration | str | Path | None = None,
        image_size: tuple[int, int] | None = None,
        **parameters: float,
    ):
        calib = standard_mounting() if calib is None else calib
        self.calib = calib if isinstance(calib, Calibration) else read_calibration(calib)
        self.image_size = image_size_of(self.calib, image_size)
        self._network, self._parameters = network, parameters
        self.reset()

    @classmethod
    def load(
        cls,
        weights: str | Path | None = None,
        calib: Calibration | str | Path | None = None,
        image_size: tuple[int, int] | None = None,
        score_threshold: float | None = None,
        **parameters: float,
    ) -> "Tracker":
        """Loads the networks of a folder that holds detector.npz, tracker.npz and scorer.json.

        Args:
            weights: the folder; None for that of `default_weights`.
            score_threshold: least score of a box; None for that of the weights.

        Raises:
            InputError: weights are missing, broken or do not belong together; the threshold is no
                finite number, or the image size none.
        """
        if score_threshold is not None and not -math.inf < score_threshold <= 1:
            found = f"found {score_threshold}"
            raise InputError(f"score_threshold: expected a finite number, at most 1, {found}")
        folder = default_weights() if weights is None else weights
        network = StreamingNetwork(*load_networks(folder), min_score=score_threshold)
        return cls(network, calib, image_size, **parameters)

    def reset(self) -> None:
        """Forgets all scans and tracks: the next scan is the first of another sequence."""
        self.dropped = 0  # points of the last scan, see `update`
        self.unseen = 0  # scans so far that have points, but none in the camera's view
        self.frame = 0  # number of the next scan
        self._stream = NetworkStream(self._network)
        self._tracker = make_tracker("pointtracknet", **self._parameters)

    @property
    def score_threshold(self) -> float:
        """Least score of a box."""
        return self._network.min_score

    @property
    def seen(self) -> np.ndarray:
        """(N, 4) float32: the detector's input points of the last scan, level frame, metres, and
        their foreground probability; no rows before the first scan."""
        state = self._stream.state
        if state is None:
            return np.zeros((0, 4), np.float32)
        return np.column_stack([state.sampled, state.probability])

    def points_level(self, scan: np.ndarray) -> np.ndarray:
        """(n, >=3) scan, Velodyne frame, metres -> (m, 3) float32 level frame, camera crop."""
        points = self.calib.velo_to_level(scan[:, :3])
        return points[in_camera_view(points, self.calib, self.image_size)].astype(np.float32)

    def update(self, points: np.ndarray) -> Tracks:
        """Takes the next scan and returns its tracks.

        Args:
            points: (n, >=3), Velodyne frame (x ahead, y left, z up), metres; n may be 0 for a
                frame without a scan. Organised clouds (H, W, >=3) and structured arrays with
                fields x, y, z are accepted too. Points without a return (NaN, infinity, beyond 1000
                m) are dropped; `dropped` is their number.

        Returns:
            Tracks: boxes (T, 7) in the level frame, ids, scores, types. A vehicle is reported from
            its third detection on (in the first three scans at once); from its first with
            `Tracker.load(min_hits=1)`.

        Raises:
            InputError: another shape or type, or no finite point at all; the scan is then skipped,
                and the next one is tracked as the successor of the last valid one.
        """
        self.dropped = 0
        points, self.dropped = as_points(points)
        level = self.points_level(points)
        if len(points) and not len(level):
            self._count_unseen(len(points))
        detections = self._stream.detect(level, self.frame)
        self.frame += 1
        return track_frame(self._tracker, detections)

    def _count_unseen(self, points: int) -> None:
        """Notes the first scan of which nothing can be found."""
        self.unseen += 1
        if self.unseen == 1:
            where = f"none of its {points} points lies in the camera's view"
            expected = "expected x ahead, y left, z up in metres"
            note(f"scan {self.frame} of the tracker, from 0: {where}: {expected}")
