"""Traffic in steps of 0.1 s: car following, signals, priority, overtaking, pulling out.

Accelerations depend on geometry, not lanes: the road user ahead is the first whose footprint covers
the future path. Merging, crossing, parked cars, cyclists and pedestrians need no separate rules.
"""

import numpy as np

from simulator.drives.agents import SPACING, Agent, advance, discs, idm, look_ahead
from simulator.world.roads import LANE

AHEAD_ROOM = 44.0  # metres that must be free to overtake or pull out
SIDE_ROOM = 0.35  # metres between passing cars
VEHICLES = ("Car", "Van", "Truck")


class Traffic:
    """All road users of a scene; `agents[0]` is the car with the sensor.

    Args:
        agents: the road users.
        signal_offsets: (J,) phases of the junctions' signals, seconds.
        dt: seconds a step.
    """

    CYCLE, GREEN, CLEAR = 24.0, 11.0, 2.0  # seconds of a signal cycle

    def __init__(self, agents: list[Agent], signal_offsets, dt: float = 0.1):
        self.agents, self.offsets, self.dt = agents, signal_offsets, dt
        self.time = 0.0

    def places(self) -> np.ndarray:
        """(A, 3) x, y, yaw."""
        return np.array([agent.place for agent in self.agents])

    def red(self, junction: int, group: int) -> bool:
        """True if the signal of a junction's group is red."""
        phase = (self.time + self.offsets[junction] + group * self.CYCLE / 2) % self.CYCLE
        return phase > self.GREEN - self.CLEAR

    def step(self) -> None:
        """Moves all agents by `dt`."""
        places = self.places()
        self._centers, self._radii = discs(places, np.array([a.size for a in self.agents]))
        self._yaw = places[:, 2]
        self._wheels = np.array([agent.kind in VEHICLES for agent in self.agents])
        self._speed = np.array([agent.speed for agent in self.agents])
        for index, agent in enumerate(self.agents):
            if agent.state == "fixed":
                continue
            if agent.state == "parked":
                self._maybe_pull_out(index, agent)
            elif agent.kind == "Pedestrian":
                self._walk(index, agent)
            else:
                self._drive(index, agent)
        self.time += self.dt

    def _drive(self, index: int, agent: Agent) -> None:
        limit = agent.route.speed_limit[min(int(agent.s), len(agent.route.points) - 1)]
        gap, ahead = self._ahead(index, agent, look_ahead(agent))
        acceleration = idm(agent.driver, agent.speed, limit, gap, agent.speed - ahead)
        for stop in agent.route.stops:
            room = stop.s - agent.s - agent.size[0] / 2
            stoppable = agent.speed**2 / (2 * 4.5) < room
            if 0 < room < 45 and stoppable and self.red(stop.junction, stop.group):
                value = idm(agent.driver, agent.speed, limit, room + 1.0, agent.speed)
                acceleration = min(acceleration, value)
        if agent.brake_at <= self.time < agent.brake_at + agent.brake_for:
            acceleration = min(acceleration, -6.0)
        if agent.kind in VEHICLES:
            self._overtake(index, agent, gap, ahead)
        self._move(index, agent, acceleration)

    def _move(self, index: int, agent: Agent, acceleration: float) -> None:
        """Moves one agent unless it would collide with another one."""
        kept = (agent.s, agent.shift, agent.shift_rate)
        centers = self._centers[index].copy()
        advance(agent, acceleration, self.dt)
        self._centers[index] = discs(np.array([agent.place]), agent.size[None])[0][0]
        after = self._closest(index)
        if after < 0.1:
            moved = self._centers[index].copy()
            self._centers[index] = centers
            if after < self._closest(index):
                agent.s, agent.shift, agent.shift_rate = kept
                agent.speed, agent.acceleration = 0.0, 0.0
            else:
                self._centers[index] = moved

    def _closest(self, index: int) -> float:
        """Smallest gap between the discs of one agent and of all others, metres."""
        own = self._centers[index]
        away = self._centers[:, 1] - own[1]
        near = np.flatnonzero((away * away).sum(axis=1) < 250.0)
        away = self._centers[near][:, :, None] - own[None, None]
        room = np.sqrt((away * away).sum(-1)).min(axis=(1, 2)) - self._radii[near]
        room[near == index] = np.inf
        return float(room.min()) - self._radii[index]

    def _ahead(self, index: int, agent: Agent, points) -> tuple[float, float]:
        """Gap (m) to the next agent on the path and its speed along it; (1000, 0) if it is free."""
        away = self._centers[:, 1] - points[len(points) // 2]
        near = (away * away).sum(axis=1) < 32.0**2
        near[index] = False
        others = np.flatnonzero(near)
        if not len(others):
            return 1e3, 0.0
        centers, turning = self._centers[others], self._gives_way(agent)
        covered = self._covers(points, centers, self._radii[others] + agent.size[1] / 2 + SIDE_ROOM)
        still = np.zeros(len(others), bool)
        if turning:
            crossing = np.cos(self._yaw[others] - self._yaw[index]) < 0.7
            for later in (1.0, 2.0, 3.0):
                moved = centers + (later * self._velocity(others))[:, None]
                met = self._covers(points, moved, self._radii[others] + agent.size[1] / 2 + 0.2)
                met &= (crossing & (self._speed[others] > 1.0))[None]
                still |= met.any(axis=0) & ~covered.any(axis=0)
                covered |= met
        rows = np.flatnonzero(covered.any(axis=1))
        if not len(rows):
            return 1e3, 0.0
        first = rows[0]
        who = np.flatnonzero(covered[first])[0]
        speed = self._speed[others[who]] * np.cos(self._yaw[others[who]] - self._yaw[index])
        gap = first * SPACING - agent.size[0] / 2 - 0.5
        return max(gap, 0.05), 0.0 if still[who] else max(float(speed), 0.0)

    def _gives_way(self, agent: Agent) -> bool:
        turn = agent.route.turn
        return turn is not None and agent.route.left and turn[0] - 12 < agent.s < turn[0] + 6

    def _velocity(self, rows) -> np.ndarray:
        ahead = np.stack([np.cos(self._yaw[rows]), np.sin(self._yaw[rows])], axis=1)
        return self._speed[rows, None] * ahead

    @staticmethod
    def _covers(points, centers, reach) -> np.ndarray:
        """(M, A) bool: whether a disc of an agent comes within `reach` (A,) of a point."""
        away = points[:, None, None] - centers[None]
        return ((away**2).sum(-1) < reach[None, :, None] ** 2).any(axis=-1)

    def _free(self, index: int, agent: Agent, target: float, back: float, seconds: float) -> bool:
        """True if the path shifted to `target` stays free, oncoming traffic included."""
        away = self._centers[:, 1] - self._centers[index, 1]
        others = np.flatnonzero((away * away).sum(axis=1) < 120.0**2)
        others = others[others != index]
        reach = self._radii[others] + agent.size[1] / 2 + SIDE_ROOM
        points = agent.route.at(agent.s + np.arange(-back, AHEAD_ROOM, SPACING), target)
        for later in np.arange(0.0, seconds + 0.1, 1.0):
            moved = self._centers[others] + (later * self._velocity(others))[:, None]
            if self._covers(points, moved, reach).any():
                return False
        return True

    def _overtake(self, index: int, agent: Agent, gap: float, ahead: float) -> None:
        if abs(agent.target - agent.home) > 0.1:
            if self._free(index, agent, agent.home, 7.0, 0.0):
                agent.target = agent.home
            return
        agent.blocked = agent.blocked + self.dt if gap < 22 and ahead < 5.5 else 0.0
        in_turn = agent.route.turn is not None and agent.s > agent.route.turn[0] - 30
        at_stop = any(0 < stop.s - agent.s < 40 for stop in agent.route.stops)
        if agent.blocked < 1.0 or in_turn or at_stop or gap < 4.0:
            return
        aside = agent.home + LANE
        if self._free(index, agent, aside, 12.0, 4.0):
            agent.target = aside

    def _maybe_pull_out(self, index: int, agent: Agent) -> None:
        if self.time >= agent.start and self._free(index, agent, agent.home, 22.0, 1.0):
            agent.state, agent.target = "drive", agent.home

    def _walk(self, index: int, agent: Agent) -> None:
        """Moves a pedestrian at constant pace; one who crosses waits for cars."""
        x, y, yaw = agent.place
        step = np.array([np.cos(yaw), np.sin(yaw)])
        spot = np.array([x, y]) + 1.6 * step
        wheels = self._wheels & (self._speed > 0.5)
        danger = np.hypot(*(self._centers[:, 2] - spot).T) < 4.0 + 0.9 * self._speed
        solid = np.hypot(*(self._centers.reshape(-1, 2) - spot).T).reshape(-1, 4).min(1) < 0.9
        solid[index] = False
        waits = bool((wheels & danger).any() and agent.crosses) or bool(solid.any())
        speed = 0.0 if waits else agent.driver.speed
        agent.speed = speed
        agent.s += speed * self.dt
        self._centers[index] = discs(np.array([agent.place]), agent.size[None])[0][0]
