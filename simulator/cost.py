"""What a frame costs: `python -m simulator.cost --out DIR` prints seconds against objects and rays.

Scenes are a flat street with a furnished roadside and N cars within 50 m in the camera's view.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from common.files import write_json
from common.flags import ArgumentParser, positive_int, run
from common.provenance import provenance
from simulator.bodies import make_body
from simulator.config import IMAGE_SIZE
from simulator.drive import make_calibration
from simulator.frames import Options, take_sweep
from simulator.grid import Grid
from simulator.roadside import SETTINGS, Site, furnish
from simulator.scan import Scene
from simulator.sizes import draw_size
from simulator.static import StaticWorld
from simulator.terrain import Terrain

OBJECTS = (0, 5, 10, 20, 40)
GROUND = -1.65  # metres, level frame


def street(cars: int, rng) -> Scene:
    """A scene with `cars` cars ahead that do not overlap."""
    low, high = np.array([-100.0, -100.0]), np.array([150.0, 100.0])
    x, y = (p.ravel() for p in np.meshgrid(np.arange(-100, 150, 4.0), np.arange(-100, 100, 4.0)))
    samples = np.column_stack([x, y, np.full(len(x), GROUND)])
    terrain = Terrain(samples, np.ones(len(x)), low, high)
    taken = Grid(low, high, 0.5, bool)
    road = np.column_stack(
        [p.ravel() for p in np.meshgrid(np.arange(-100, 150, 0.3), np.arange(-8, 8, 0.3))]
    )
    terrain.mark_road(road)
    taken.mark(road)
    site = Site(StaticWorld(), terrain, taken)
    path = np.column_stack([np.arange(-95.0, 145.0), np.zeros(240)])
    furnish(site, path, 8.0, SETTINGS["residential"], rng)
    boxes, bodies = [], []
    for index in range(cars):
        size = draw_size("Car", rng)
        row, column = divmod(index, 4)
        spot = [9.0 + 4.2 * row + 2.0 * (column % 2), -6.0 + 4.0 * column]
        boxes.append([*spot, GROUND + size[2] / 2, *size, rng.uniform(-0.1, 0.1)])
        bodies.append(make_body("Car", size, (index,)))
    return Scene(
        np.eye(4), np.array(boxes).reshape(-1, 7), bodies, site.world, terrain
    )  # fmt: skip


def seconds_per_frame(cars: int, full: bool, frames: int) -> tuple[float, int]:
    """Median CPU seconds a frame, and points a frame."""
    rng = np.random.default_rng(0)
    scene, calib = street(cars, rng), make_calibration(rng)
    times, points = [], 0
    for frame in range(frames + 1):
        start = time.process_time()
        result = take_sweep(scene, calib, IMAGE_SIZE, Options(full=full), (0, frame))
        times.append(time.process_time() - start)
        points = len(result.points)
    return float(np.median(times[1:])), points  # the first one makes the table of rays


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the table and writes DIR/cost.json."""
    flags = ArgumentParser(prog="python -m simulator.cost", description=__doc__)
    flags.add_argument("--out", type=Path, required=True, help="folder for cost.json")
    flags.add_argument("--frames", type=positive_int, default=15, help="frames a figure")
    flags = flags.parse_args(argv)
    rows = []
    print("| rays | cars | points | CPU seconds a frame | frames a second and core |")
    print("|---|---|---|---|---|")
    for full in (False, True):
        for cars in OBJECTS:
            seconds, points = seconds_per_frame(cars, full, flags.frames)
            view = "360 degrees, 64 x 2002" if full else "camera view, 48 x 473"
            rows.append({"rays": view, "cars": cars, "points": points, "seconds": seconds})
            print(f"| {view} | {cars} | {points} | {seconds:.3f} | {1 / seconds:.1f} |")
    write_json(flags.out / "cost.json", provenance(rows=rows, frames=flags.frames))
    return 0


if __name__ == "__main__":
    raise SystemExit(run(main))
