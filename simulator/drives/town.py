"""A town for own traffic: roads, ground, roadside, and the initial road users."""

from dataclasses import dataclass

import numpy as np

from simulator.bodies.kitti_types import draw_size
from simulator.config import VehicleMix
from simulator.drives.agents import Agent, Driver
from simulator.world.grid import Grid
from simulator.world.roads import LANE, SIDE_HALF, Network, Route, beside, make_network
from simulator.world.roadside import SETTINGS, Site, furnish
from simulator.world.static import StaticWorld
from simulator.world.terrain import Terrain

EGO_SIZE = np.array([4.77, 1.82, 1.52])  # VW Passat B6, KITTI's car
START = 70.0  # metres of main road behind the car when the scene begins
CROWN = 0.06  # metres by which the middle of the road is higher than its edge


@dataclass(frozen=True)
class Town:
    """Roads, ground and roadside."""

    network: Network
    terrain: Terrain
    static: StaticWorld
    kerbs: tuple[float, float]  # distance of the kerbs from the main road's middle, left, right


def make_town(length: float, rng) -> Town:
    """A town whose main road is `length` metres long."""
    network = make_network(length, rng)
    kerbs = tuple(network.half_width + strip + 0.3 for strip in network.strips)
    every = np.vstack([network.main, *(side for _, side in network.sides)])
    low, high = every.min(axis=0) - 80, every.max(axis=0) + 80
    terrain = _terrain(network, low, high, rng)
    _mark_roads(terrain, network, kerbs)
    taken = Grid(low, high, 0.5, bool)
    for left, right, line in ((kerbs[0], kerbs[1], network.main), *(
        (SIDE_HALF + 0.3, SIDE_HALF + 0.3, side) for _, side in network.sides
    )):  # fmt: skip
        for offset in np.arange(-right - 0.2, left + 0.3, 0.45):
            taken.mark(beside(line, offset))
    for offset in (kerbs[0] + 1.8, -kerbs[1] - 1.8):  # where pedestrians walk
        for aside in (-0.6, -0.2, 0.2, 0.6):
            taken.mark(beside(network.main, offset + aside))
    site = Site(StaticWorld(), terrain, taken)
    setting = SETTINGS[str(rng.choice(list(SETTINGS)))]
    furnish(site, network.main, max(kerbs), setting, rng)
    for _, side in network.sides:
        furnish(site, side, SIDE_HALF + 0.3, setting, rng)
    return Town(network, terrain, site.world, kerbs)


def _terrain(network: Network, low, high, rng) -> Terrain:
    s = np.arange(len(network.main))
    wave = rng.uniform(90, 260)
    grade = rng.uniform(0, 0.03)
    height = grade * wave / (2 * np.pi) * np.sin(2 * np.pi * (s / wave + rng.random()))
    samples = np.column_stack([network.main, height])
    terrain = Terrain(samples, np.ones(len(samples)), low, high)
    terrain.add_bumps(rng, 0.08, 9.0)
    return terrain


def _mark_roads(terrain: Terrain, network: Network, kerbs) -> None:
    for _, side in network.sides:
        for offset in np.arange(-SIDE_HALF - 0.3, SIDE_HALF + 0.3, 0.25):
            line = beside(side, offset)
            terrain.mark_road(np.vstack([line, (line[1:] + line[:-1]) / 2]))
    for offset in np.arange(-kerbs[1], kerbs[0], 0.25):
        line = beside(network.main, offset)
        crown = CROWN * (0.5 - min(abs(offset) / network.half_width, 1.0))
        terrain.mark_road(np.vstack([line, (line[1:] + line[:-1]) / 2]), crown)


