"""A LiDAR simulator of KITTI's sensor and scenes that writes the KITTI tracking format."""

VERSION = 2  # of what is simulated: sets of another version are not reused
