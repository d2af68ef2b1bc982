"""Table II: computation time over N and N', and the detector against a plain Keras version.

    python -m experiments.table2 --out results/table2

All times are measured in one process, ours and the plain version alternating; medians of --repeats.
Scans are simulated; the stream runs the networks of --weights, to decode as many boxes as in use.
A step of training is timed with the input pipeline and with one batch repeated: the difference is
the cost of the pipeline. Its rate alone is that of batches which nobody trains on. Prints a table;
writes table2.json and table2.md.
"""

import dataclasses
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np

from common.flags import ArgumentParser, positive_int, run
from common.markdown import cell, markdown
from common.progress import Progress
from common.provenance import ROOT
from experiments.runs import write
from experiments.timing.pipeline_rates import TIMES, pipeline_rates
from kitti.scans.point_arrays import sample_points
from kitti.sequence import KittiSequence
from tf_ops.bench.timing import in_turns, seconds_when_warm

PAPER = {  # (N, N'): seconds; Table II, GTX 1080 Ti
    (15000, 5000): 0.099,
    (15000, 1000): 0.086,
    (15000, 500): 0.085,
    (10000, 5000): 0.074,
    (10000, 1000): 0.060,
    (10000, 500): 0.059,
    (5000, 5000): 0.048,
    (5000, 1000): 0.037,
    (5000, 500): 0.036,
}
ALL_POINTS = (20000, 5000)  # what inference takes of a scan of KITTI, beside the paper's settings


def median_seconds(call: Callable[[], object], repeats: int) -> float:
    """Median wall time of `call`, waiting for the device, after one call to warm up."""
    import tensorflow as tf

    call()
    tf.test.experimental.sync_devices()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        tf.test.experimental.sync_devices()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def simulate(folder: Path, count: int) -> KittiSequence:
    """A sequence of the simulator's own traffic, written to `folder`."""
    from simulator.__main__ import main as run_simulator

    flags = ["--split", "val", "--sequences", "1", "--frames", str(count), "--seed", "0"]
    run_simulator(["--out", str(folder), *flags])
    (labels,) = (folder / "training" / "label_02").glob("*.txt")
    return KittiSequence(folder, int(labels.stem))


def matmul_rate(repeats: int) -> float:
    """Floating-point operations a second of a large float32 matrix product."""
    import tensorflow as tf

    a = tf.random.normal([2048, 2048])
    return 2 * 2048**3 / median_seconds(lambda: tf.matmul(a, a).numpy(), repeats)


def detector_times(config, scans: list[np.ndarray], repeats: int) -> dict[str, float]:
    """Seconds a frame, forward and forward with backward, ours and plain, batch of 8."""
    import tensorflow as tf

    from experiments.timing.costs import detector_costs, total
    from experiments.timing.plain_detector import PlainDetector
    from models.detector import Detector, detector_inputs

    batch = 8
    rng = np.random.default_rng(0)
    chosen = [scans[i % len(scans)] for i in range(batch)]
    xyz = np.stack([p[sample_points(p, config.num_points, rng)] for p in chosen])
    make_inputs = tf.function(lambda x: detector_inputs(x, config), jit_compile=False)
    inputs = make_inputs(xyz)
    times = {"index pyramid": median_seconds(lambda: make_inputs(xyz), repeats) / batch}
    detector, plain = Detector(config), PlainDetector(config)
    heads = {
        "ours": (detector, lambda x, training: detector(x, training=training).fc2),
        "plain": (plain, lambda x, training: plain(x, training=training)),
    }
    calls = {}
    for name, (model, head) in heads.items():
        forward = tf.function(lambda x, head=head: head(x, False), jit_compile=False)

        @tf.function(jit_compile=False)
        def both(x, model=model, head=head):
            with tf.GradientTape() as tape:
                loss = tf.reduce_mean(tf.square(head(x, True)))
            return tape.gradient(loss, model.trainable_variables)

        calls[f"{name} forward"] = lambda f=forward: f(inputs)
        calls[f"{name} forward and backward"] = lambda f=both: f(inputs)
    timers = [partial(seconds_when_warm, call) for call in calls.values()]
    found = in_turns(timers, repeats + 1)[1:]  # the first round traces
    times |= dict(zip(calls, np.median(found, axis=0) / batch, strict=True))
    rate = matmul_rate(repeats)
    operations = total(detector_costs(config)).flops
    times["matrix product rate (GFLOP/s)"] = rate / 1e9
    times["plain detector's linear layers (GFLOP a frame)"] = operations / 1e9
    times["share of the matrix product rate, ours forward"] = (
        operations / times["ours forward"] / rate
    )
    return times


