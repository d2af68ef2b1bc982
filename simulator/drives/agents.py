"""Road users and their motion along a route. Letters: A agents, M points ahead, D discs."""

import math
from dataclasses import dataclass

import numpy as np

from simulator.world.roads import Route

AHEAD = 46.0  # metres of the future path that a driver considers
SPACING = 2.0


@dataclass(frozen=True)
class Driver:
    """Parameters of the intelligent driver model (Treiber, Hennecke, Helbing 2000), urban."""

    speed: float = 11.0  # desired speed, m/s
    time_gap: float = 1.2  # s
    distance: float = 2.0  # m, bumper to bumper at rest
    acceleration: float = 1.6  # m/s^2
    braking: float = 2.2  # comfortable, m/s^2
    hardest: float = 8.0  # m/s^2, limit of the tyres


@dataclass
class Agent:
    """One road user.

    s: arc length of its centre on the route; shift: metres to the left of the route; with rates.
    state: "drive", "parked" (pulls out at `start`) or "fixed" (stationary at `pose`: x, y, yaw).
    """

    kind: str
    size: np.ndarray
    route: Route
    driver: Driver
    s: float = 0.0
    speed: float = 0.0
    shift: float = 0.0
    shift_rate: float = 0.0
    target: float = 0.0
    home: float = 0.0
    state: str = "drive"
    start: float = np.inf
    brake_at: float = np.inf
    brake_for: float = 0.0
    pose: tuple[float, float, float] | None = None
    acceleration: float = 0.0
    blocked: float = 0.0  # seconds behind a slow road user
    crosses: bool = False  # a pedestrian who walks across the road

    @property
    def place(self) -> tuple[float, float, float]:
        """x, y, yaw; the yaw is the chord between the axles, turned while changing lanes."""
        if self.pose is not None:
            return self.pose
        reach = 0.3 * float(self.size[0])
        x, y = self.route.spot(self.s, self.shift)
        front_x, front_y = self.route.spot(self.s + reach, self.shift)
        rear_x, rear_y = self.route.spot(self.s - reach, self.shift)
        yaw = math.atan2(front_y - rear_y, front_x - rear_x)
        lean = math.atan2(self.shift_rate, max(self.speed, 1.5))
        return x, y, yaw + lean


def idm(driver: Driver, speed: float, limit: float, gap: float, closing: float) -> float:
    """Acceleration in m/s^2; `closing` is the speed minus that of the road user ahead."""
    wanted = max(min(driver.speed, limit), 0.1)
    root = 2 * math.sqrt(driver.acceleration * driver.braking)
    space = driver.distance + max(speed * driver.time_gap + speed * closing / root, 0.0)
    free = 1 - (speed / wanted) ** 4
    value = driver.acceleration * (free - (space / max(gap, 0.3)) ** 2)
    return min(max(value, -driver.hardest), driver.acceleration)


def discs(places, sizes) -> tuple[np.ndarray, np.ndarray]:
    """Four discs along each footprint: centres (A, 4, 2), radii (A,).

    places (A, 3) x, y, yaw; sizes (A, 3) l, w, h.
    """
    share = np.array([-0.375, -0.125, 0.125, 0.375])
    ahead = np.stack([np.cos(places[:, 2]), np.sin(places[:, 2])], axis=1)
    centers = places[:, None, :2] + (share * sizes[:, :1])[..., None] * ahead[:, None]
    return centers, np.maximum(sizes[:, 1] / 2, sizes[:, 0] / 8)


def look_ahead(agent: Agent) -> np.ndarray:
    """Points (M, 2) on the agent's future path."""
    reach = np.arange(0, AHEAD, SPACING)
    change = np.minimum(reach / max(2.5 * agent.speed, 8.0), 1)
    return agent.route.at(agent.s + reach, agent.shift + (agent.target - agent.shift) * change)


def advance(agent: Agent, acceleration: float, dt: float) -> None:
    """Moves the agent by `dt` seconds."""
    agent.acceleration = acceleration
    before = agent.speed
    agent.speed = max(before + acceleration * dt, 0.0)
    agent.s += (before + agent.speed) / 2 * dt
    fastest = min(1.3, 0.22 * agent.speed)
    wanted = min(max((agent.target - agent.shift) * 0.9, -fastest), fastest)
    agent.shift_rate += min(max(wanted - agent.shift_rate, -1.4 * dt), 1.4 * dt)
    if agent.speed < 0.05:
        agent.shift_rate = 0.0
    agent.shift += agent.shift_rate * dt
