"""Flags, smoke run and call of the loop, shared by train_det.py and train_track.py."""

import argparse
import dataclasses
import os
import sys
from pathlib import Path

from common.config_flags import add_flags, from_flags
from common.errors import InputError
from common.flags import ArgumentParser, non_negative_int
from common.notes import note
from training.sampling.data import TrainingData, add_data_flags, check_objects, open_data

STRATEGIES = ("one", "mirrored", "multiworker")
MAX_WORKERS = 256
ONLY = {
    "detector": ("pasted_objects",),
    "tracker": ("single_scan_pairs", "hidden_vehicles"),
}
"""Augmentations of one of the two trainings alone."""
BYTES_PER_POINT = 2000
"""Memory of a training step, at least: the paper's detector has 640 float32 features of a point."""


def parser(description: str, config) -> ArgumentParser:
    """Flags of both scripts, and one for each field of the configuration."""
    result = ArgumentParser(description=description)
    add = result.add_argument
    add_data_flags(result)
    add("--workdir", required=True, metavar="DIR", help="folder for checkpoints, history and logs")
    add("--resume", action="store_true", help="continue the training in --workdir")
    add("--init", metavar="CHECKPOINT", help="start from the network in this checkpoint")
    add("--strategy", default="one", choices=STRATEGIES, help="of tf.distribute")
    add(
        "--workers",
        type=_workers,
        default=0,
        help="processes that make samples, for machines with a GPU; 0: threads of this process",
    )
    add("--deterministic", action="store_true", help="bitwise reproducible runs")
    add("--smoke", action="store_true", help="short test run: a few steps on little data")
    add_flags(result, config)
    return result


def _workers(text: str) -> int:
    value = non_negative_int(text)
    if value > MAX_WORKERS:
        raise argparse.ArgumentTypeError(f"expected 0 to {MAX_WORKERS} processes, found {value}")
    return value


def configured(flags, config):
    """The configuration given by the flags; --smoke shortens it.

    Raises:
        InputError: a value that a field does not allow, or that has no effect.
    """
    config = from_flags(config, flags)
    if not flags.resume:  # of a training that was begun, nothing may change
        _check_effects(config)
    if flags.smoke:
        schedule = dataclasses.replace(
            config.schedule,
            epochs=1,
            frames_per_epoch=3 * config.schedule.batch_size,
            validation_frames=2,
        )
        config = dataclasses.replace(config, schedule=schedule)
    return config


def _check_effects(config) -> None:
    """Refuses values other than the default where nothing uses them."""
    kind = "detector" if hasattr(config, "detector") else "tracker"
    other = "tracker" if kind == "detector" else "detector"
    for name in ONLY[other]:
        default = getattr(type(config.augmentation)(), name)
        if getattr(config.augmentation, name) != default:
            raise InputError(
                f"--augmentation.{name}: has no effect on the {kind}, expected {default}"
            )
    if kind == "tracker" and not config.tracker.fusion_keeps_features:
        fusion = config.tracker.fusion
        if fusion in ("concat", "none"):
            expected = f"has no effect with --tracker.fusion {fusion}, expected true"
            raise InputError(f"--tracker.fusion_keeps_features: {expected}")


def train(flags, make_task, config, picture=None) -> int:
    """Runs a training by its flags; returns the exit code (1 if it diverged).

    picture: task -> matplotlib figure, logged after each epoch.
    """
    import tensorflow as tf

    from tf_ops.devices import describe_device
    from training.checkpoint_folder import CHECKPOINTS, CheckpointFolder
    from training.loop import TrainingDivergedError, run_training
    from training.run_state import prepare_workdir
    from training.strategies import make_strategy, seed_everything
    from training.training_run import start

    workdir = Path(flags.workdir)
    if flags.strategy != "multiworker":  # there the chief alone looks at it
        prepare_workdir(workdir, flags.resume)
    print(describe_device(), flush=True)
    strategy = make_strategy(flags.strategy)
    seed_everything(config.schedule.seed, flags.deterministic)
    data = open_data(flags)
    run = start(
        lambda: make_task(config, data.training, data.validation),
        strategy,
        workdir,
        {**data.record(), "init": flags.init},
        data.pools,
        flags.workers,
        picture,
    )
    check_objects(data, run.task.samples.classes)
    note_best(data, run.task)
    replicas = strategy.num_replicas_in_sync
    check_memory(config.schedule.batch_size // replicas, run.task.samples.num_points)
    if flags.init and not CheckpointFolder(workdir / CHECKPOINTS).steps():
        with strategy.scope():
            start_from(flags.init, run)
    try:
        run_training(run, flags.resume)
    except KeyboardInterrupt:
        steps = CheckpointFolder(workdir / CHECKPOINTS).steps()
        note(f"--resume goes on from step {steps[-1] if steps else 0}")
        raise
    except TrainingDivergedError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except tf.errors.ResourceExhaustedError as error:
        raise InputError("out of memory: choose a smaller --schedule.batch_size") from error
    finally:
        run.close()
    return 0


def note_best(data: TrainingData, task) -> None:
    """Notes that nothing will select best.npz, where the validation sequences have no sample."""
    if data.validation and not task.validation_samples.items:
        note("the validation sequences have no adjacent scans: there will be no best.npz")


def check_memory(batch: int, points: int) -> None:
    """Refuses a batch of scans whose features cannot fit into this machine's memory."""
    needed = batch * points * BYTES_PER_POINT
    there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if needed > there:
        raise InputError(
            f"--schedule.batch_size: {batch} samples of {points} points need at least "
            f"{needed / 2**30:.0f} GiB, this machine has {there / 2**30:.0f} GiB"
        )


def start_from(path: str, run) -> None:
    """Assigns the network of a checkpoint, and the auxiliary variables if it has them."""
    from models import checkpoint

    _, arrays = checkpoint.load(path, run.task.kind)
    groups = run.networks
    if not any(name.startswith("auxiliary/") for name in arrays):
        del groups["auxiliary"]
    checkpoint.restore(path, arrays, **groups)
