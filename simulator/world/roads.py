"""Roads: a bending main road with lanes and parking strips, crossed by side streets.

Traffic keeps to the right. Offsets across a path are positive to its left. Letters: n points.
"""

from dataclasses import dataclass, field

import numpy as np

LANE = 3.3  # metres; German town streets have 2.75 to 3.5
STRIP = 2.2  # width of a parking strip along the kerb
SIDE_HALF = 3.3  # half width of a side street


@dataclass(frozen=True)
class Stop:
    """A stop line: arc length on the route, junction, and its signal group."""

    s: float
    junction: int
    group: int  # 0 main road, 1 side street


@dataclass
class Route:
    """A path through the network: points (n, 2) a metre apart, its stop lines and its turn."""

    points: np.ndarray
    stops: list[Stop] = field(default_factory=list)
    turn: tuple[float, float] | None = None  # arc lengths between which it turns
    left: bool = False  # turns left: crosses the oncoming lanes

    def __post_init__(self):
        step = np.gradient(self.points, axis=0)
        self.yaw = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
        self.across = np.stack([-np.sin(self.yaw), np.cos(self.yaw)], axis=1)
        self._plain, self._plain_across = self.points.tolist(), self.across.tolist()
        bend = np.abs(np.gradient(self.yaw)) / np.maximum(np.hypot(*step.T), 1e-6)
        comfortable = np.sqrt(2.2 / np.maximum(bend, 1e-4))  # lateral 2.2 m/s^2
        for index in range(len(comfortable) - 2, -1, -1):  # slow down before the bend
            limit = np.sqrt(comfortable[index + 1] ** 2 + 2 * 1.8)
            comfortable[index] = min(comfortable[index], limit)
        self.speed_limit = comfortable

    @property
    def length(self) -> float:
        """Arc length, metres."""
        return float(len(self.points) - 1)

    def at(self, s, offset=0.0) -> np.ndarray:
        """Points (n, 2) at arc lengths `s` (n,), `offset` (n,) or scalar metres to the left."""
        s = np.minimum(np.maximum(s, 0), self.length - 1e-3)
        low = s.astype(int)
        share = (s - low)[:, None]
        point = self.points[low] * (1 - share) + self.points[low + 1] * share
        return point + np.reshape(offset, (-1, 1)) * self.across[low]

    def spot(self, s: float, offset: float = 0.0) -> tuple[float, float]:
        """The point at arc length `s`, `offset` metres to the left."""
        s = min(max(s, 0.0), self.length - 1e-3)
        low = int(s)
        (x0, y0), (x1, y1) = self._plain[low], self._plain[low + 1]
        nx, ny = self._plain_across[low]
        share = s - low
        return x0 + (x1 - x0) * share + offset * nx, y0 + (y1 - y0) * share + offset * ny


@dataclass(frozen=True)
class Network:
    """main (n, 2) centre line; lanes per direction; widths of parking strips (left, right); side
    streets as centre lines (n, 2) with their arc length on the main road; all routes."""

    main: np.ndarray
    lanes: int
    strips: tuple[float, float]
    sides: list[tuple[float, np.ndarray]]
    routes: list[Route]

    @property
    def half_width(self) -> float:
        """Half the width of the driving lanes."""
        return self.lanes * LANE


def even(points) -> np.ndarray:
    """The polyline resampled to a point per metre."""
    step = np.hypot(*np.diff(points, axis=0).T)
    length = np.concatenate([[0], np.cumsum(step)])
    s = np.arange(0, length[-1], 1.0)
    return np.column_stack([np.interp(s, length, points[:, axis]) for axis in (0, 1)])


