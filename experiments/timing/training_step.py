"""Steps of a training outside its loop, to be timed."""

import tempfile
from collections.abc import Callable


def training_steps(task, steps: int) -> tuple[Callable[[], float], Callable[[], float]]:
    """Two functions that train a step and return its loss: on one batch again, on the next one.

    Args:
        task: a `training.task.TrainingTask`.
        steps: how many batches the input pipeline gives.
    """
    from training.loop import compile_train_step, training_data
    from training.strategies import make_strategy
    from training.training_run import start

    with tempfile.TemporaryDirectory() as folder:
        run = start(lambda: task, make_strategy("one"), folder, {})
    batches, step = iter(training_data(run, 0, steps)), compile_train_step(run)
    same = next(batches)

    def on(batch) -> float:
        return float(step(batch, True)["loss"])

    return lambda: on(same), lambda: on(next(batches))
