"""A training under way: task, optimizer, order of samples, state of a checkpoint."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import keras
import numpy as np
import tensorflow as tf
from matplotlib.figure import Figure

from common.config import to_dict
from common.errors import InputError
from common.provenance import provenance
from models import checkpoint
from training.learning_rate import CyclicalLearningRate
from training.sampling.pipeline import Order, SampleErrors, make_order
from training.sampling.workers import SampleWorkers
from training.task import TrainingTask

Picture = Callable[[TrainingTask], Figure]


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
        self.sample_errors = SampleErrors()
        self._workers = SampleWorkers(self.task.samples, self.workers) if self.workers else None
        self.make_sample = self.sample_errors.kept(self._workers or self.task.samples)
        self.make_validation_sample = self.sample_errors.kept(self.task.validation_samples)
        self.validation_step = tf.function(self.task.validation_step, jit_compile=False)

    def close(self) -> None:
        """Ends the worker processes, if there are any."""
        if self._workers is not None:
            self._workers.close()

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
        """Adam's variables; moments are named by the path of their variable."""
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
