"""Floating-point operations and memory traffic of the networks' blocks, from their configuration.

The plain form is counted: every linear layer of a neighbourhood runs once per neighbour. Bytes are
those of the float32 inputs and outputs of each linear layer and of its kernel, moved once.
"""

from typing import NamedTuple

from models.boxes.box_coding import head_channels
from models.config import DetectorConfig, SetAbstractionConfig, SetUpconvConfig, TrackerConfig
from models.detector import POINT_FEATURES
from models.tracker import FusedFeatures

FLOAT_BYTES = 4


class Cost(NamedTuple):
    """Of one block for one frame (one pair of frames for association and refinement).

    Attributes:
        flops: floating-point operations of the linear layers, 2 per multiplication.
        bytes: read and written by them.
    """

    flops: float = 0.0
    bytes: float = 0.0

    def plus(self, other: "Cost") -> "Cost":
        """The cost of both."""
        return Cost(self.flops + other.flops, self.bytes + other.bytes)

    def times(self, factor: float) -> "Cost":
        """`factor` times the cost."""
        return Cost(self.flops * factor, self.bytes * factor)


def total(costs: dict[str, Cost]) -> Cost:
    """The sum over blocks."""
    return Cost(*map(sum, zip(*costs.values(), strict=True)))


def linear_cost(rows: int, channels: int, width: int) -> Cost:
    """A linear layer (rows, channels) -> (rows, width)."""
    moved = rows * (channels + width) + channels * width
    return Cost(2.0 * rows * channels * width, float(FLOAT_BYTES * moved))


def mlp_cost(rows: int, channels: int, widths: tuple[int, ...]) -> Cost:
    """A chain of linear layers."""
    cost = Cost()
    for width in widths:
        cost, channels = cost.plus(linear_cost(rows, channels, width)), width
    return cost


def abstraction_cost(layer: SetAbstractionConfig, channels: int) -> Cost:
    """A set abstraction layer on features of `channels`."""
    return mlp_cost(layer.num_points * layer.num_neighbors, channels + 3, layer.widths)


def upconv_cost(layer: SetUpconvConfig, rows: int, channels: int, skip: int) -> Cost:
    """A set upconv layer to `rows` points with a skip connection of `skip` channels."""
    *widths, last = layer.widths
    pooled = mlp_cost(rows * layer.num_neighbors, channels + 3, tuple(widths))
    return pooled.plus(linear_cost(rows, widths[-1] + skip, last))


def detector_costs(config: DetectorConfig) -> dict[str, Cost]:
    """SA1 to SA4, FP1 to FP4 and the heads, for one scan of N points."""
    channels = POINT_FEATURES[config.point_features]
    costs, skips = {}, [channels]
    for i, layer in enumerate(config.set_abstraction, 1):
        costs[f"SA{i}"] = abstraction_cost(layer, channels)
        channels = layer.widths[-1]
        skips.append(channels)
    for i, layer in enumerate(config.set_upconv):
        rows = config.set_abstraction[-2 - i].num_points
        costs[f"FP{i + 1}"] = upconv_cost(layer, rows, channels, skips[-2 - i])
        channels = layer.widths[-1]
    n, widths = config.num_points, config.propagation_widths
    costs["FP4"] = mlp_cost(n, channels + skips[0], widths)
    costs["FC1, FC2"] = mlp_cost(n, widths[-1], (config.fc1_width, head_channels(config.box)))
    return costs


def tracker_costs(detector: DetectorConfig, config: TrackerConfig) -> dict[str, Cost]:
    """Encoding of one frame, association and refinement of one pair."""
    first, second = config.set_abstraction
    channels = FusedFeatures(config).channels(detector)
    fused = {"concat": 0, "elementwise_product": second.widths[-1]}.get(config.fusion, 1)
    single = second.widths[-1] if config.fusion_keeps_features or not fused else 0
    pairs = second.num_points * config.association_neighbors
    fp1, fp2 = config.refinement_upconv
    embedding, sa3 = config.association_widths[-1], config.refinement_abstraction
    widths = (*config.propagation_widths, config.fc1_width, 3)
    refinement = {
        "SA3": abstraction_cost(sa3, embedding),
        "FP1": upconv_cost(fp1, second.num_points, sa3.widths[-1], embedding),
        "FP2": upconv_cost(fp2, first.num_points, fp1.widths[-1], first.widths[-1]),
        "FP3, FC1, FC2": mlp_cost(config.num_kept_points, fp2.widths[-1], widths),
    }
    encode = {
        "SA1": abstraction_cost(first, channels),
        "SA2": abstraction_cost(second, first.widths[-1]),
    }
    return {
        "encode": total(encode),
        "association": mlp_cost(pairs, 2 * single + 3 + fused, config.association_widths),
        "refinement": total(refinement),
    }
