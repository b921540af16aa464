"""Makes a Dask worker one of another version of the package: ``dask worker --preload FILE``."""

from tfm_cl.jobs import cluster


def dask_setup(_worker):
    cluster.__version__ = "0.0.1"
