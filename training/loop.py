"""The training loop of both networks: one straight loop over steps, under tf.distribute."""

import math
import time

import tensorflow as tf

from common.files import write_json
from common.progress import Progress
from tf_ops.devices import default_device
from training.checkpoint_folder import CHECKPOINTS, CheckpointFolder
from training.logs import History, TensorBoard
from training.run_state import keep_best, prepare_workdir, resume_run, save_checkpoint
from training.sampling.pipeline import dataset, fetch_to, micro_batches
from training.training_run import TrainingRun
from training.validation import validate

READ_SECONDS = 1.0
"""Between two readings of the steps' losses, which are checked, summed up and shown."""
NOT_FINITE = "values must be finite"
"""In the errors of ops (tf_ops) that are given NaN or infinity."""


class TrainingDivergedError(RuntimeError):
    """The loss is not finite; the last good checkpoint is kept."""


def run_training(run: TrainingRun, resume: bool = False) -> dict[str, float]:
    """Trains to the configured number of epochs; returns the last epoch's metrics.

    Raises:
        InputError: the workdir is used (or not, with resume), its checkpoint does not fit, or the
            file of a sample is broken.
        TrainingDivergedError: the loss became NaN or infinite.
    """
    workdir, schedule = run.workdir, run.task.schedule
    if run.chief:
        prepare_workdir(workdir, resume)
    per_epoch = run.order.steps_per_epoch
    folder = CheckpointFolder(workdir / CHECKPOINTS, schedule.keep_checkpoints, per_epoch)
    step = resume_run(run, folder) if resume else 0
    if run.chief and step == 0:  # resumed before its first checkpoint: perhaps with other flags
        write_json(workdir / "config.json", run.started)
    history = History(workdir / "history.csv", step)
    if step >= schedule.epochs * per_epoch:
        print("nothing left to train: all epochs are done", flush=True)
        return history.rows[-1] if history.rows else {}
    board = TensorBoard(workdir / "tensorboard") if run.chief else None
    batches = iter(training_data(run, step, schedule.epochs * per_epoch))
    train_step = compile_train_step(run)
    metrics: dict[str, float] = history.rows[-1] if history.rows else {}
    for epoch in range(step // per_epoch, schedule.epochs):
        try:
            with run.sample_errors.raised():
                means = _epoch(run, folder, batches, train_step, epoch, step)
        except tf.errors.InvalidArgumentError as error:
            if NOT_FINITE not in error.message:
                raise
            raise TrainingDivergedError(f"epoch {epoch + 1}: {_fault(error.message)}") from error
        step = (epoch + 1) * per_epoch
        if not run.chief:
            continue
        with run.sample_errors.raised():
            metrics = {"epoch": epoch + 1, "step": step, **means, **validate(run)}
        history.add(metrics)
        history.plot(workdir / "curves.png")
        board.scalars(step, metrics)
        if run.picture is not None and run.task.validation_samples.items:
            board.picture(step, "birds_eye", run.picture(run.task))
        _report(metrics)
        keep_best(run, folder, history, metrics)
        save_checkpoint(run, folder, step, metrics)  # last: a kill before it repeats all of these
    return metrics


def _fault(message: str) -> str:
    """The line of an op's error that names the value that is not finite."""
    return next(line for line in message.splitlines() if NOT_FINITE in line)


def training_data(run: TrainingRun, first: int, last: int):
    """The batches of steps first to last - 1, where the step runs; distributed over replicas."""
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
        device = default_device()
        return make() if "CPU" in device else fetch_to(device, make())
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
            # the last step of an epoch is saved after its validation
            save = run.chief and step < end and now - saved > 60 * schedule.checkpoint_minutes
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
                save_checkpoint(run, folder, step, {})
                saved = now
    means = {name: value / (step - first) for name, value in sums.items()}
    return {**means, "learning_rate": rate}


def _report(metrics: dict[str, float]) -> None:
    print("  ".join(f"{name} {value:.4g}" for name, value in metrics.items()), flush=True)
