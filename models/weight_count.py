"""Number of weights of a network from its configuration alone, checked before it is built."""

from collections.abc import Sequence

from common.errors import InputError
from models.boxes.box_coding import head_channels
from models.checkpoint import MAX_BYTES
from models.config import DetectorConfig, SetUpconvConfig, TrackerConfig

XYZ = 3
NORM = 4  # variables of BatchNorm for each channel
MAX_WEIGHTS = MAX_BYTES // 12
"""float32 weights with Adam's two moments, in a checkpoint that can be read again."""


def check_detector(config: DetectorConfig, features: int) -> None:
    """Raises InputError unless the detector has at most `MAX_WEIGHTS`.

    features: of an input point beside its coordinates.
    """
    _check("detector", detector_weights(config, features))


def check_tracker(config: TrackerConfig, features: int) -> None:
    """Raises InputError unless the tracker has at most `MAX_WEIGHTS`; features: of a kept point."""
    _check("tracker", tracker_weights(config, features))


def _check(name: str, count: int) -> None:
    if count > MAX_WEIGHTS:
        raise InputError(
            f"widths of the {name}: expected at most {MAX_WEIGHTS} weights, not {count}"
        )


def detector_weights(config: DetectorConfig, features: int) -> int:
    """Weights of a `Detector`, moving averages included."""
    total, channels, skips = 0, features, [features]
    for layer in config.set_abstraction:
        total += _chain(channels + XYZ, layer.widths)
        channels = layer.widths[-1]
        skips.append(channels)
    for layer, skip in zip(config.set_upconv, skips[-2:0:-1], strict=True):
        total += _upconv(channels, skip, layer)
        channels = layer.widths[-1]
    total += _chain(channels + features, config.propagation_widths)
    return total + _head(config.propagation_widths[-1], config.fc1_width, head_channels(config.box))


def tracker_weights(config: TrackerConfig, features: int) -> int:
    """Weights of a `TrackingNetwork`, moving averages included."""
    sa1, sa2 = (layer.widths for layer in config.set_abstraction)
    total = _chain(features + XYZ, sa1) + _chain(sa1[-1] + XYZ, sa2)
    channels = sa2[-1]
    if config.fusion != "none":
        edges = {"concat": 0, "elementwise_product": channels}.get(config.fusion, 1)
        both = config.fusion_keeps_features or config.fusion == "concat"
        inputs = (2 * channels if both else 0) + XYZ + edges
        total += _chain(inputs, config.association_widths)
        channels = config.association_widths[-1]
    sa3, (fp1, fp2) = config.refinement_abstraction.widths, config.refinement_upconv
    total += _chain(channels + XYZ, sa3)
    total += _upconv(sa3[-1], channels, fp1) + _upconv(fp1.widths[-1], sa1[-1], fp2)
    total += _chain(fp2.widths[-1], config.propagation_widths)
    return total + _head(config.propagation_widths[-1], config.fc1_width, XYZ)


def _chain(channels: int, widths: Sequence[int]) -> int:
    """Linear - BatchNorm of each width."""
    inputs = (channels, *widths[:-1])
    return sum((a + NORM) * b for a, b in zip(inputs, widths, strict=True))


def _upconv(channels: int, skip: int, layer: SetUpconvConfig) -> int:
    *widths, last = layer.widths
    return _chain(channels + XYZ, widths) + _chain(widths[-1] + skip, (last,))


def _head(channels: int, width: int, outputs: int) -> int:
    """FC1 and FC2."""
    return _chain(channels, (width,)) + (width + 1) * outputs
