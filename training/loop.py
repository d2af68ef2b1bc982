"""The training loop of both networks: one straight loop over steps, under tf.distribute."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import keras
import numpy as np
import tensorflow as tf
from matplotlib.figure import Figure

from common.config import to_dict
from common.errors import InputError
from common.files import write_json
from common.progress import Progress
from common.provenance import provenance
from models import checkpoint
from training.checkpoint_folder import CheckpointFolder
from training.learning_rate import CyclicalLearningRate
from training.logs import History, TensorBoard
from training.sampling.pipeline import Order, dataset, make_order, micro_batches
from training.sampling.workers import SampleWorkers
from training.task import TrainingTask

READ_SECONDS = 1.0
"""Between two readings of the steps' losses, which are checked, summed up and shown."""
Picture = Callable[[TrainingTask], Figure]


class TrainingDivergedError(RuntimeError):
    """The loss is not finite; the last good checkpoint is kept."""


@dataclass
class TrainingRun:
    """A training under way: task, optimizer, strategy, output folder."""

    task: TrainingTask
    optimizer: keras.optimizers.Optimizer
    strategy: tf.distribute.Strategy
    order: Order
    workdir: Path
    chief: bool
    started: dict
    workers: int = 0  # processes that make samples; 0: threads of this process
    picture: Picture | None = None  # drawn after each epoch, for TensorBoard

    def __post_init__(self):
        self.make_sample = self.task.samples
        if self.workers:
            self.make_sample = SampleWorkers(self.task.samples, self.workers)
        self.validation_step = tf.function(self.task.validation_step, jit_compile=False)

    def close(self) -> None:
        """Ends the worker processes, if there are any."""
        if self.workers:
            self.make_sample.close()

    @property
    def networks(self) -> dict[str, checkpoint.Variables]:
        """Groups of a checkpoint without the optimizer's state."""
        model = checkpoint.named_variables(self.task.model)
        return {"model": model, "auxiliary": self.task.auxiliary}

    @property
    def groups(self) -> dict[str, checkpoint.Variables]:
        """Groups of a checkpoint from which a training is resumed."""
        return {**self.networks, "optimizer": self._optimizer_state()}

    def _optimizer_state(self) -> checkpoint.Variables:
        """Adam's variables, its moments named by the path of the variable they belong to."""
        paths = {
            id(v): f"{group}/{name}"
            for group, variables in self.networks.items()
            for name, v in variables.items()
        }
        owners = [paths[id(v)] for v in self.variables]
        moments = self.optimizer.variables[-2 * len(owners) :]
        state = {v.name: v for v in self.optimizer.variables[: -2 * len(owners)]}
        for i, variable in enumerate(moments):
            kind = variable.name.rsplit("_", 1)[-1]
            if kind != ("momentum", "velocity")[i % 2]:
                raise RuntimeError(f"unexpected optimizer variable {variable.path}")
            state[f"{owners[i // 2]}/{kind}"] = variable
        return state

    @property
    def variables(self) -> list[keras.Variable]:
        """Trained variables."""
        return self.task.model.trainable_variables + list(self.task.auxiliary.values())

    @property
    def frozen_from(self) -> int:
        """First step that uses the frozen moving averages of batch normalisation."""
        schedule = self.task.schedule
        steps = schedule.epochs * self.order.steps_per_epoch
        return math.ceil(schedule.frozen_batch_norm_from * steps)


def start(
    make_task,
    strategy: tf.distribute.Strategy,
    workdir: str | Path,
    data: dict,
    pools=(),
    workers: int = 0,
    picture: Picture | None = None,
) -> TrainingRun:
    """Builds task and optimiser under the strategy.

    `data` describes the data for the record; `pools` as in `training.sampling.data`; `workers` is
    the number of processes that make samples; `picture` draws the task after each epoch.
    """
    with strategy.scope():
        task = make_task()
        schedule = task.schedule
        order = _order(task, pools, strategy.num_replicas_in_sync)
        optimizer = keras.optimizers.Adam(
            CyclicalLearningRate(
                schedule.learning_rate_min,
                schedule.learning_rate_max,
                schedule.cycle_epochs * order.steps_per_epoch,
            ),
            beta_1=schedule.beta1,
            beta_2=schedule.beta2,
            epsilon=schedule.epsilon,
        )
    resolver = strategy.cluster_resolver
    chief = (
        resolver is None
        or resolver.task_type is None
        or (resolver.task_type in ("chief", "worker") and resolver.task_id == 0)
    )
    started = provenance(
        config=to_dict(task.config),
        seed=schedule.seed,
        data=data,
        parameters=int(sum(np.prod(v.shape) for v in task.model.trainable_variables)),
    )
    run = TrainingRun(
        task, optimizer, strategy, order, Path(workdir), chief, started, workers, picture
    )
    with strategy.scope():
        optimizer.build(run.variables)
    return run


