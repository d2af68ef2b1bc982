"""The roadside: facades, walls, fences, hedges, trees, poles, signs, bins.

Objects are placed along a path, layer by layer outwards; each at the first offset at which its
footprint is free.
"""

from dataclasses import dataclass

import numpy as np

from simulator.world.grid import Grid, rectangle_points
from simulator.world.static import StaticWorld
from simulator.world.terrain import Terrain


@dataclass(frozen=True)
class Setting:
    """Shares and spacings (metres) of a neighbourhood's objects, chosen by hand to resemble
    KITTI's city, residential and road scenes."""

    facade: float = 0.4  # share of the building line that is built on
    facade_offset: tuple[float, float] = (4.0, 14.0)  # from the kerb
    facade_height: tuple[float, float] = (5.0, 14.0)
    fence: float = 0.5  # share of plots with a wall, fence or hedge towards the road
    tree_spacing: float = 18.0
    pole_spacing: float = 22.0
    bin_spacing: float = 45.0
    backdrop: float = 0.85  # share of the horizon closed by houses and woods


SETTINGS = {
    "city": Setting(0.9, (2.5, 5.0), (8.0, 18.0), 0.3, 16.0, 15.0, 25.0, 0.97),
    "residential": Setting(0.75, (3.0, 8.0), (5.0, 10.0), 0.9, 9.0, 20.0, 25.0, 0.97),
    "road": Setting(0.2, (6.0, 20.0), (4.0, 9.0), 0.7, 7.0, 28.0, 60.0, 0.9),
}


@dataclass(frozen=True)
class Site:
    """A static world under construction; `taken` is a bool grid of occupied ground."""

    world: StaticWorld
    terrain: Terrain
    taken: Grid

    def place(self, center, yaw, length, width) -> bool:
        """Occupies a rectangle if it is free; returns whether it was."""
        ahead = np.array([np.cos(yaw), np.sin(yaw)]) * length / 2
        if self.taken.at(np.stack([center, center + ahead, center - ahead])).any():
            return False  # quick rejection of most attempts
        points = rectangle_points(center, yaw, length, width)
        if self.taken.at(points).any():
            return False
        self.taken.mark(points)
        return True

    def ground(self, center) -> float:
        """Height of the ground at a point."""
        return float(self.terrain.height(np.asarray(center)[None])[0])


def furnish(site: Site, path, kerb: float, setting: Setting, rng) -> None:
    """Lines both sides of `path` (n, 2), points a metre apart, `kerb` metres from it."""
    heading = np.gradient(path, axis=0)
    heading /= np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-9)
    for side in (1.0, -1.0):
        line = Line(path, heading, side, kerb)
        _street_furniture(site, line, setting, rng)
        _front_gardens(site, line, setting, rng)
        _facades(site, line, setting, rng)
        for offset in (13.0, 20.0, 30.0, 42.0, 55.0):
            _backdrop(site, line, offset, setting.backdrop, rng)


@dataclass(frozen=True)
class Line:
    """One side of a path: `side` is 1 on the left."""

    path: np.ndarray
    heading: np.ndarray
    side: float
    kerb: float

    def __len__(self) -> int:
        return len(self.path)

    def spot(self, s: float, offset: float) -> tuple[np.ndarray, float]:
        """Point and yaw `offset` metres beyond the kerb at arc length `s`."""
        index = min(int(s), len(self.path) - 1)
        ahead = self.heading[index]
        across = self.side * np.array([-ahead[1], ahead[0]])
        yaw = float(np.arctan2(ahead[1], ahead[0]))
        return self.path[index] + across * (self.kerb + offset), yaw


def _street_furniture(site: Site, line: Line, setting: Setting, rng) -> None:
    s = rng.uniform(0, setting.pole_spacing)
    while s < len(line):
        center, yaw = line.spot(s, rng.uniform(0.4, 1.2))
        if site.place(center, yaw, 0.4, 0.4):
            _pole(site, center, yaw, rng)
        s += setting.pole_spacing * rng.uniform(0.5, 1.5)
    s = rng.uniform(0, setting.tree_spacing)
    while s < len(line):
        center, yaw = line.spot(s, rng.uniform(0.8, 2.5))
        if site.place(center, yaw, 1.0, 1.0):
            tree(site, center, rng)
        s += setting.tree_spacing * rng.uniform(0.4, 1.6)
    s = rng.uniform(0, setting.bin_spacing)
    while s < len(line):
        center, yaw = line.spot(s, rng.uniform(0.5, 2.5))
        low = site.ground(center)
        if site.place(center, yaw, 0.8, 0.8):
            kind = rng.integers(3)
            if kind == 0:
                site.world.add_box(*center, yaw, 0.6, 0.6, low, low + 1.1, 0.3)
            elif kind == 1:
                site.world.add_box(*center, yaw, 1.2, 0.5, low, low + 1.5, 0.4)
            else:
                site.world.add_ellipsoid(*center, 0.6, low - 0.2, low + 1.1, 0.5, 0.25)
        s += setting.bin_spacing * rng.uniform(0.3, 1.7)


