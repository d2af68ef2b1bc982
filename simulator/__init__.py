"""A LiDAR simulator of KITTI's sensor and scenes that writes the KITTI tracking format."""

VERSION = 3  # of the simulation: data sets of another version are not reused
