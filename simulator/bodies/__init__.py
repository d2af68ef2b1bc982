"""Bodies of objects: convex parts, people, vehicles, by KITTI type."""