def _pole(site: Site, center, yaw, rng) -> None:
    low = site.ground(center)
    if rng.random() < 0.45:  # sign
        top = low + rng.uniform(2.2, 3.2)
        site.world.add_cylinder(*center, 0.04, low, top, 0.5)
        size = rng.uniform(0.5, 0.8)
        site.world.add_box(*center, yaw + np.pi / 2, size, 0.04, top - size, top, 0.95)
    else:  # lamp
        site.world.add_cylinder(*center, rng.uniform(0.06, 0.14), low, low + 7.0, 0.4)


def tree(site: Site, center, rng) -> None:
    """Adds a trunk and a partly transparent crown."""
    low = site.ground(center)
    height, start = rng.uniform(4.5, 11.0), rng.uniform(1.5, 2.8)
    radius = rng.uniform(1.2, 3.2)
    site.world.add_cylinder(*center, rng.uniform(0.08, 0.25), low, low + start + 0.8, 0.4)
    free_path = rng.uniform(0.5, 1.6)
    site.world.add_ellipsoid(*center, radius, low + start, low + height, 0.5, free_path)


def _front_gardens(site: Site, line: Line, setting: Setting, rng) -> None:
    s = rng.uniform(0, 8)
    while s < len(line):
        length = rng.uniform(5, 18)
        if rng.random() < setting.fence:
            kind = rng.integers(4)
            width = (0.25, 0.1, 0.9, 1.6)[kind]
            for offset in np.arange(rng.uniform(0.8, 3.0), 16.0, 0.8):
                center, yaw = line.spot(s + length / 2, offset)
                if site.place(center, yaw, length, width):
                    _boundary(site, kind, center, yaw, length, width, rng)
                    break
        s += length + (0.2 if rng.random() < 0.75 else rng.uniform(1, 5))


def _boundary(site: Site, kind, center, yaw, length, width, rng) -> None:
    low = site.ground(center) - 0.3
    top = low + 0.3 + rng.uniform(0.8, 2.0)
    if kind == 0:  # wall
        site.world.add_box(*center, yaw, length, width, low, top, rng.uniform(0.25, 0.6))
    elif kind == 1:  # fence: half of the rays pass
        site.world.add_box(*center, yaw, length, width, low, top, 0.4, 0.12)
    else:  # hedge, shrubs
        site.world.add_box(*center, yaw, length, width, low, top, 0.5, rng.uniform(0.1, 0.35))


def _facades(site: Site, line: Line, setting: Setting, rng) -> None:
    s = rng.uniform(0, 10)
    while s < len(line):
        length, depth = rng.uniform(8, 24), rng.uniform(7, 11)
        if rng.random() < setting.facade:
            for offset in np.arange(rng.uniform(*setting.facade_offset), 34.0, 1.3):
                center, yaw = line.spot(s + length / 2, offset + depth / 2)
                if site.place(center, yaw, length, depth):
                    low = site.ground(center)
                    top = low + rng.uniform(*setting.facade_height)
                    color = rng.uniform(0.3, 0.7)
                    _house(site, center, yaw, (length, depth), top, color)
                    break
        s += length + (0.5 if rng.random() < setting.facade else rng.uniform(2, 9))


def _house(site: Site, center, yaw, size, top, color) -> None:
    """Adds a box with windows that reaches into the ground; `size` is its length and depth."""
    low = site.ground(center)
    site.world.add_box(*center, yaw, *size, low - 2, top, color, street=low)


def _backdrop(site: Site, line: Line, offset: float, share: float, rng) -> None:
    """Adds woods and houses in the background, which most rays meet."""
    s = rng.uniform(0, 10)
    while s < len(line):
        length = rng.uniform(6, 16)
        if rng.random() < share:
            center, yaw = line.spot(s, offset + rng.uniform(-4, 4))
            if rng.random() < 0.35:
                if site.place(center, yaw, length, 8.0):
                    low = site.ground(center)
                    top = low + rng.uniform(5, 11)
                    _house(site, center, yaw, (length, 8.0), top, rng.uniform(0.3, 0.7))
            elif site.place(center, yaw, 3.0, 3.0):
                tree(site, center, rng)
                low = site.ground(center)
                site.world.add_ellipsoid(
                    *center, rng.uniform(1.0, 2.2), low - 0.5, low + rng.uniform(1.0, 3.0), 0.5, 0.6
                )
        s += length
