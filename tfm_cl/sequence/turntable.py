"""A turntable: the camera goes once around what it looks at."""

FULL_TURN = 360.0
"""Degrees."""


def angle_of(frame: float, count: int) -> float:
    """Return how far the camera is turned in a frame, degrees, in a turn of ``count`` that begins at 1."""
    return FULL_TURN * (((frame - 1) / count) % 1.0)
