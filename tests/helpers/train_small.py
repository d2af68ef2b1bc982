"""A small training in its own process: -m helpers.train_small detector|tracker DATA WORKDIR."""

import argparse
import dataclasses
import os
from pathlib import Path


def main() -> None:
    """Parses the arguments, trains, prints the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("kind")
    parser.add_argument("data")
    parser.add_argument("workdir", type=Path)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--strategy", default="one")
    parser.add_argument("--epochs", type=int, default=3)
    parser.add_argument("--die_after", type=int, help="SIGKILL after this many checkpoints")
    args = parser.parse_args()

    from helpers.network_cases import SMALL_DETECTOR, SMALL_TRACKER
    from kitti.sequence import open_sequences
    from models import checkpoint
    from training import loop
    from training.config import DetectorTrainingConfig, ScheduleConfig, TrackerTrainingConfig
    from training.detector_task import DetectorTask
    from training.strategies import make_strategy, seed_everything
    from training.tracker_task import TrackerTask
    from training.training_run import start

    strategy = make_strategy(args.strategy)
    seed_everything(0, deterministic=True)
    schedule = ScheduleConfig(
        epochs=args.epochs,
        frames_per_epoch=8,
        batch_size=4,
        cycle_epochs=2,
        checkpoint_minutes=0.0,
        validation_frames=2,
    )
    sequences = open_sequences(args.data, [0], "training")

    def task():
        if args.kind == "detector":
            config = DetectorTrainingConfig(SMALL_DETECTOR, schedule=schedule)
            return DetectorTask(config, sequences, sequences)
        from models.detector import Detector

        config = TrackerTrainingConfig(SMALL_TRACKER, schedule=schedule)
        return TrackerTask(config, Detector(SMALL_DETECTOR), sequences, sequences)

    if args.die_after:
        save, count = checkpoint.save, [0]

        def save_then_die(*positional, **named):
            save(*positional, **named)
            count[0] += 1
            if count[0] == args.die_after:
                os.kill(os.getpid(), 9)

        checkpoint.save = save_then_die
    run = start(task, strategy, args.workdir, {})
    figures = loop.run_training(run, args.resume)
    print({k: round(v, 6) for k, v in figures.items()} if figures else dataclasses.asdict(schedule))
    if not run.chief:
        checkpoint.save(args.workdir / "weights.npz", {"config": {}}, **run.networks)


if __name__ == "__main__":
    main()
