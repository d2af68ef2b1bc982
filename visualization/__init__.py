"""Pictures and 3-D scenes: one file per figure, functions of arrays; views.py uses TensorFlow."""
