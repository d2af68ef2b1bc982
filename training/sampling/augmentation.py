"""Flip, rotation, scale and height of a whole sample (level frame)."""

from dataclasses import dataclass

import numpy as np

from kitti.boxes import wrap_angle
from training.config import AugmentationConfig


@dataclass(frozen=True)
class SceneTransform:
    """x -> scale * R(yaw) * flip(x) + (0, 0, height): applied alike to points and boxes."""

    flip: bool = False
    yaw: float = 0.0
    scale: float = 1.0
    height: float = 0.0

    @classmethod
    def random(cls, config: AugmentationConfig, rng: np.random.Generator) -> "SceneTransform":
        """Draws a transform."""
        draw = rng.uniform(-1.0, 1.0, 3)
        return cls(
            bool(config.flip and rng.random() < 0.5),
            draw[0] * config.rotation,
            1.0 + draw[1] * config.scale,
            draw[2] * config.height,
        )

    def points(self, xyz: np.ndarray) -> np.ndarray:
        """(n, 3) metres -> (n, 3) float32."""
        x, y, z = np.asarray(xyz, np.float64).T
        y = -y if self.flip else y
        c, s = self.scale * np.cos(self.yaw), self.scale * np.sin(self.yaw)
        moved = (c * x - s * y, s * x + c * y, self.scale * z + self.height)
        return np.stack(moved, -1).astype(np.float32)

    def boxes(self, boxes: np.ndarray) -> np.ndarray:
        """(M, 7) level boxes -> (M, 7)."""
        moved = np.array(boxes, np.float64)
        moved[:, :3] = self.points(boxes[:, :3])
        moved[:, 3:6] *= self.scale
        moved[:, 6] = wrap_angle((-1 if self.flip else 1) * boxes[:, 6] + self.yaw)
        return moved
