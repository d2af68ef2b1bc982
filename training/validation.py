"""Validation of a training over its data roots."""

from pathlib import Path

import numpy as np

from training.sampling.pipeline import dataset
from training.training_run import TrainingRun


def validate(run: TrainingRun) -> dict[str, float]:
    """Validation metrics: means over data roots, and with several roots those of each."""
    by_root: dict[str, list[int]] = {}
    for index, root in enumerate(run.task.validation_samples.roots):
        by_root.setdefault(root, []).append(index)
    found = {root: _validate_items(run, np.array(items)) for root, items in by_root.items()}
    if len(found) <= 1:
        return next(iter(found.values()), {})
    names = dict.fromkeys(name for metrics in found.values() for name in metrics)
    means = {
        name: float(np.mean([metrics[name] for metrics in found.values() if name in metrics]))
        for name in names
    }
    short = [Path(root).name for root in found]
    return means | {
        f"{Path(root).name if short.count(Path(root).name) == 1 else root}/{name}": value
        for root, metrics in found.items()
        for name, value in metrics.items()
    }


def _validate_items(run: TrainingRun, items: np.ndarray) -> dict[str, float]:
    """Metrics over `schedule.validation_frames` of the items, spread evenly over them."""
    task, wanted = run.task, run.task.schedule.validation_frames
    count = min(wanted or len(items), len(items))
    chosen = items[np.linspace(0, len(items) - 1, count).round().astype(np.int64)]
    size = max(n for n in range(1, 5) if count % n == 0)  # one shape of batch, no frame left out
    chosen = chosen.reshape(-1, size)
    data = dataset(
        run.make_validation_sample, task.prepare, lambda: zip(chosen, chosen, strict=True), size
    )
    step = run.validation_step
    return task.validate(
        (rows, batch, step(batch)) for rows, batch in zip(chosen, data, strict=True)
    )