def _order(task, pools, replicas: int) -> Order:
    schedule = task.schedule
    if schedule.batch_size % replicas:
        raise InputError(f"batch_size {schedule.batch_size} is no multiple of {replicas} replicas")
    return make_order(
        task.samples.items, pools, schedule.frames_per_epoch, schedule.batch_size, schedule.seed
    )


def prepare_workdir(workdir: Path, resume: bool) -> None:
    """Refuses a used workdir without --resume, and --resume of an unused one."""
    used = (workdir / "config.json").exists()
    if used and not resume:
        raise InputError("holds a training already: give --resume or another --workdir", workdir)
    if resume and not used:
        raise InputError("nothing to resume here: expected config.json", workdir)


def run_training(run: TrainingRun, resume: bool = False) -> dict[str, float]:
    """Trains to the configured number of epochs; returns the last epoch's metrics.

    Raises:
        InputError: the workdir is used (or not, with resume), or its checkpoint does not fit.
        TrainingDivergedError: the loss became NaN or infinite.
    """
    workdir, schedule = run.workdir, run.task.schedule
    if run.chief:
        prepare_workdir(workdir, resume)
    folder = CheckpointFolder(workdir / "checkpoints", schedule.keep_checkpoints)
    step = _resume(run, folder) if resume else 0
    if run.chief and not resume:
        write_json(workdir / "config.json", run.started)
    history = History(workdir / "history.csv", step)
    if step >= schedule.epochs * run.order.steps_per_epoch:
        print("nothing left to train: all epochs are done", flush=True)
        return history.rows[-1] if history.rows else {}
    board = TensorBoard(workdir / "tensorboard") if run.chief else None
    per_epoch = run.order.steps_per_epoch
    batches = iter(training_data(run, step, schedule.epochs * per_epoch))
    train_step = compile_train_step(run)
    metrics: dict[str, float] = history.rows[-1] if history.rows else {}
    for epoch in range(step // per_epoch, schedule.epochs):
        means = _epoch(run, folder, batches, train_step, epoch, step)
        step = (epoch + 1) * per_epoch
        if not run.chief:
            continue
        metrics = {"epoch": epoch + 1, "step": step, **means, **_validate(run)}
        history.add(metrics)
        history.plot(workdir / "curves.png")
        board.scalars(step, metrics)
        if run.picture is not None and run.task.validation_samples.items:
            board.picture(step, "birds_eye", run.picture(run.task))
        _report(metrics)
        _save(run, folder, step, metrics)
        _keep_best(run, folder, history, metrics)
    return metrics


def training_data(run: TrainingRun, first: int, last: int):
    """The batches of steps first to last - 1, distributed where there are several replicas."""
    task, order, replicas = run.task, run.order, run.strategy.num_replicas_in_sync

    def make(context=None):
        pipelines = context.num_input_pipelines if context else 1
        number = context.input_pipeline_id if context else 0
        local = replicas // pipelines
        return dataset(
            run.make_sample,
            task.prepare,
            lambda: micro_batches(order, first, last, number, local, replicas),
            order.batch_size // replicas,
            parallel=2 * run.workers or 2,
        )

    if replicas == 1:
        return make()
    return run.strategy.distribute_datasets_from_function(make)


def compile_train_step(run: TrainingRun):
    """(batch, by_batch) -> every loss term and the gradient's norm, after an update of the weights.

    by_batch: batch normalisation by the moments of the batch, not by the moving averages.
    """
    task, optimizer, strategy = run.task, run.optimizer, run.strategy
    variables, clip = run.variables, task.schedule.clip_norm

    def replica_step(batch, by_batch: bool):
        with tf.GradientTape() as tape:
            terms = task.losses(batch, training=by_batch)
        gradients = tape.gradient(terms["loss"], variables)
        context = tf.distribute.get_replica_context()
        replicas = context.num_replicas_in_sync
        if replicas > 1:
            gradients = context.all_reduce(tf.distribute.ReduceOp.SUM, gradients)
            terms = context.all_reduce(tf.distribute.ReduceOp.SUM, terms)
        gradients, norm = tf.clip_by_global_norm(gradients, clip)
        if replicas > 1:  # the optimiser adds up the replicas' gradients once more
            gradients = [g / replicas for g in gradients]
        optimizer.apply_gradients(zip(gradients, variables, strict=True))
        return {**terms, "gradient_norm": norm}

    @tf.function(jit_compile=False)
    def train_step(batch, by_batch: bool):
        values = strategy.run(replica_step, args=(batch, by_batch))
        return {k: strategy.experimental_local_results(v)[0] for k, v in values.items()}

    return train_step


def _epoch(
    run: TrainingRun, folder, batches, train_step, epoch: int, step: int
) -> dict[str, float]:
    """Runs the rest of an epoch; returns the means of its terms (of the steps run here)."""
    schedule, per_epoch = run.task.schedule, run.order.steps_per_epoch
    sums: dict[str, float] = {}
    saved = read = time.monotonic()
    first, unread, end = step, [], (epoch + 1) * per_epoch
    title = f"{run.task.kind} epoch {epoch + 1}/{schedule.epochs}"
    with Progress(per_epoch, title, "step", initial=step - epoch * per_epoch) as bar:
        while step < end:
            unread.append(train_step(next(batches), step < run.frozen_from))
            step += 1
            now = time.monotonic()
            save = run.chief and now - saved > 60 * schedule.checkpoint_minutes
            if not (save or step == end or now - read > READ_SECONDS):
                continue  # reading waits for the device
            for i, terms in enumerate(unread, step - len(unread)):
                values = {name: float(v) for name, v in terms.items()}
                if not all(map(math.isfinite, values.values())):
                    raise TrainingDivergedError(f"step {i}: {values}; the last checkpoint is kept")
                for name, value in values.items():
                    sums[name] = sums.get(name, 0.0) + value
            rate = float(run.optimizer.learning_rate)
            shown = {name: f"{value:.3f}" for name, value in values.items()}
            bar.update(len(unread), lr=f"{rate:.1e}", **shown)
            unread, read = [], now
            if save:
                _save(run, folder, step, {})
                saved = now
    means = {name: value / (step - first) for name, value in sums.items()}
    return {**means, "learning_rate": rate}


def _validate(run: TrainingRun) -> dict[str, float]:
    """Validation metrics: the mean over data roots, and those of each where there are several."""
    by_root: dict[str, list[int]] = {}
    for index, root in enumerate(run.task.validation_samples.roots):
        by_root.setdefault(root, []).append(index)
    found = {root: _validate_items(run, np.array(items)) for root, items in by_root.items()}
    if len(found) <= 1:
        return next(iter(found.values()), {})
    names = next(iter(found.values()))
    means = {name: float(np.mean([m[name] for m in found.values()])) for name in names}
    return means | {
        f"{Path(root).name}/{name}": value
        for root, metrics in found.items()
        for name, value in metrics.items()
    }


def _validate_items(run: TrainingRun, items: np.ndarray) -> dict[str, float]:
    """Metrics over `schedule.validation_frames` of the items, spread evenly over them."""
    task, wanted = run.task, run.task.schedule.validation_frames
    count = min(wanted or len(items), len(items))
    chosen = items[np.linspace(0, len(items) - 1, count).round().astype(np.int64)]
    size = min(4, count)
    chosen = chosen[: count - count % size].reshape(-1, size)
    data = dataset(
        task.validation_samples, task.prepare, lambda: zip(chosen, chosen, strict=True), size
    )
    step = run.validation_step
    return task.validate(
        (rows, batch, step(batch)) for rows, batch in zip(chosen, data, strict=True)
    )


def _report(metrics: dict[str, float]) -> None:
    print("  ".join(f"{name} {value:.4g}" for name, value in metrics.items()), flush=True)


def _meta(run: TrainingRun, metrics: dict[str, float]) -> dict:
    task = run.task
    return {
        "kind": task.kind,
        "config": to_dict(task.config),
        "metrics": metrics,
        "record": run.started,
        **task.meta,
    }


def _save(run: TrainingRun, folder: CheckpointFolder, step: int, metrics: dict[str, float]) -> None:
    folder.save(step, _meta(run, metrics), **run.groups)


def _keep_best(run: TrainingRun, folder: CheckpointFolder, history: History, metrics) -> None:
    name, sign = run.task.best_metric, 1 if run.task.best_is_largest else -1
    if name not in metrics:
        return
    if all(sign * metrics[name] >= sign * row.get(name, -sign * math.inf) for row in history.rows):
        meta = {**_meta(run, metrics), "step": metrics["step"]}
        checkpoint.save(folder.best_path, meta, **run.networks)


def _resume(run: TrainingRun, folder: CheckpointFolder) -> int:
    """Restores the last checkpoint of the folder; 0 if none was written yet."""
    steps = folder.steps()
    if not steps:
        return 0
    path = folder.path(steps[-1])
    meta, arrays = checkpoint.load(path)
    if meta["config"] != to_dict(run.task.config):
        changed = _changes(meta["config"], to_dict(run.task.config))
        raise InputError(f"was made with another configuration: {changed}", path)
    if _sampled(meta["record"]) != _sampled(run.started):
        raise InputError("was made with other training sequences or shares", path)
    with run.strategy.scope():
        checkpoint.restore(path, arrays, **run.groups)
    return int(meta["step"])


def _sampled(record: dict) -> tuple:
    """Numbers of the training sequences and the shares of a record; roots may have moved."""
    data = record.get("data") or {}
    pools = ((pool["share"], pool["sequences"]) for pool in data.get("shares", ()))
    return (
        _numbers(data.get("training", ())),
        [(share, _numbers(sequences)) for share, sequences in pools],
    )


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
