"""Traffic: following, signals, overtaking, pulling out, turns."""

import numpy as np
import pytest
from helpers.overlap import iou_bev

from simulator.config import VehicleMix
from simulator.drives.agents import Agent, Driver, idm
from simulator.drives.drive import drive
from simulator.drives.town import make_town, populate
from simulator.drives.traffic import Traffic
from simulator.world.roads import LANE, Route, Stop, make_network

SIZE = np.array([4.0, 1.7, 1.5])


def straight(length: float = 300.0, **more) -> Route:
    return Route(np.column_stack([np.arange(length), np.zeros(int(length))]), **more)


def car(route: Route, s: float, speed: float = 10.0, **more) -> Agent:
    return Agent("Car", SIZE, route, Driver(speed=12.0), s=s, speed=speed, **more)


def wanderer(far: float = 250.0) -> Agent:
    """The first agent, far from all others."""
    return car(Route(np.column_stack([np.arange(300.0), np.full(300, far)])), 10)


def test_idm_at_its_limits():
    driver = Driver()
    assert idm(driver, 0.0, 99, 1e3, 0.0) == pytest.approx(driver.acceleration, rel=1e-3)
    assert idm(driver, driver.speed, 99, 1e4, 0.0) == pytest.approx(0, abs=0.01)
    assert idm(driver, 10.0, 99, 3.0, 10.0) == -driver.hardest
    assert idm(driver, 10.0, 5.0, 1e3, 0.0) < -1  # a bend ahead


def test_one_follows_and_stops_behind_a_braking_leader():
    route = straight(turn=(0.0, 300.0))  # one does not overtake in a turn
    leader = car(route, 60.0, brake_at=2.0, brake_for=20.0)
    follower = car(route, 30.0)
    traffic = Traffic([wanderer(), leader, follower], np.zeros(0))
    gaps = []
    for _ in range(120):
        traffic.step()
        gaps.append(leader.s - follower.s - SIZE[0])
    assert leader.speed == 0 and follower.speed < 0.3
    assert min(gaps) > 0.3 and gaps[-1] < 8


def test_red_stops_and_green_lets_go():
    route = straight(stops=[Stop(100.0, 0, 0)])
    agent = car(route, 60.0)
    traffic = Traffic([wanderer(), agent], np.array([10.0]))  # red from 0 to 14 s
    for _ in range(130):
        traffic.step()
    assert agent.speed < 0.3 and 94 < agent.s + SIZE[0] / 2 < 100
    for _ in range(100):
        traffic.step()
    assert agent.s > 110


def test_cyclists_are_overtaken_and_the_lane_is_taken_again():
    route = straight()
    cyclist = Agent("Cyclist", np.array([1.8, 0.6, 1.7]), route, Driver(speed=3.0), s=60, speed=3,
                    shift=-0.8, target=-0.8, home=-0.8)  # fmt: skip
    agent = car(route, 30.0)
    traffic = Traffic([wanderer(), cyclist, agent], np.zeros(0))
    shifts = []
    for _ in range(250):
        traffic.step()
        shifts.append(agent.shift)
    assert agent.s > cyclist.s + 10
    assert max(shifts) > 0.7 * LANE and abs(shifts[-1]) < 0.3


def test_no_overtaking_into_oncoming_traffic():
    route = straight()
    parked = car(route, 80.0, 0.0, state="fixed", pose=(80.0, 0.0, 0.0))
    back = Route(np.column_stack([np.arange(299.0, -1, -1), np.full(300, LANE)]))
    oncoming = [car(back, s, 10.0) for s in range(100, 215, 22)]
    agent = car(route, 40.0)
    traffic = Traffic([wanderer(), parked, agent, *oncoming], np.zeros(0))
    for _ in range(60):
        traffic.step()
        assert agent.shift < 0.5
    assert agent.s < 80


def test_parked_cars_pull_out_when_there_is_room():
    route = straight()
    waiting = car(route, 100.0, 0.0, state="parked", shift=-2.7, target=-2.7, start=0.0)
    passing = car(route, 85.0)
    traffic = Traffic([wanderer(), waiting, passing], np.zeros(0))
    traffic.step()
    assert waiting.state == "parked"  # another car is passing
    for _ in range(150):
        traffic.step()
    assert waiting.state == "drive" and abs(waiting.shift) < 0.3 and waiting.s > 120


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_the_share_of_vans_is_the_chosen_one(share):
    rng, mix = np.random.default_rng(1), VehicleMix.with_vans(share)
    town = make_town(400.0, rng)
    kinds = [agent.kind for agent in populate(town, 10, rng, mix)[1:]]
    vehicles = [kind for kind in kinds if kind in ("Car", "Van", "Truck")]
    assert len(vehicles) > 60
    assert np.mean([kind == "Van" for kind in vehicles]) == pytest.approx(share, abs=0.1)
    assert VehicleMix.with_vans(None) == VehicleMix()


def test_network_turns_start_and_end_on_lanes():
    network = make_network(400.0, np.random.default_rng(0))
    turns = [route for route in network.routes if route.turn is not None]
    lanes = [route for route in network.routes if route.turn is None]
    assert turns and any(route.left for route in turns) and any(not r.left for r in turns)
    for route in turns:
        for end in (0, -1):
            gaps = [np.hypot(*(lane.points - route.points[end]).T).min() for lane in lanes]
            assert min(gaps) < 0.6
        step = np.hypot(*np.diff(route.points, axis=0).T)
        assert step.min() > 0.7 and step.max() < 1.3
        assert np.abs(np.diff(route.yaw)).max() < 0.5  # no kinks


@pytest.mark.slow
def test_a_drive_is_plausible():
    world = drive(40, np.random.default_rng(3))
    speeds, steps = [], []
    for frame in range(40):
        kinds = world.kinds[world.rows[frame]]
        boxes = world.boxes[frame][np.isin(kinds, ("Car", "Van", "Truck"))]
        overlap = iou_bev(boxes, boxes) - np.eye(len(boxes))
        assert overlap.max(initial=0) < 0.02  # no collisions
        speeds.append(world.speeds[frame].max())
        if frame:
            shared, now, before = np.intersect1d(
                world.rows[frame], world.rows[frame - 1], return_indices=True
            )
            moved = world.boxes[frame][now, :2] - world.boxes[frame - 1][before, :2]
            steps.append(np.hypot(*moved.T).max())
            assert len(shared) > 5
    assert 2 < max(speeds) < 18 and max(steps) < 2.0
    ego = world.poses[:, :3, 3]
    assert np.hypot(*np.diff(ego[:, :2], axis=0).T).max() < 1.6
    turn = world.poses[:, :3, :3]
    np.testing.assert_allclose(
        turn @ turn.transpose(0, 2, 1), np.eye(3)[None].repeat(40, 0), atol=1e-9
    )
