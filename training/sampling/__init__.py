"""Training samples: labelled frames, augmentation, order, worker processes, tf.data."""
