"""The pictures: one file per figure, all functions of arrays; no TensorFlow but in views.py."""
