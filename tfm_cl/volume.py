"""A voxel volume: the medium's density on a grid, and where the grid lies in the world."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl import volume_io
from tfm_cl.errors import VolumeError
from tfm_cl.model import LARGEST_COLOUR, LARGEST_COORDINATE
from tfm_cl.volume_io.grid import world_from_index_of


class Volume:
    """Density on a regular grid.

    Between voxel centres the density is trilinear; beyond the outermost centres it falls to 0 over one
    more voxel, and `bounds` include that voxel.

    Parameters
    ----------
    data
        Densities ``[z, y, x]`` of any real or integer type; kept as float32. Finite and ≥ 0.
    voxel_size
        Edge length in world units, one number or (x, y, z).
    origin
        World position of the low corner of voxel (0, 0, 0).
    world_from_index
        4×4 matrix instead of ``voxel_size`` and ``origin``: world position of the centre of voxel
        (x, y, z). Affine; column vectors.
    density_scale
        The medium's density is ``density_scale * data``.
    name
        The grid's name, for messages.
    source
        The file it came from, if any.
    sanitize
        Set NaN, infinite and negative densities to 0 instead of raising.

    Raises
    ------
    VolumeError
        When the array is not three-dimensional and real, holds NaN, infinite or negative densities
        (the message says where), or the transform cannot be inverted.
    """

    data: NDArray[np.float32]
    world_from_index: NDArray[np.float64]

    def __init__(
        self,
        data: ArrayLike,
        *,
        voxel_size: float | tuple[float, float, float] | None = None,
        origin: tuple[float, float, float] | None = None,
        world_from_index: ArrayLike | None = None,
        density_scale: float = 1.0,
        name: str = "",
        source: Path | None = None,
        sanitize: bool = False,
    ) -> None:
        self.name = name
        self.source = source
        self.density_scale = _non_negative(density_scale, "density_scale", self._label)
        self.data = _as_density(data, self._label, sanitize=sanitize)
        if world_from_index is None:
            self.world_from_index = world_from_index_of(
                _voxel_size(1.0 if voxel_size is None else voxel_size, self._label),
                _vector((0.0, 0.0, 0.0) if origin is None else origin, "origin", self._label),
            )
        elif voxel_size is not None or origin is not None:
            raise VolumeError(
                f"{self._label}: it brings its own transform; leave out voxel_size and origin "
                "(they are for arrays and files without one)"
            )
        else:
            self.world_from_index = np.array(world_from_index, dtype=np.float64)
        _check_transform(self.world_from_index, self._label)
        self.data.flags.writeable = False
        self.world_from_index.flags.writeable = False

    @classmethod
    def load(
        cls,
        path: str | Path,
        grid: str | None = None,
        *,
        voxel_size: float | tuple[float, float, float] | None = None,
        origin: tuple[float, float, float] | None = None,
        density_scale: float = 1.0,
        sanitize: bool = False,
    ) -> Volume:
        """Read a volume file; the extension tells the format.

        Parameters
        ----------
        path
            ``.vdb .nvdb .npy .npz .vol .nrrd .nhdr .raw`` (with a ``.json`` beside it).
        grid
            Name of the grid; by default ``density``, or the file's only grid.
        voxel_size, origin
            For files without a transform, as in the constructor.
        density_scale, sanitize
            As in the constructor.

        Raises
        ------
        VolumeError
            Missing, damaged or unknown file, unknown grid (the message lists the names), level set.
        """
        path = Path(path)
        described = volume_io.choose_grid(path, grid)
        data = volume_io.read_grid(path, described)
        placed: dict[str, Any] = {"voxel_size": voxel_size, "origin": origin}
        if described.has_transform:
            placed["world_from_index"] = described.world_from_index
        return cls(
            data, **placed, density_scale=density_scale, name=described.name, source=path, sanitize=sanitize
        )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels (z, y, x)."""
        z, y, x = self.data.shape
        return z, y, x

    @property
    def voxel_size(self) -> NDArray[np.float64]:
        """Edge lengths (x, y, z) of a voxel, world units."""
        lengths: NDArray[np.float64] = np.linalg.norm(self.world_from_index[:3, :3], axis=0)
        return lengths

    @property
    def bounds(self) -> NDArray[np.float64]:
        """World-space box ``[[x, y, z] low, [x, y, z] high]`` around voxels and border."""
        return bounds_of(self.shape, self.world_from_index)

    @property
    def occupied_bounds(self) -> NDArray[np.float64]:
        """World-space box around the voxels > 0, border included; `bounds` when there are none."""
        low, high = [], []
        for axis in (2, 1, 0):
            others = tuple(other for other in range(3) if other != axis)
            occupied = np.flatnonzero(self.data.max(axis=others) > 0)
            if occupied.size == 0:
                return self.bounds
            low.append(occupied[0] - 1.0)
            high.append(occupied[-1] + 1.0)
        return _world_box(self.world_from_index, low, high)

    def with_density_scale(self, density_scale: float) -> Volume:
        """Return the same voxels (not copied) under another density scale."""
        other = object.__new__(Volume)
        other.__dict__.update(self.__dict__)
        other.density_scale = _non_negative(density_scale, "density_scale", self._label)
        return other

    def __repr__(self) -> str:
        z, y, x = self.shape
        return f"Volume({self._label}, {x}×{y}×{z} voxels, density_scale={self.density_scale:g})"

    @property
    def _label(self) -> str:
        if self.source is None:
            return self.name or "array"
        return f"{self.source}: grid '{self.name}'" if self.name else str(self.source)


