"""A calibration for scans that come without one: KITTI's car, mounted without any rotation."""

from __future__ import annotations

import numpy as np

from kitti.calibration import LEVEL_FROM_CAMERA, Calibration


def standard_mounting() -> Calibration:
    """The Velodyne upright, x ahead, 1.73 m above the ground; the camera 0.27 m in front of it.

    Lever arm: Geiger et al., IJRR 2013, figure 3. Lens of the left colour camera: the nominal
    values of KITTI's first recording day (1242 x 375 pixels); they only say which part of the
    scan is looked at.
    """
    lever_arm = np.array([[-0.004], [-0.076], [-0.272]])  # metres, camera frame
    return Calibration(
        p2=np.array(
            [[721.5377, 0, 609.5593, 44.86], [0, 721.5377, 172.854, 0.2164], [0, 0, 1, 0.003]]
        ),
        r0_rect=np.eye(3),
        tr_velo_to_cam=np.hstack([LEVEL_FROM_CAMERA.T, lever_arm]),
    )
