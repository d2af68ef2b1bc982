"""Times of a streamed frame and of a training step, block by block.

    python -m experiments.profile --out results/profile

Each block runs alone on its inputs in the network; medians of --repeats. The table also has the
floor (the block's floating-point operations at the rate of a large float32 matrix product measured
in the same process) and the bytes that its linear layers move; for a training step the floor is
that of three forward passes. Writes profile.md and profile.json.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.flags import ArgumentParser, positive_int, run
from common.markdown import markdown
from experiments.runs import write
from experiments.table2 import matmul_rate, median_seconds, simulate
from kitti.scans.point_arrays import sample_points
from kitti.scans.scan_files import read_scan

HEADER = ("block", "seconds", "floor (s)", "times the floor", "MB moved")


@dataclass(frozen=True)
class Timed:
    """Seconds of a block; operations and bytes of its linear layers, 0 where it has none."""

    seconds: float
    flops: float = 0.0
    bytes: float = 0.0

    def row(self, name: str, rate: float) -> list[Any]:
        """A line of the table."""
        floor = self.flops / rate
        ratio = f"{self.seconds / floor:.2f}" if floor else None
        moved = f"{self.bytes / 1e6:.0f}" if floor else None
        return [name, f"{self.seconds:.4f}", f"{floor:.4f}" if floor else None, ratio, moved]


def detector_blocks(detector, xyz, training: bool) -> dict[str, tuple[Callable, tuple, Any]]:
    """Block -> (function, its inputs as computed by the blocks before, layer)."""

    from models.detector import detector_inputs, point_features
    from models.local_pointnet import Points

    inputs = detector_inputs(xyz, detector.config)
    levels, kind = inputs.level_xyz, detector.config.point_features
    features, blocks = [point_features(levels[0], kind)], {}

    def add(name, layer, call, *arguments):
        blocks[name] = (call, arguments, layer)
        return call(*arguments)

    for i, layer in enumerate(detector.set_abstraction):
        call = lambda *x, layer=layer: layer(*x, training=training)  # noqa: E731
        arguments = (levels[i], features[i], levels[i + 1], inputs.abstraction[i])
        features.append(add(f"SA{i + 1}", layer, call, *arguments))
    x = features[-1]
    for i, layer in enumerate(detector.set_upconv):
        call = lambda *x, layer=layer: layer(*x, training=training)  # noqa: E731
        coarse, fine = Points(levels[-1 - i], x), Points(levels[-2 - i], features[-2 - i])
        x = add(f"FP{i + 1}", layer, call, coarse, fine, inputs.upconv[i])
    layer = detector.feature_propagation
    call = lambda *x: detector.feature_propagation(*x, training=training)  # noqa: E731
    x = add("FP4", layer, call, x, point_features(levels[0], kind), inputs.propagation)
    heads = [detector.fc1, detector.fc2]
    add("FC1, FC2", heads, lambda x: heads[1](heads[0](x, training=training)), x)
    return blocks


def seconds_of(call: Callable, arguments: tuple, repeats: int) -> float:
    """Median time of a block's forward pass, compiled."""
    import tensorflow as tf

    graph = tf.function(call, jit_compile=False)
    return median_seconds(lambda: wait(graph(*arguments)), repeats)


def gradient_seconds(call: Callable, arguments: tuple, layers, repeats: int) -> float:
    """Median time of forward and backward, to the variables and to all float inputs."""
    import tensorflow as tf

    layers = layers if isinstance(layers, list) else [layers]
    variables = [v for layer in layers for v in layer.trainable_variables]

    @tf.function(jit_compile=False)
    def graph(*inputs):
        floats = [x for x in tf.nest.flatten(inputs) if x is not None and x.dtype.is_floating]
        with tf.GradientTape() as tape:
            for x in floats:
                tape.watch(x)
            loss = tf.reduce_sum(call(*inputs))
        gradients = tape.gradient(loss, [*variables, *floats])
        return [g for g in gradients if g is not None]

    return median_seconds(lambda: wait(graph(*arguments)), repeats)


def wait(outputs) -> None:
    """Waits until every output is computed."""
    import tensorflow as tf

    for output in tf.nest.flatten(outputs):
        if output is not None:
            output.numpy()