def beside(points, offset: float) -> np.ndarray:
    """The line `offset` metres to the left of `points`, a point per metre."""
    step = np.gradient(points, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    return even(points + offset * np.column_stack([-step[:, 1], step[:, 0]]))


def make_network(length: float, rng) -> Network:
    """A random network whose main road is `length` metres long and starts along +x."""
    main = _main_road(length, rng)
    lanes = int(rng.choice([1, 1, 2]))
    strips = tuple(float(rng.choice([0.0, STRIP, STRIP, 5.2])) for _ in range(2))
    sides = []
    s = rng.uniform(60, 120)
    while s < len(main) - 40:
        ahead = main[int(s) + 1] - main[int(s)]
        across = np.array([-ahead[1], ahead[0]])
        tilt = rng.uniform(-0.2, 0.2)
        across = across * np.cos(tilt) + ahead * np.sin(tilt)
        reach = np.arange(-95.0, 96.0)
        sides.append((float(s), main[int(s)] + reach[:, None] * across))
        s += rng.uniform(90, 170)
    network = Network(main, lanes, strips, sides, [])
    network.routes.extend(_routes(network))
    return network


def _main_road(length: float, rng) -> np.ndarray:
    steps = int(length)
    knots = np.arange(0, steps + 60, 60)
    curvature = np.interp(
        np.arange(steps), knots, rng.normal(0, 0.004, len(knots)) * (rng.random(len(knots)) < 0.7)
    )
    yaw = np.cumsum(curvature)
    return np.cumsum(np.column_stack([np.cos(yaw), np.sin(yaw)]), axis=0)


def _routes(network: Network) -> list[Route]:
    routes = []
    forward = [beside(network.main, -LANE * (i + 0.5)) for i in range(network.lanes)]
    backward = [beside(network.main[::-1], -LANE * (i + 0.5)) for i in range(network.lanes)]
    for lane in (*forward, *backward):
        routes.append(Route(lane, _stops(network, lane, 0)))
    for junction, (_, side) in enumerate(network.sides):
        for street in (side, side[::-1]):
            lane = beside(street, -SIDE_HALF / 2)
            routes.append(Route(lane, _stops(network, lane, 1, junction)))
            for main in (forward, backward):
                routes += _turns(network, junction, main, lane)
    return routes


def _stops(network: Network, lane, group: int, only: int | None = None) -> list[Stop]:
    stops = []
    for junction, (s, _) in enumerate(network.sides):
        if only is not None and junction != only:
            continue
        center = network.main[int(s)]
        reach = SIDE_HALF + 4.0 if group == 0 else network.half_width + max(network.strips) + 3.0
        place = float(np.argmin(((lane - center) ** 2).sum(axis=1))) - reach
        if place > 5:
            stops.append(Stop(place, junction, group))
    return stops


def _turns(network: Network, junction: int, main: list, side) -> list[Route]:
    """Turns from the main road into this side lane, and from it into the main road."""
    center = network.main[int(network.sides[junction][0])]
    routes = []
    for source, target, group in (
        *((lane, side, 0) for lane in (main[0], main[-1])),
        *((side, lane, 1) for lane in (main[0], main[-1])),
    ):
        near_in = int(np.argmin(((source - center) ** 2).sum(axis=1)))
        near_out = int(np.argmin(((target - center) ** 2).sum(axis=1)))
        wide = network.half_width + 3.0
        reach_in = int(SIDE_HALF + 4 if group == 0 else wide + 2)
        reach_out = int(wide + 2 if group == 0 else SIDE_HALF + 4)
        start, end = near_in - reach_in, near_out + reach_out
        if start < 10 or end > len(target) - 10:
            continue
        into, out = source[start] - source[start - 1], target[end + 1] - target[end]
        left = into[0] * out[1] - into[1] * out[0] > 0
        wanted = (main[0] if left else main[-1]) if len(main) > 1 else main[0]
        if (source if group == 0 else target) is not wanted:
            continue
        bend = _bezier(source[start], into, target[end], out)
        points = even(np.vstack([source[: start + 1], bend[1:-1], target[end:]]))
        stop = _stops(network, source, group, None if group == 0 else junction)
        stop = [s for s in stop if s.s <= start + 1]
        routes.append(Route(points, stop, (start - 2.0, start + len(bend) + 2.0), bool(left)))
    return routes


def _bezier(start, into, end, out) -> np.ndarray:
    handle = 0.5 * np.linalg.norm(end - start)
    a, b = start + into / np.linalg.norm(into) * handle, end - out / np.linalg.norm(out) * handle
    t = np.linspace(0, 1, 40)[:, None]
    curve = (1 - t) ** 3 * start + 3 * (1 - t) ** 2 * t * a + 3 * (1 - t) * t**2 * b + t**3 * end
    return even(np.vstack([curve, end]))