def populate(town: Town, frames: int, rng, mix: VehicleMix) -> list[Agent]:
    """The initial road users; the first is the car with the sensor."""
    network = town.network
    agents = [_ego(network, rng)]
    spots = Spots()
    spots.take(agents[0])
    density = rng.uniform(22.0, 80.0)  # metres between vehicles of a lane
    for lane in network.routes:
        if lane.turn is not None:
            continue
        s = rng.uniform(0, density)
        while s < lane.length - 20:
            agent = _vehicle(_choose(network, lane, s, rng), s, rng, mix)
            if spots.take(agent):
                agents.append(agent)
            s += agent.size[0] + 4 + rng.exponential(density)
    agents += [agent for agent in _parked(town, frames, rng, mix) if spots.take(agent)]
    agents += [agent for agent in _cyclists(network, rng) if spots.take(agent)]
    agents += [agent for agent in _pedestrians(town, frames, rng) if spots.take(agent)]
    for agent in agents[1:]:
        if agent.state == "drive" and agent.kind != "Pedestrian" and rng.random() < 0.12:
            agent.brake_at = rng.uniform(0, max(frames / 10, 1))
            agent.brake_for = rng.uniform(0.8, 2.5)
    return agents


class Spots:
    """Occupied places of the initial road users, which must not overlap."""

    def __init__(self):
        self.discs = np.zeros((0, 3))

    def take(self, agent: Agent) -> bool:
        """Occupies the agent's place if it is free; returns whether it was."""
        x, y, yaw = agent.place
        share = np.linspace(-0.45, 0.45, 5) * agent.size[0]
        centers = np.array([x, y]) + share[:, None] * [np.cos(yaw), np.sin(yaw)]
        radius = agent.size[1] / 2 + 0.25
        away = centers[:, None] - self.discs[None, :, :2]
        if (np.hypot(away[..., 0], away[..., 1]) < radius + self.discs[None, :, 2]).any():
            return False
        own = np.column_stack([centers, np.full(5, radius)])
        self.discs = np.vstack([self.discs, own])
        return True


def _ego(network: Network, rng) -> Agent:
    route = network.routes[int(rng.integers(network.lanes))]
    if rng.random() < 0.35:
        turns = [r for r in network.routes if r.turn and r.turn[0] > START + 40
                 and np.hypot(*(r.points[int(START)] - route.points[int(START)])) < 8]  # fmt: skip
        if turns:
            route = turns[int(rng.integers(len(turns)))]
    driver = Driver(speed=rng.uniform(7.5, 13.5), time_gap=rng.uniform(1.0, 1.8))
    return Agent("Car", EGO_SIZE, route, driver, s=START, speed=rng.uniform(3, 9))


def _choose(network: Network, lane: Route, s: float, rng) -> Route:
    """The lane itself, or one of the routes that turn off it ahead."""
    if rng.random() < 0.7:
        return lane
    turns = [
        route
        for route in network.routes
        if route.turn is not None and route.turn[0] > s + 20
        and np.hypot(*(route.points[int(s)] - lane.points[int(s)])) < 0.5
    ]  # fmt: skip
    return turns[int(rng.integers(len(turns)))] if turns else lane


def _vehicle(route: Route, s: float, rng, mix: VehicleMix) -> Agent:
    cars = 1 - mix.moving_vans - mix.moving_trucks
    shares = [cars, mix.moving_vans, mix.moving_trucks]
    kind = str(rng.choice(["Car", "Van", "Truck"], p=shares))
    driver = Driver(
        speed=rng.uniform(7, 14), time_gap=rng.uniform(0.9, 1.8), distance=rng.uniform(1.5, 3.0),
        acceleration=rng.uniform(1.2, 2.2),
    )  # fmt: skip
    shift = rng.normal(0, 0.15)
    return Agent(kind, draw_size(kind, rng), route, driver, s=s, speed=rng.uniform(2, 8),
                 shift=shift, target=shift, home=shift)  # fmt: skip


def _parked(town: Town, frames: int, rng, mix: VehicleMix) -> list[Agent]:
    """Parked cars on the strips; some of those along the kerb pull out."""
    network, agents = town.network, []
    lanes = network.lanes
    for strip, route in ((1, network.routes[lanes - 1]), (0, network.routes[2 * lanes - 1])):
        width = network.strips[strip]
        if width == 0:
            continue
        occupancy = rng.uniform(0.3, 0.95)
        square = width > 3  # cars stand across
        s = rng.uniform(5, 15)
        while s < route.length - 10:
            kind = "Van" if rng.random() < mix.parked_vans and not square else "Car"
            size = draw_size(kind, rng)
            room = (size[1] + rng.uniform(0.5, 1.0)) if square else size[0] + rng.uniform(0.7, 1.8)
            if rng.random() < occupancy and not _at_junction(network, route.spot(s + room / 2)):
                agents.append(_parked_one(route, s + room / 2, kind, size, width, frames, rng))
            s += room
    return agents


