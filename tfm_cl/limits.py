"""The largest numbers that a scene may hold, so that float32 holds what is made of them."""

LARGEST_COORDINATE = 1e15
"""Its square is far from float32's limit."""
LARGEST_COLOUR = 1e25
"""Likewise its product with densities and phase functions."""
MOST_STOPS = 100
"""Of an exposure, up and down: beyond float32."""
FRAMES_A_SECOND = 24.0
"""Unless asked otherwise, as of films, and Arnold's ``velocity_fps``."""
