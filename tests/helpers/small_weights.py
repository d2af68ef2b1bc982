"""A folder of weights of two very small untrained networks."""

from pathlib import Path


def write_weights(folder: Path, seed: int = 0) -> Path:
    """Writes detector.npz and tracker.npz; returns the folder. Imports TensorFlow."""
    import keras

    from common.config import to_dict
    from helpers.network_cases import SMALL_DETECTOR, SMALL_TRACKER
    from models import checkpoint
    from models.detector import Detector
    from models.tracker import TrackingNetwork
    from models.weights import network_hash
    from training.config import DetectorTrainingConfig, TrackerTrainingConfig

    keras.utils.set_random_seed(seed)
    detector = Detector(SMALL_DETECTOR)
    bias = detector.fc2.bias.numpy()
    bias[:2] = -3.0, 3.0  # every point counts as foreground, and neighbours agree on their box,
    bias[[5, 29]] = 3.0  # by heading bin and size template 0, so that there are boxes,
    bias[31:34] = 2.0  # which are three times as large, so that they overlap and score well
    detector.fc2.bias.assign(bias)
    detector.fc2.kernel.assign(0.05 * detector.fc2.kernel.numpy())
    tracker = TrackingNetwork(SMALL_DETECTOR, SMALL_TRACKER)
    meta = {
        "kind": "detector",
        "network": to_dict(SMALL_DETECTOR),
        "config": to_dict(DetectorTrainingConfig(SMALL_DETECTOR)),
    }
    checkpoint.save(folder / "detector.npz", meta, model=checkpoint.named_variables(detector))
    meta = {
        "kind": "tracker",
        "network": to_dict(SMALL_TRACKER),
        "config": to_dict(TrackerTrainingConfig(SMALL_TRACKER)),
        "detector_sha256": network_hash(detector),
    }
    checkpoint.save(folder / "tracker.npz", meta, model=checkpoint.named_variables(tracker))
    return folder