def _at_junction(network: Network, point) -> bool:
    return any(
        np.hypot(*(network.main[int(s)] - point)) < network.half_width + 9.0
        for s, _ in network.sides
    )


def _parked_one(route: Route, s, kind, size, width, frames, rng) -> Agent:
    driver = Driver(speed=rng.uniform(7, 12))
    offset = -LANE / 2 - width / 2
    if width > 3:
        x, y = route.spot(float(s), offset + rng.normal(0, 0.15))
        yaw = route.yaw[int(s)] + np.pi / 2 * rng.choice([-1, 1]) + rng.normal(0, 0.04)
        return Agent(kind, size, route, driver, s=s, state="fixed", pose=(x, y, float(yaw)))
    shift = offset + rng.normal(0, 0.08)
    if rng.random() < 0.08:
        start = rng.uniform(0, max(frames / 10, 1))
        return Agent(kind, size, route, driver, s=s, shift=shift, target=shift, state="parked",
                     start=start)  # fmt: skip
    x, y = route.spot(float(s), shift)
    turned = np.pi if rng.random() < 0.04 else 0.0
    yaw = float(route.yaw[int(s)] + turned + rng.normal(0, 0.02))
    return Agent(kind, size, route, driver, s=s, state="fixed", pose=(float(x), float(y), yaw))


def _cyclists(network: Network, rng) -> list[Agent]:
    agents = []
    for route in network.routes:
        if route.turn is not None:
            continue
        for _ in range(rng.poisson(route.length / 160)):
            shift = -LANE / 2 + rng.uniform(0.5, 0.9)
            speed = rng.uniform(3.0, 6.0)
            agents.append(
                Agent("Cyclist", draw_size("Cyclist", rng), route, Driver(speed=speed),
                      s=rng.uniform(5, route.length - 10), speed=speed, shift=shift, target=shift,
                      home=shift)
            )  # fmt: skip
    return agents


def _pedestrians(town: Town, frames: int, rng) -> list[Agent]:
    agents, main = [], town.network.main
    for offset in (town.kerbs[0] + 1.8, -town.kerbs[1] - 1.8):
        for line in (beside(main, offset), beside(main, offset)[::-1]):
            route = Route(line)
            for _ in range(rng.poisson(route.length / rng.uniform(25, 90))):
                size, aside = draw_size("Pedestrian", rng), rng.uniform(-0.5, 0.5)
                pace = Driver(speed=0.0 if rng.random() < 0.12 else rng.uniform(0.8, 1.8))
                agents.append(
                    Agent("Pedestrian", size, route, pace, s=rng.uniform(2, route.length - 2),
                          speed=pace.speed, shift=aside, target=aside)
                )  # fmt: skip
    for s in rng.uniform(START, len(main) - 30, rng.poisson(len(main) / 90)):
        ahead = main[int(s) + 1] - main[int(s)]
        across = np.array([-ahead[1], ahead[0]]) * rng.choice([-1, 1])
        reach = np.arange(-max(town.kerbs) - 25, max(town.kerbs) + 25.0)
        route = Route(main[int(s)] + reach[:, None] * across)
        pace = Driver(speed=rng.uniform(1.0, 1.8))
        agents.append(
            Agent("Pedestrian", draw_size("Pedestrian", rng), route, pace,
                  s=rng.uniform(2, 22), speed=pace.speed, crosses=True)
        )  # fmt: skip
    return agents


def footprint_ground(terrain: Terrain, places, sizes) -> np.ndarray:
    """Heights (A,) of the ground under footprints: places (A, 3) x, y, yaw; sizes (A, 3)."""
    corner = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * 0.3
    cos, sin = np.cos(places[:, 2:3]), np.sin(places[:, 2:3])
    u, v = corner[:, 0] * sizes[:, :1], corner[:, 1] * sizes[:, 1:2]
    x = places[:, :1] + cos * u - sin * v
    y = places[:, 1:2] + sin * u + cos * v
    return terrain.height(np.stack([x, y], axis=-1)).mean(axis=1)
