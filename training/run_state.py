"""Saves and resumes a training: its workdir, its checkpoints, its best network."""

import math
from pathlib import Path

from common.config import to_dict
from common.errors import InputError
from common.notes import note
from models import checkpoint
from training.checkpoint_folder import CheckpointFolder
from training.logs import History
from training.training_run import TrainingRun

OF_A_PART = ("command", "time_utc", "git_commit", "machine", "versions")
"""Of the record of a training, what each of its parts has: the first, and those resumed."""


def prepare_workdir(workdir: Path, resume: bool) -> None:
    """Refuses a used workdir without --resume, and --resume of an unused one."""
    used = (workdir / "config.json").exists()
    if used and not resume:
        raise InputError("holds a training already: give --resume or another --workdir", workdir)
    if resume and not used:
        raise InputError("nothing to resume here: expected config.json", workdir)


def _meta(run: TrainingRun, metrics: dict[str, float]) -> dict:
    task = run.task
    return {
        "kind": task.kind,
        "config": to_dict(task.config),
        "metrics": metrics,
        "record": run.started,
        **task.meta,
    }


def save_checkpoint(
    run: TrainingRun, folder: CheckpointFolder, step: int, metrics: dict[str, float]
) -> None:
    """Writes the checkpoint of a step."""
    folder.save(step, _meta(run, metrics), **run.groups)


def keep_best(run: TrainingRun, folder: CheckpointFolder, history: History, metrics) -> None:
    """Writes best.npz if the metrics of the last epoch are the best so far.

    As long as nothing that was validated defines the metric that selects, the last network is kept.
    """
    if not run.task.validation_samples.items:
        return
    name = run.task.best_metric
    largest = max if run.task.best_is_largest else min
    seen = [row[name] for row in history.rows if math.isfinite(row.get(name, math.nan))]
    if name in metrics:
        best = metrics[name] == largest(seen)
    else:
        note(f"{name} is undefined on the validation frames and does not select best.npz")
        best = not seen
    if best:
        meta = {**_meta(run, metrics), "step": metrics["step"]}
        checkpoint.save(folder.best_path, meta, **run.networks)


def resume_run(run: TrainingRun, folder: CheckpointFolder) -> int:
    """Restores the last checkpoint of the folder; 0 if none was written yet.

    The record of the training stays that of its start; this command is added to it as "resumed".

    Raises:
        InputError: it is no training's checkpoint, or one of another configuration or other data.
    """
    steps = folder.steps()
    if not steps:
        return 0
    path = folder.path(steps[-1])
    meta, arrays = checkpoint.load(path)
    record = meta.get("record")
    if not isinstance(record, dict) or meta.get("step") != steps[-1]:
        raise InputError("not a training's checkpoint: expected its record and step", path)
    if meta["config"] != to_dict(run.task.config):
        changed = _changes(meta["config"], to_dict(run.task.config))
        raise InputError(f"was made with another configuration: {changed}", path)
    for name, value in run.task.meta.items():
        if meta.get(name) != value:
            raise InputError(f"was made with another {name}: {meta.get(name)} -> {value}", path)
    try:
        before, resumed = _sampled(record), [*record.get("resumed", ())]
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError("not a training's checkpoint: broken record of its data", path) from error
    for name, sequences in _sampled(run.started).items():
        if before[name] != sequences:
            raise InputError(f"was made with other {name}", path)
    with run.strategy.scope():
        checkpoint.restore(path, arrays, **run.groups)
    part = {name: run.started[name] for name in OF_A_PART}
    run.started = {**record, "resumed": [*resumed, {"step": steps[-1], **part}]}
    return steps[-1]


def _sampled(record: dict) -> dict[str, list]:
    """Numbers of the sequences and the shares of a record; roots may differ."""
    data = record.get("data") or {}
    pools = ((pool["share"], pool["sequences"]) for pool in data.get("shares", ()))
    return {
        "training sequences": _numbers(data.get("training", ())),
        "shares": [(share, _numbers(sequences)) for share, sequences in pools],
        "validation sequences": _numbers(data.get("validation", ())),
    }


def _numbers(sequences) -> list[str]:
    return [Path(sequence).name for sequence in sequences]


def _changes(old: dict, new: dict, prefix: str = "") -> str:
    found = []
    for key in sorted(set(old) | set(new)):
        a, b = old.get(key), new.get(key)
        if isinstance(a, dict) and isinstance(b, dict):
            found.append(_changes(a, b, f"{prefix}{key}."))
        elif a != b:
            found.append(f"{prefix}{key} {a!r} -> {b!r}")
    return ", ".join(text for text in found if text)