def bounds_of(shape: tuple[int, int, int], world_from_index: NDArray[np.float64]) -> NDArray[np.float64]:
    """World-space box around a grid of ``shape`` (z, y, x) and its border voxel."""
    z, y, x = shape
    return _world_box(world_from_index, (-1, -1, -1), (x, y, z))


def _world_box(
    world_from_index: NDArray[np.float64], low: Sequence[float], high: Sequence[float]
) -> NDArray[np.float64]:
    """World-space axis-aligned box around the index-space box from ``low`` to ``high`` (x, y, z)."""
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))), dtype=np.float64)
    world = corners @ world_from_index[:3, :3].T + world_from_index[:3, 3]
    return np.array([world.min(axis=0), world.max(axis=0)])


def _as_density(data: ArrayLike, label: str, *, sanitize: bool) -> NDArray[np.float32]:
    array = np.asarray(data)
    if array.ndim != 3 or array.size == 0:  # noqa: PLR2004 - a volume has three axes
        raise VolumeError(
            f"{label}: a volume is a non-empty array [z, y, x]; this one has the shape {array.shape}"
        )
    if array.dtype.kind not in "fiub":
        raise VolumeError(f"{label}: densities are real numbers; these are of type {array.dtype}")
    with np.errstate(over="ignore"):
        density = np.array(array, dtype=np.float32, order="C")
    # One pass over min and max finds all three defects without a mask of the volume's size.
    low, high = float(density.min()), float(density.max())
    if np.isfinite(low) and np.isfinite(high) and low >= 0.0:
        return density
    wrong = ~np.isfinite(density) | (density < 0)
    if sanitize:
        density[wrong] = 0.0
        return density
    z, y, x = (int(i) for i in np.argwhere(wrong)[0])
    raise VolumeError(
        f"{label}: {np.count_nonzero(wrong)} densities are negative, infinite or NaN, the first "
        f"{density[z, y, x]:g} at [z={z}, y={y}, x={x}]; set them to 0 with --set volume.sanitize=true"
    )


def _check_transform(matrix: NDArray[np.float64], label: str) -> None:
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise VolumeError(f"{label}: world_from_index is a finite 4×4 matrix; got the shape {matrix.shape}")
    if not np.allclose(matrix[3], (0, 0, 0, 1)):
        raise VolumeError(f"{label}: world_from_index must be affine; its last row is {matrix[3].tolist()}")
    if np.abs(matrix).max() > LARGEST_COORDINATE:
        raise VolumeError(f"{label}: world_from_index holds {np.abs(matrix).max():g}; the limit is 1e15")
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if lengths.min() == 0 or abs(np.linalg.det(matrix[:3, :3] / lengths)) < 1e-6:  # noqa: PLR2004 - nearly flat
        raise VolumeError(f"{label}: world_from_index cannot be inverted (a voxel has no volume)")


def _non_negative(value: float, key: str, label: str) -> float:
    if not 0 <= value <= LARGEST_COLOUR:
        raise VolumeError(f"{label}: {key} is a number from 0 to {LARGEST_COLOUR:g}; got {value}")
    return float(value)


def _vector(value: Any, key: str, label: str) -> tuple[float, float, float]:
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.full(3, np.nan)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise VolumeError(f"{label}: {key} is three finite numbers; got {value}")
    x, y, z = vector.tolist()
    return x, y, z


def _voxel_size(value: float | tuple[float, float, float], label: str) -> tuple[float, float, float]:
    sizes = _vector((value, value, value) if np.ndim(value) == 0 else value, "voxel_size", label)
    if min(sizes) <= 0:
        raise VolumeError(f"{label}: voxel_size is > 0; got {value}")
    return sizes
