"""How much memory a call takes."""

import tracemalloc

from tfm_cl.errors import VolumeError


def peak_of(function):
    """What a function returns (or a `VolumeError` it raises), and the memory that takes at most."""
    tracemalloc.start()
    try:
        result = function()
    except VolumeError as error:
        result = error
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return result, peak
