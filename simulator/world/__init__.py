"""The static world: roads, ground, roadside, boxes and cylinders."""
