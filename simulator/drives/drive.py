"""Own traffic as a world of scenes: the traffic is simulated once, all frames are stored."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kitti.boxes import IMAGE_SIZE, transform_boxes
from kitti.calibration import LEVEL_FROM_CAMERA, Calibration, write_calibration
from kitti.objects import Objects
from simulator.annotate import label_frame
from simulator.bodies.convex import Body
from simulator.bodies.kitti_types import make_body
from simulator.config import SENSOR, VehicleMix
from simulator.drives.motion_files import write_oxts, write_poses
from simulator.drives.town import START, Town, footprint_ground, make_town, populate
from simulator.drives.traffic import Traffic
from simulator.sensor_model.scan import Scene, Sweep
from simulator.world.terrain import Terrain

WARM_UP = 12.0  # seconds of traffic before the first frame
NEAR = 130.0  # metres within which objects are kept


@dataclass(frozen=True)
class DriveWorld:
    """A `simulator.plan.World` of own traffic.

    poses (F, 4, 4) level frame -> world; lists with an array per frame: rows of nearby agents (M,),
    their world boxes (M, 7) and speeds (M,).
    """

    calib: Calibration
    poses: np.ndarray
    rows: list[np.ndarray]
    boxes: list[np.ndarray]
    speeds: list[np.ndarray]
    kinds: np.ndarray
    bodies: list[Body]
    town: Town
    image_size: tuple[int, int] = IMAGE_SIZE

    def scene(self, frame: int, motion: bool) -> Scene:
        """The scene of `frame`."""
        boxes = self._level_boxes(frame)
        ahead = np.stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6]), np.zeros(len(boxes))], axis=1)
        return Scene(
            pose=self.poses[frame],
            boxes=boxes,
            bodies=[self.bodies[row] for row in self.rows[frame]],
            static=self.town.static,
            terrain=self.town.terrain,
            velocities=self.speeds[frame][:, None] * ahead if motion else None,
        )

    def _level_boxes(self, frame: int) -> np.ndarray:
        return transform_boxes(self.boxes[frame], np.linalg.inv(self.poses[frame]))

    def labels(self, frame: int, sweep: Sweep) -> Objects:
        """Label rows of `frame`, with occlusions from the sweep's ray counts."""
        rows = self.rows[frame]
        boxes = self._level_boxes(frame)
        args = (boxes, self.kinds[rows], rows - 1, sweep.rays, sweep.seen)
        return label_frame(frame, *args, self.calib, self.image_size)

    def write_texts(self, root: Path, name: str, frames: int) -> None:
        """Writes calibration, oxts and poses; labels are written with the frames."""
        write_calibration(root / "calib" / f"{name}.txt", self.calib)
        write_oxts(root / "oxts" / f"{name}.txt", self.poses[:frames], self.calib, SENSOR.period_s)
        write_poses(root.parent / "poses" / f"{name}.txt", self.poses[:frames])


def drive(frames: int, rng, mix: VehicleMix | None = None) -> DriveWorld:
    """Builds a town, simulates `frames` frames of traffic and stores the objects near the car."""
    town = make_town(START + 2 * 110 + 14.0 * (frames * SENSOR.period_s + WARM_UP), rng)
    agents = populate(town, frames, rng, mix or VehicleMix())
    offsets = rng.uniform(0, Traffic.CYCLE, len(town.network.sides))
    traffic = Traffic(agents, offsets, SENSOR.period_s)
    for agent in agents:  # events are timed from the first frame
        agent.start, agent.brake_at = agent.start + WARM_UP, agent.brake_at + WARM_UP
    traffic.dt = 2 * SENSOR.period_s  # coarse steps before the first frame
    while traffic.time < WARM_UP:
        traffic.step()
    traffic.dt = SENSOR.period_s
    sizes = np.array([agent.size for agent in agents])
    poses, rows, boxes, speeds = [], [], [], []
    for _ in range(frames):
        traffic.step()
        places = traffic.places()
        poses.append(_ego_pose(town.terrain, places[0], agents[0].acceleration))
        gone = np.array([a.s >= a.route.length - 3 and a.state == "drive" for a in agents])
        near = np.flatnonzero((np.hypot(*(places[:, :2] - places[0, :2]).T) < NEAR) & ~gone)
        near = near[near > 0]
        ground = footprint_ground(town.terrain, places[near], sizes[near])
        z = ground + sizes[near, 2] / 2
        rows.append(near)
        boxes.append(np.column_stack([places[near, :2], z, sizes[near], places[near, 2]]))
        speeds.append(np.array([agents[row].speed for row in near]))
    poses = np.array(poses)
    seed = int(rng.integers(2**31))
    kinds = np.array([agent.kind for agent in agents])
    bodies = [make_body(agent.kind, agent.size, (seed, i)) for i, agent in enumerate(agents)]
    return DriveWorld(make_calibration(rng), poses, rows, boxes, speeds, kinds, bodies, town)


def _ego_pose(terrain: Terrain, place, acceleration: float) -> np.ndarray:
    """Level frame -> world: the camera above the car, tilted by the ground and by braking."""
    x, y, yaw = place
    ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    spots = np.array([[x, y]]) + np.array([1.35 * ahead, -1.35 * ahead, 0.75 * left, -0.75 * left])
    front, rear, port, starboard = terrain.base.bilinear(spots)
    up = (front - rear) / 2.7 + 0.003 * np.clip(acceleration, -6, 3)
    over = (port - starboard) / 1.5
    forward = np.array([*ahead, up])
    forward /= np.linalg.norm(forward)
    side = np.array([*left, over])
    side -= forward * (side @ forward)
    side /= np.linalg.norm(side)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([forward, side, np.cross(forward, side)])
    ground = float(terrain.height(np.array([[x, y]]))[0])
    pose[:3, 3] = np.array([x, y, ground]) + SENSOR.camera_height * pose[:3, 2]
    return pose


def make_calibration(rng) -> Calibration:
    """A calibration like KITTI's: its lens and lever arms, and random rotations of a degree."""
    focal, cx, cy = 721.5 + rng.normal(0, 3), 609.6 + rng.normal(0, 3), 172.9 + rng.normal(0, 3)
    p0 = np.array([[focal, 0, cx, 0], [0, focal, cy, 0], [0, 0, 1, 0.0]])

    def shifted(x: float) -> np.ndarray:
        result = p0.copy()
        result[0, 3] = x
        return result

    p2 = p0.copy()
    p2[:, 3] = 44.86, 0.2164, 0.002746
    r0_rect = _small_rotation(rng, 0.5)
    velo = np.eye(4)[:3]
    velo[:, :3] = _small_rotation(rng, 0.4) @ LEVEL_FROM_CAMERA.T
    velo[:, 3] = -0.004, -0.076, -0.272  # Geiger et al., IJRR 2013, figure 3
    imu = np.eye(4)[:3]
    imu[:, :3], imu[:, 3] = _small_rotation(rng, 0.4), (-0.81, 0.32, -0.80)
    return Calibration(
        p2=p2, r0_rect=r0_rect, tr_velo_to_cam=velo, tr_imu_to_velo=imu,
        p0=p0, p1=shifted(-387.6), p3=shifted(-339.5),
    )  # fmt: skip


def _small_rotation(rng, degrees: float) -> np.ndarray:
    """A rotation about a random axis by about `degrees` (Rodrigues)."""
    x, y, z = np.radians(degrees) * rng.normal(size=3)
    angle = np.sqrt(x * x + y * y + z * z)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) / angle
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
