"""Rays of the sensor, sweeps of a scene, frames."""
