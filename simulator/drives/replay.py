"""Label-driven scenes: objects move as in KITTI labels, with a static world around them.

Nothing static is placed on the path of a labelled object or of the car, nor between the sensor and
an object labelled as visible.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.files import write_text
from kitti.boxes import transform_boxes
from kitti.calibration import Calibration
from kitti.labels import LABEL_COLUMNS, TYPE_COLUMN
from kitti.objects import Objects
from kitti.sequence import POSE_COLUMNS, KittiSequence
from kitti.tables import read_lines, read_table
from simulator.bodies.convex import Body
from simulator.bodies.kitti_types import make_body
from simulator.config import SENSOR
from simulator.drives.motion_files import write_oxts
from simulator.sensor_model.scan import Scene, Sweep
from simulator.world.grid import Grid, rectangle_points
from simulator.world.roads import even
from simulator.world.roadside import SETTINGS, Site, furnish
from simulator.world.static import StaticWorld
from simulator.world.terrain import Terrain

MARGIN = 100.0  # metres of world around the car's path
PLAUSIBLE_SPEED = 8.0  # m/s, without poses
EXTENSION = 110  # metres of road before and behind the car's path
FRAME_STEP = 2  # every second frame's lines of sight are kept free


@dataclass(frozen=True)
class Replay:
    """A `simulator.plan.World` of a labelled sequence; its text files are the source's.

    poses (F, 4, 4) of the level frame; objects with boxes; bodies by track.
    """

    sequence: KittiSequence
    poses: np.ndarray
    objects: Objects
    bodies: dict[int, Body]
    static: StaticWorld
    terrain: Terrain

    @property
    def calib(self) -> Calibration:
        """The source's calibration."""
        return self.sequence.calib

    @property
    def image_size(self) -> tuple[int, int]:
        """The source's image size."""
        return self.sequence.image_size

    def labels(self, frame: int, sweep: Sweep) -> None:
        """None: `write_texts` copies the source's labels."""

    def write_texts(self, root: Path, name: str, frames: int) -> None:
        """Copies the source's files, labels and poses of the first `frames` alone; writes oxts."""
        source = self.sequence
        table = read_table(source.label_path, (LABEL_COLUMNS,), TYPE_COLUMN)
        inside = zip(table.rows, table.values[:, 0] < frames, strict=True)
        labels = "".join(line + "\n" for line, chosen in inside if chosen)
        write_text(root / "label_02" / f"{name}.txt", labels)
        write_text(root / "calib" / f"{name}.txt", "\n".join(read_lines(source.calib_path)))
        if source.has_poses:
            lines = read_table(source.poses_path, (POSE_COLUMNS,)).rows[:frames]
            poses = "".join(line + "\n" for line in lines)
            write_text(root.parent / "poses" / f"{name}.txt", poses)
        write_oxts(root / "oxts" / f"{name}.txt", self.poses[:frames], self.calib, SENSOR.period_s)

    def scene(self, frame: int, motion: bool = False) -> Scene:
        """The scene of `frame`; with `motion`, objects move during the sweep."""
        now = self.objects.at(frame)
        return Scene(
            pose=self.poses[frame],
            boxes=now.boxes,
            bodies=[self.bodies[int(track)] for track in now.track_id],
            static=self.static,
            terrain=self.terrain,
            velocities=self._velocities(frame) if motion else None,
        )

    def _velocities(self, frame: int) -> np.ndarray:
        """Velocities (M, 3) of the objects of `frame` over the ground, in its level frame, m/s."""
        now, past = self.objects.at(frame), self.objects.at(frame - 1)
        result = np.zeros((len(now), 3))
        if frame == 0 or not len(past):
            return result
        turn = np.linalg.inv(self.poses[frame]) @ self.poses[frame - 1]
        before = dict(zip(past.track_id, transform_boxes(past.boxes, turn)[:, :3], strict=True))
        for row, track in enumerate(now.track_id):
            if track in before:
                result[row] = (now.boxes[row, :3] - before[track]) / SENSOR.period_s
        return result


def ego_poses(sequence: KittiSequence) -> np.ndarray:
    """(F, 4, 4) level-frame poses: from poses/, else at a plausible constant speed."""
    if sequence.poses is not None:
        return sequence.poses
    poses = np.tile(np.eye(4), (sequence.num_frames, 1, 1))
    poses[:, 0, 3] = PLAUSIBLE_SPEED * SENSOR.period_s * np.arange(sequence.num_frames)
    return poses


