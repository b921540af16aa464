"""Calls the kernels of ``tests/kernels``, each of which wraps some functions of the device."""

import numpy as np

from tfm_cl.device.bricks import ONE_FIELD, build_bricks
from tfm_cl.device.structs.bodies import grid_structs

ONE_GRID = {**ONE_FIELD, "TFM_VOXEL_BITS": 32, "TFM_POOLS": 1, "TFM_GRIDS": 1, "TFM_VOXEL_CHANNELS": 1}
"""Macros of a program that includes a grid's header and reads none."""


class Calls:
    """The kernels of one file, as one program.

    Parameters
    ----------
    file
        Of ``tests/kernels``, or a whole path.
    arguments
        That every kernel takes which names them: buffers, or arrays to upload.
    """

    def __init__(self, launcher, file, headers=(), defines=None, arguments=None):
        self._launcher, self._file = launcher, str(file)
        self._headers, self._defines = tuple(headers), defines or {}
        self._arguments = {name: self._uploaded(value) for name, value in (arguments or {}).items()}

    def __call__(self, name, values, *shape, **arguments):
        """Hand ``values``, an item a row, to kernel ``name``; returns its ``found``, [items, *shape]."""
        kernel = self.kernel(name)
        values = np.asarray(values, np.float32)
        (given,) = [p for p in kernel.parameters if p not in {*self._arguments, *arguments, "found", "count"}]
        found = self._launcher.empty("found", 4 * len(values) * int(np.prod(shape)))
        self.run(name, len(values), found=found, **{given: values}, **arguments)
        return self._launcher.download(found, (len(values), *shape), np.float32).astype(np.float64)

    def run(self, name, count, **arguments):
        """Run a kernel over ``count`` items; arrays are uploaded."""
        kernel = self.kernel(name)
        given = {
            **self._arguments,
            **{key: self._uploaded(value) for key, value in arguments.items()},
            "count": count,
        }
        needed = {key: value for key, value in given.items() if key in kernel.parameters}
        assert arguments.keys() <= needed.keys()
        self._launcher.run(kernel, (-(-count // self._launcher.lanes),), needed)

    def kernel(self, name):
        """Compile it, if need be."""
        return self._launcher.kernels.kernel(name, self._file, self._headers, self._defines)

    def _uploaded(self, value):
        return self._launcher.upload("input", value) if isinstance(value, np.ndarray) else value


class GridCalls(Calls):
    """``grid_functions.cl`` for the grids of a scene; by default all their densities are one sum."""

    def __init__(self, launcher, scene, voxels="f32", defines=ONE_FIELD):
        self.bricks = build_bricks(
            launcher, [grid.channel_leaves for grid in scene.grids], "the volume", voxels
        )
        super().__init__(
            launcher,
            "grid_functions.cl",
            defines={**self.bricks.defines, **defines},
            arguments={"grids": grid_structs(scene, self.bricks), **self.bricks.arguments},
        )
