"""The KITTI tracking format in and out: calibration, labels, scans, boxes, targets.

Frames: *level* is the rectified camera-0 frame renamed to x forward, y left, z up, in metres.
Boxes are rows (x, y, z, l, w, h, yaw): geometric centre and size in metres, yaw in radians,
counter-clockwise about +z from +x, in [-pi, pi). Nothing here imports TensorFlow.
"""
