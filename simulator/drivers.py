"""The two sources of a data set: own traffic, and the trajectories of real label files."""

import numpy as np

from kitti.sequence import KittiSequence
from simulator.config import VehicleMix
from simulator.drives.drive import DriveWorld, drive
from simulator.drives.replay import Replay, replay
from simulator.plan import Builder, Plan


def _from_labels(plan: Plan, seq: int) -> Replay:
    sequence = KittiSequence(plan.spec["from_labels"], seq)
    return replay(sequence, np.random.default_rng((plan.seed, seq, 2**20)))


def _own_traffic(plan: Plan, seq: int) -> DriveWorld:
    mix = VehicleMix.with_vans(plan.spec.get("van_share"))
    return drive(plan.frames[seq], np.random.default_rng((plan.seed, seq, 2**21)), mix)


DRIVERS: dict[str, Builder] = {"labels": _from_labels, "traffic": _own_traffic}