def replay(sequence: KittiSequence, rng) -> Replay:
    """Builds the world of a labelled sequence; `rng` is the only source of randomness."""
    poses = ego_poses(sequence)
    objects = sequence.objects
    objects = objects[np.isfinite(objects.boxes).all(axis=1) & (objects.type != "DontCare")]
    seed = int(rng.integers(2**31))
    bodies = {}
    for track in np.unique(objects.track_id):
        rows = objects[objects.track_id == track]
        size = np.median(rows.boxes[:, 3:6], axis=0)
        bodies[int(track)] = make_body(str(rows.type[0]), size, (seed, int(track)))
    world_boxes = np.zeros((len(objects), 7))
    for frame in np.unique(objects.frame):
        rows = objects.frame == frame
        world_boxes[rows] = transform_boxes(objects.boxes[rows], poses[frame])
    setting = SETTINGS[str(rng.choice(list(SETTINGS)))]
    path = road_path(poses, rng)
    low, high = path.min(axis=0) - MARGIN, path.max(axis=0) + MARGIN
    terrain = _terrain(poses, objects, world_boxes, low, high)
    kerb = float(rng.uniform(4.0, 7.5))
    _mark_roads(terrain, path, kerb, objects, world_boxes)
    taken = Grid(low, high, 0.5, bool)
    _keep_free(taken, poses, path, objects, world_boxes)
    site = Site(StaticWorld(), terrain, taken)
    furnish(site, path, kerb, setting, rng)
    return Replay(sequence, poses, objects, bodies, site.world, terrain)


def road_path(poses, rng) -> np.ndarray:
    """The car's path (n, 2), a point per metre, extended at both ends by a bending road."""
    track = poses[:, :2, 3]
    moved = [track[0]]
    for point in track[1:]:
        if np.hypot(*(point - moved[-1])) > 1.0:
            moved.append(point)
    ahead, start = _yaw(poses[-1]), _yaw(poses[0])
    front = _bend(moved[-1], ahead, rng)
    back = _bend(moved[0], start + np.pi, rng)[::-1]
    return even(np.vstack([back, np.array(moved), front]))


def _yaw(pose) -> float:
    return float(np.arctan2(pose[1, 0], pose[0, 0]))


def _bend(start, yaw: float, rng) -> np.ndarray:
    curvature = rng.uniform(-1, 1) * 0.012
    steps = np.arange(1, EXTENSION + 1)
    # straight at first, where the objects of the last frames are
    angle = yaw + curvature * np.maximum(steps - 40, 0)
    return start + np.cumsum(np.column_stack([np.cos(angle), np.sin(angle)]), axis=0)


def _terrain(poses, objects: Objects, world_boxes, low, high) -> Terrain:
    """Ground through the car's wheels and the bottoms of vehicles nearby."""
    foot = np.array([0.0, 0.0, -SENSOR.camera_height, 1.0])
    own = (poses @ foot)[:, :3]
    keep = np.concatenate([[True], np.hypot(*np.diff(own[:, :2], axis=0).T) > 0.2])
    near = np.isin(objects.type, ("Car", "Van", "Truck")) & (objects.boxes[:, 0] < 45)
    bottom = world_boxes[near, :3].copy()
    bottom[:, 2] -= world_boxes[near, 5] / 2
    samples = np.vstack([own[keep], bottom])
    weights = np.concatenate([np.ones(keep.sum()), np.full(len(bottom), 0.25)])
    return Terrain(samples, weights, low, high)


def _mark_roads(terrain: Terrain, path, kerb: float, objects: Objects, world_boxes) -> None:
    heading = np.gradient(path, axis=0)
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    across = np.column_stack([-heading[:, 1], heading[:, 0]])
    for offset in np.arange(-kerb, kerb, 0.3):
        for step in (0.0, 0.5):
            terrain.mark_road(path + offset * across + step * heading)
    wheels = np.isin(objects.type, ("Car", "Van", "Truck", "Tram", "Misc"))
    for box in world_boxes[wheels][::FRAME_STEP]:
        points = rectangle_points(box[:2], box[6], box[3] + 1.0, box[4] + 1.0, 0.35)
        terrain.mark_road(points)


def _keep_free(taken: Grid, poses, path, objects: Objects, world_boxes) -> None:
    """Marks the paths of the car and the objects and the lines of sight to visible objects."""
    for pose in poses:
        taken.mark(rectangle_points(pose[:2, 3], _yaw(pose), 6.0, 5.0, 0.45))
    for box in world_boxes:
        taken.mark(rectangle_points(box[:2], box[6], box[3] + 1.2, box[4] + 1.2, 0.45))
    share = np.linspace(0.0, 1.0, 180)[:, None]
    corner = np.array([[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]) / 2
    for frame in range(0, len(poses), FRAME_STEP):
        rows = (objects.frame == frame) & (objects.occlusion <= 1)
        eye = poses[frame, :2, 3]
        for box in world_boxes[rows]:
            cos, sin = np.cos(box[6]), np.sin(box[6])
            spots = box[:2] + (corner * box[3:5]) @ np.array([[cos, sin], [-sin, cos]])
            lines = eye + share[:, None] * (spots - eye)
            taken.mark(lines.reshape(-1, 2))