def profile_stream(networks, paths: list[Path], sequence, repeats: int) -> dict[str, Timed]:
    """The blocks of one new frame of a stream, batch of 1, batch normalisation folded."""
    import tensorflow as tf

    from evaluation.detections import NetworkStream
    from experiments.timing.costs import detector_costs, tracker_costs
    from models.detector import detector_inputs
    from models.inference import StreamingNetwork, detector_pass
    from tracking import make_tracker, track_frame

    detector, tracker, _ = networks
    n = detector.config.num_points
    network = StreamingNetwork(*networks, max_points=n)
    scans = [sequence.read_points_level(t) for t in (0, 1)]
    xyz = tf.constant(network.sample(scans[1], 1))
    rng = np.random.default_rng(0)
    found = {
        "read the scan": Timed(median_seconds(lambda: read_scan(paths[1]), repeats)),
        "read, crop and sample": Timed(
            median_seconds(lambda: sample_points(sequence.read_points_level(1), n, rng), repeats)
        ),
        "indices": Timed(
            seconds_of(lambda x: detector_inputs(x, detector.config), (xyz,), repeats)
        ),
    }
    costs = detector_costs(detector.config)
    for name, (call, arguments, _) in detector_blocks(detector, xyz, False).items():
        found[name] = Timed(seconds_of(call, arguments, repeats), *costs[name])
    least = network.decoding.min_probability
    proposals, probability, _ = detector_pass(detector, least, tracker.fused_features)(xyz)
    outputs = proposals, probability.numpy(), xyz[0].numpy()
    found["decoding"] = Timed(median_seconds(lambda: network.boxes(*outputs), repeats))
    inputs = detector_inputs(xyz, detector.config)
    frame = tracker.fused_features(inputs, detector(inputs))
    states = [network.detect(scan, t) for t, scan in enumerate(scans)]
    previous, current = (state.encoded for state in states)
    association = tracker.associate(previous, current)
    costs = tracker_costs(detector.config, tracker.config)
    for name, call, arguments in (
        ("encode", tracker.encode, (frame,)),
        ("association", tracker.associate, (previous, current)),
        ("refinement", tracker.refine, (previous, association)),
    ):
        found[name] = Timed(seconds_of(call, arguments, repeats), *costs[name])
    stream, matcher = NetworkStream(network), make_tracker("pointtracknet")
    *_, detections = (stream.follow(state, t) for t, state in enumerate(states))
    matching = median_seconds(lambda: track_frame(matcher, detections), repeats)
    found["matching, Algorithm 1"] = Timed(matching)
    whole = median_seconds(lambda: network.detect(scans[1], 1), repeats)
    moved = median_seconds(lambda: network.displacement(*states), repeats)
    found["detector as one graph, with decoding"] = Timed(whole)
    found["association and refinement as one graph"] = Timed(moved)
    return found


def profile_training(detector, scans: list[np.ndarray], batch: int, repeats: int):
    """Forward and backward of the detector's blocks, per frame of a batch; 3 times the forward."""
    from experiments.timing.costs import detector_costs

    rng, count = np.random.default_rng(0), detector.config.num_points
    chosen = [scans[i % len(scans)] for i in range(batch)]
    xyz = np.stack([scan[sample_points(scan, count, rng), :3] for scan in chosen])
    costs = detector_costs(detector.config)
    return {
        name: Timed(
            gradient_seconds(call, arguments, layer, repeats) / batch, *costs[name].times(3)
        )
        for name, (call, arguments, layer) in detector_blocks(detector, xyz, True).items()
    }


def profile_steps(networks, sequence, batch: int, repeats: int) -> dict[str, Timed]:
    """A whole step of both trainings, per frame and per pair: losses and update included.

    The tracker's is two passes of the frozen detector, and its own layers in both directions.
    """
    from experiments.timing.costs import detector_costs, total, tracker_costs
    from experiments.timing.training_step import training_steps
    from training.config import DetectorTrainingConfig, ScheduleConfig, TrackerTrainingConfig
    from training.detector_task import DetectorTask
    from training.tracker_task import TrackerTask

    detector, tracker, _ = networks
    schedule = ScheduleConfig(batch_size=batch)
    training = DetectorTrainingConfig(detector=detector.config, schedule=schedule)
    tracking = TrackerTrainingConfig(tracker=tracker.config, schedule=schedule)
    one = total(detector_costs(detector.config))
    own = total(tracker_costs(detector.config, tracker.config))
    steps = {
        "detector, a frame": (DetectorTask(training, [sequence], []), one.times(3)),
        "tracker, a pair": (
            TrackerTask(tracking, detector, [sequence], []),
            one.times(2).plus(own.times(6)),
        ),
    }
    found = {}
    for name, (task, cost) in steps.items():
        again, _ = training_steps(task, 1)
        found[name] = Timed(median_seconds(again, repeats) / batch, *cost)
    return found


def main(argv: Sequence[str] | None = None) -> None:
    """Measures, prints, writes."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeats", type=positive_int, default=7, help="calls per median")
    parser.add_argument("--batch", type=positive_int, default=4, help="frames of a training step")
    parser.add_argument("--weights", type=Path, default=Path("weights"), metavar="DIR")
    parser.add_argument("--out", type=Path, default=Path("results/profile"), metavar="DIR")
    flags = parser.parse_args(argv)
    from models.detector import Detector
    from models.weights import load_networks

    networks = load_networks(flags.weights)
    rate = matmul_rate(flags.repeats)
    with tempfile.TemporaryDirectory() as folder:
        sequence = simulate(Path(folder), 8)
        scans = [sequence.read_points_level(t) for t in (0, 1)]
        paths = [sequence.scan_path(t) for t in (0, 1)]
        parts = {"streamed frame": profile_stream(networks, paths, sequence, flags.repeats)}
        fresh = Detector(networks[0].config)
        title = f"detector's training step, per frame of {flags.batch}"
        parts[title] = profile_training(fresh, scans, flags.batch, flags.repeats)
        title = f"a whole training step of {flags.batch}"
        parts[title] = profile_steps(networks, sequence, flags.batch, flags.repeats)
    text = f"Float32 matrix product: {rate / 1e9:.0f} GFLOP/s.\n"
    for title, blocks in parts.items():
        rows = [timed.row(name, rate) for name, timed in blocks.items()]
        text += f"\n{title.capitalize()}:\n\n{markdown(HEADER, rows)}"
    values = {title: {n: asdict(t) for n, t in blocks.items()} for title, blocks in parts.items()}
    details = {"config": {"repeats": flags.repeats, "batch": flags.batch}}
    figures = {"rate": rate, "parts": values}
    write(flags.out, "profile", "Time by block", text, figures, **details)


if __name__ == "__main__":
    raise SystemExit(run(main))