def training_times(config, sequence: KittiSequence, repeats: int) -> dict[str, float]:
    """Seconds a frame of training in batches of 4, with the input pipeline and without it."""
    from experiments.timing.training_step import training_steps
    from training.config import DetectorTrainingConfig, ScheduleConfig
    from training.detector_task import DetectorTask

    schedule = ScheduleConfig(batch_size=4)
    training = DetectorTrainingConfig(detector=config, schedule=schedule)
    task = DetectorTask(training, [sequence] * TIMES, [])
    again, piped = training_steps(task, repeats + 4)
    return {
        "step of training, one batch again": median_seconds(again, repeats) / schedule.batch_size,
        "step of training, input pipeline included": (
            median_seconds(piped, repeats) / schedule.batch_size
        ),
    }


def seconds_to_first_boxes(scan: Path, weights: Path, repeats: int) -> float:
    """Median seconds of a new process from its start to the tracks of its first scan."""
    code = (
        "import sys\n"
        "from kitti.scans.scan_files import read_scan\n"
        "from pointtracknet import Tracker\n"
        "Tracker.load(sys.argv[1]).update(read_scan(sys.argv[2]))"
    )
    command = [sys.executable, "-c", code, str(weights.resolve()), str(scan)]

    def process():
        subprocess.run(command, cwd=ROOT, stderr=subprocess.DEVNULL, check=True)

    return median_seconds(process, repeats)


def resized(networks, num_points: int, num_kept_points: int):
    """The networks with other N and N', on which no weight depends."""
    from models.detector import Detector
    from models.tracker import TrackingNetwork

    detector, tracker, _ = networks
    config = dataclasses.replace(detector.config, num_points=num_points)
    track = dataclasses.replace(tracker.config, num_kept_points=num_kept_points)
    others = Detector(config), TrackingNetwork(config, track)
    for other, network in zip(others, (detector, tracker), strict=True):
        other.set_weights(network.get_weights())
    return others


def stream_times(networks, scans, settings, repeats: int) -> dict[tuple[int, int], float]:
    """Seconds for a new frame of a stream, detector, tracker and Algorithm 1, over (N, N')."""
    from evaluation.detections import NetworkStream
    from models.inference import StreamingNetwork
    from tracking import make_tracker, track_frame

    times = {}
    with Progress(len(settings), "N, N'", "setting") as bar:
        for n, kept in settings:
            network = StreamingNetwork(*resized(networks, n, kept), max_points=n)
            tracker, stream, frame = make_tracker("pointtracknet"), NetworkStream(network), count()
            stream.detect(scans[0], next(frame))

            def step(tracker=tracker, stream=stream, frame=frame):
                t = next(frame)
                track_frame(tracker, stream.detect(scans[t % len(scans)], t))

            times[n, kept] = median_seconds(step, repeats)
            bar.update()
    return times


def table(
    detector: dict[str, float],
    rates: list[dict[str, float]],
    stream: dict[tuple[int, int], float],
    device: str,
) -> str:
    """The tables as Markdown."""
    measured = [(name, f"{value:.3f}") for name, value in detector.items()]
    paper = {key: f"{seconds:.3f}" for key, seconds in PAPER.items()}
    rows = [(n, k, f"{s:.3f}", paper.get((n, k), "-")) for (n, k), s in stream.items()]
    columns = ["cores", "workers", "detector samples a second", "tracker pairs a second"]
    lines = [[cell(value, 1) for value in row.values()] for row in rates]
    return (
        f"{device}\n\n"
        + markdown(["measured", "seconds a frame"], measured)
        + "\n"
        + markdown(columns, lines)
        + "\n"
        + markdown(["N", "N'", "ours (s)", "paper, GTX 1080 Ti (s)"], rows)
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Measures, prints, writes."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeats", type=positive_int, default=7, help="calls per median")
    parser.add_argument("--weights", type=Path, default=Path("weights"), metavar="DIR")
    parser.add_argument("--out", type=Path, default=Path("results/table2"))
    flags = parser.parse_args(argv)
    from models.weights import load_networks
    from tf_ops.devices import describe_device

    device = describe_device()
    networks = load_networks(flags.weights)
    config = networks[0].config
    with tempfile.TemporaryDirectory() as folder:
        sequence = simulate(Path(folder), 8)
        scans = [sequence.read_points_level(t)[:, :3] for t in (0, 1)]
        detector = detector_times(config, scans, flags.repeats)
        detector |= training_times(config, sequence, flags.repeats)
        name = "import to first boxes of pointtracknet.Tracker (s)"
        detector[name] = seconds_to_first_boxes(sequence.scan_path(0), flags.weights, flags.repeats)
        stream = stream_times(networks, scans, (ALL_POINTS, *PAPER), flags.repeats)
        rates = pipeline_rates(networks, sequence)  # last: its workers end late
    metrics = {
        "device": device,
        "detector": detector,
        "samples a second out of the input pipeline": rates,
        "stream": [{"N": n, "N'": k, "seconds": s} for (n, k), s in stream.items()],
    }
    details = {"config": {"repeats": flags.repeats}}
    write(
        flags.out, "table2", "Table II", table(detector, rates, stream, device), metrics, **details
    )


if __name__ == "__main__":
    raise SystemExit(run(main))
