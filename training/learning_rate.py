"""The cyclical learning rate (Smith 2018; section IV.B): linear up and down between two bounds."""

import keras
import tensorflow as tf


@keras.saving.register_keras_serializable(package="pointtracknet")
class CyclicalLearningRate(keras.optimizers.schedules.LearningRateSchedule):
    """Lower bound at steps 0, cycle, 2 cycle...; upper bound half a cycle later."""

    def __init__(self, minimum: float, maximum: float, cycle_steps: int):
        self.minimum, self.maximum, self.cycle_steps = minimum, maximum, cycle_steps

    def __call__(self, step):
        """Step (scalar) -> learning rate (scalar float32)."""
        phase = tf.math.floormod(tf.cast(step, tf.float32) / self.cycle_steps, 1.0)
        height = 1.0 - tf.abs(2.0 * phase - 1.0)
        return self.minimum + (self.maximum - self.minimum) * height

    def get_config(self):
        """The constructor's arguments."""
        return {
            "minimum": self.minimum,
            "maximum": self.maximum,
            "cycle_steps": self.cycle_steps,
        }
