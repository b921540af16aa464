"""A voxel volume: the medium's density on a grid, and where the grid lies in the world."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files import volume_io
from tfm_cl.files.paths import real_path, source_of
from tfm_cl.files.volume_io.colour import ColourSource, check_array, checked, read_colour
from tfm_cl.files.volume_io.grid import COLOUR, Grid, coloured_where, shown, world_from_index_of
from tfm_cl.files.volume_io.leaves import LEAF, Index, Leaves, NotDensities
from tfm_cl.files.volume_io.limits import too_large
from tfm_cl.files.volume_io.stored_velocity import StoredVelocity, VelocitySource, components_of
from tfm_cl.files.volume_io.values import ValueMap
from tfm_cl.files.volume_io.velocity import read_velocity
from tfm_cl.limits import FRAMES_A_SECOND, LARGEST_COLOUR, LARGEST_COORDINATE
from tfm_cl.model import same
from tfm_cl.scene.bodies.base import MarchedBody, digest_of
from tfm_cl.scene.bodies.velocity import OUTLIERS, Velocity, VelocityAsked, velocity_of
from tfm_cl.scene.medium import Medium, parse_medium
from tfm_cl.scene.movable import STEPS, said_by

WISP = 0.05
"""Of the typical density: what has less is not looked at."""
FEW_LEAVES = 512
"""Of which every voxel is looked at."""


class Volume(MarchedBody):
    """Density on a regular grid.

    Between voxel centres the density is trilinear; beyond the outermost centres it falls to 0 over one
    more voxel, and `bounds` include that voxel.

    The voxels are held in the form they came in, dense or as leaves (`.vdb` and `.nvdb` files); what asks
    for the other form makes it.

    A volume may be coloured: then the extinction has a density of its own in each channel, the trilinear
    interpolation of ``data`` times the channel's colour, and takes three runs of the passes to render (TFM
    sections 5 and 6.1). Bounds and occupied bounds stay those of ``data``.

    Parameters
    ----------
    data
        Densities ``[z, y, x]`` of any real or integer type; kept as float32. Finite and ≥ 0. An array of
        float32 that nobody can write to is kept itself, any other is copied. Or sparse, as `Leaves`.
    colour
        Extinction ``[z, y, x, RGB]`` relative to ``data``, any real or integer type, finite and ≥ 0, kept
        as ``data`` is; it scales scattering and absorption alike. None: the same, 1, everywhere.
    voxel_size
        Edge length in world units, one number or (x, y, z).
    origin
        World position of the low corner of voxel (0, 0, 0).
    world_from_index
        4×4 matrix instead of ``voxel_size`` and ``origin``: world position of the centre of voxel
        (x, y, z). Affine; column vectors.
    density_scale
        The medium's density is ``density_scale * data``.
    medium
        What this volume alone is made of; None: the scene's medium.
    name
        The grid's name, for messages.
    source
        The file it came from, if any.
    sanitize
        Set NaN, infinite and negative densities and colours to 0 instead of raising.

    Raises
    ------
    VolumeError
        When the array is not three-dimensional and real, holds NaN, infinite or negative densities
        (the message says where), the colour is not an array of that kind and shape, or the transform
        cannot be inverted.
    """

    DENSITY_KEY: ClassVar[str] = "density_scale"
    world_from_index: NDArray[np.float64]
    notes: tuple[str, ...]
    """What a user should know of how it was read from its file: sentences for warnings."""
    made_from: dict[str, Any] | None
    """Keys of a scene file that make it of its file, but for density and medium; None: of arrays."""
    kept: dict[str, Any]
    """What others made of its file; copies of the volume share it."""

    def __init__(
        self,
        data: ArrayLike | Leaves,
        *,
        colour: ArrayLike | None = None,
        voxel_size: float | tuple[float, float, float] | None = None,
        origin: tuple[float, float, float] | None = None,
        world_from_index: ArrayLike | None = None,
        density_scale: float = 1.0,
        medium: Medium | None = None,
        name: str = "",
        source: Path | None = None,
        sanitize: bool = False,
    ) -> None:
        self.name = name
        self.medium = parse_medium(medium)
        self.source = source
        self.sanitize = sanitize
        self.notes = ()
        self.kept = {}
        self.made_from = None
        self.density_scale = _non_negative(density_scale, "density_scale", self.label)
        if isinstance(data, Leaves):
            self._voxels = _Voxels(_as_density_leaves(data, self.label, sanitize=sanitize))
        else:
            self._voxels = _Voxels(_as_density(data, self.label, sanitize=sanitize))
        self._colour = None
        if colour is not None:
            self._colour = _Colour(self._voxels, colour, self.label, sanitize=sanitize)
        if world_from_index is None:
            self.world_from_index = world_from_index_of(
                _voxel_size(1.0 if voxel_size is None else voxel_size, self.label),
                _vector((0.0, 0.0, 0.0) if origin is None else origin, "origin", self.label),
            )
        elif voxel_size is not None or origin is not None:
            raise VolumeError(
                f"{self.label}: it brings its own transform; leave out voxel_size and origin "
                "(they are for arrays and files without one)"
            )
        else:
            self.world_from_index = np.array(world_from_index, dtype=np.float64)
        _check_transform(self.world_from_index, self.label)
        self.world_from_index.flags.writeable = False
        self._velocity_from_index, self._asked = self.world_from_index, VelocityAsked()

    @classmethod
    def load(
        cls,
        path: str | Path,
        grid: str | None = None,
        *,
        colour: ColourSource = None,
        offset: float = 0.0,
        window: tuple[float, float] | None = None,
        voxel_size: float | tuple[float, float, float] | None = None,
        origin: tuple[float, float, float] | None = None,
        density_scale: float = 1.0,
        sanitize: bool = False,
    ) -> Volume:
        """Read a volume file; the extension tells the format.

        The voxels of ``.vdb`` and ``.nvdb`` files stay leaves, which cost memory for what is not empty.

        Parameters
        ----------
        path
            ``.vdb .nvdb .npy .npz .vol .nrrd .nhdr .raw`` (with a ``.json`` beside it).
        grid
            Name of the grid; by default ``density``, or the file's only grid. Of grids that share a name
            it means the first, ``name[1]`` the second; likewise the volumes of a list in a NRRD file.
        colour
            The name of an array ``[z, y, x, 3]`` of the same ``.npz``, or of a grid of vectors of the same
            file; a file with such an array or grid; or three names of scalar grids of the same file, for
            red, green and blue. By default the array ``colour`` of an ``.npz``, where it has one of four
            axes; False: none. Files that hold nothing but a colour (``.vol`` and NRRD files of three
            channels) are coloured volumes by themselves: their ``data`` is 1 where they are not black.
        offset, window
            `ValueMap`: offset is added to each stored value, and what is below 0 becomes 0; a window
            (low, high) of these sums becomes 0 to 1.
        voxel_size, origin
            For files without a transform, as in the constructor.
        density_scale, sanitize
            As in the constructor.

        Raises
        ------
        VolumeError
            Missing, damaged or unknown file, unknown grid (the message lists the names), level set, or a
            colour that is not one of this grid.
        """
        path = source_of(path, error=VolumeError)
        ValueMap(offset, window).check(str(path))
        volume = cls.of_grid(
            path,
            volume_io.choose_grid(path, grid),
            None,
            colour=colour,
            offset=offset,
            window=window,
            voxel_size=voxel_size,
            origin=origin,
            density_scale=density_scale,
            sanitize=sanitize,
        )
        volume.made_from = {
            "file": str(real_path(path)),
            "grid": volume.name or None,
            "colour": _told_colour(colour, volume, path),
            "offset": float(offset),
            "window": None if window is None else list(window),
            "voxel_size": voxel_size if voxel_size is None else np.broadcast_to(voxel_size, 3).tolist(),
            "origin": None if origin is None else list(origin),
            "sanitize": sanitize,
        }
        return volume

    @classmethod
    def of_grid(
        cls,
        path: Path,
        described: Grid,
        data: NDArray[np.float32] | Leaves | None,
        *,
        colour: ColourSource = None,
        offset: float = 0.0,
        window: tuple[float, float] | None = None,
        voxel_size: float | tuple[float, float, float] | None = None,
        origin: tuple[float, float, float] | None = None,
        density_scale: float = 1.0,
        sanitize: bool = False,
    ) -> Volume:
        """Make the volume of a grid of a file.

        Parameters
        ----------
        data
            What `volume_io.read_stored` read of it, which becomes the volume's own: an array is kept, and
            nobody can write to it any more. None: it is read here.

        All others, and errors, as of `load`.
        """
        values, label = ValueMap(offset, window), f"{path}: grid {shown(described.name)}"
        notes = described.notes
        rgb: NDArray[np.float32] | None
        if described.read_colour is None:
            stored = volume_io.read_stored(path, described) if data is None else data
            data = values.of_stored(stored, label)
            rgb, notes_of_colour = read_colour(path, described, colour, sanitize=sanitize)
            notes += notes_of_colour
        elif colour is None:
            rgb = values.of_array(volume_io.read_vectors(path, described))
            rgb = checked(rgb, label, sanitize=sanitize)
            data = coloured_where(rgb)
        else:
            raise VolumeError(
                f"{label} is a colour by itself; leave out colour, or choose one of its channels with --grid"
            )
        if isinstance(data, np.ndarray):
            data.flags.writeable = False  # nobody else has it: the volume can keep it without a copy
        if described.is_box_of_stored and (note := values.note(described.background, label)):
            notes += (note,)
        placed: dict[str, Any] = {"voxel_size": voxel_size, "origin": origin, "colour": rgb}
        if described.has_transform:
            placed["world_from_index"] = described.world_from_index
        volume = cls(
            data, **placed, density_scale=density_scale, name=described.name, source=path, sanitize=sanitize
        )
        volume.notes = notes
        return volume

    @classmethod
    def of_channels(
        cls,
        channels: Sequence[NDArray[np.float32] | Leaves],
        *,
        world_from_index: ArrayLike,
        name: str = "",
        source: Path | None = None,
    ) -> Volume:
        """Make a coloured volume of its densities in red, green and blue.

        Parameters
        ----------
        channels
            Arrays [z, y, x], which nobody else writes to, or leaves, the same ones in all three; its `data`
            is the largest of the three in each voxel.
        world_from_index, name, source
            As in the constructor.
        """
        red, green, blue = (one.values if isinstance(one, Leaves) else one for one in channels)
        most, first = np.maximum(np.maximum(red, green), blue), channels[0]
        for channel in (red, green, blue):
            channel.flags.writeable = False
        volume = cls(
            Leaves(first.shape, first.first, first.coordinates, most) if isinstance(first, Leaves) else most,
            world_from_index=world_from_index,
            name=name,
            source=source,
        )
        return volume._with(_colour=_Channels(volume._voxels, channels))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels (z, y, x)."""
        return self._voxels.shape

    @property
    def data(self) -> NDArray[np.float32]:
        """Densities ``[z, y, x]``, float32, read-only, before ``density_scale``.

        A volume of leaves makes this array when first asked for it, and keeps it.

        Raises
        ------
        VolumeError
            The volume holds leaves, and the dense array would be larger than `limits.MAX_VOXELS`.
        """
        reason = too_large(self.shape, sparse=False)
        if reason and self._voxels.leaves is not None:
            raise VolumeError(f"{self.label}: {reason} for a dense array; .leaves are its voxels without")
        return self._voxels.dense

    @property
    def leaves(self) -> Leaves:
        """The 8³ leaves that are not empty, before ``density_scale``.

        A dense volume makes them anew each time.

        Raises
        ------
        VolumeError
            The volume is dense and has more than `limits.MAX_LEAVES` of them.
        """
        if self._voxels.leaves is not None:
            return self._voxels.leaves
        try:
            return Leaves.from_dense(self._voxels.dense)
        except VolumeError as error:
            raise VolumeError(f"{self.label}: {error}") from error

    @property
    def colour(self) -> NDArray[np.float32] | None:
        """Extinction ``[z, y, x, RGB]`` relative to `data`, float32, read-only; None where it is 1."""
        return None if self._colour is None else self._colour.rgb

    @cached_property
    def channels(self) -> tuple[Volume, Volume, Volume]:
        """Volumes without colour that hold `data` times the colour's red, green and blue.

        Made when first asked for, and kept: they are what a renderer keeps on its device. A volume without
        colour gives itself three times.
        """
        if self._colour is None:
            return self, self, self
        red, green, blue = (self._with(_voxels=voxels, _colour=None) for voxels in self._colour.products)
        return red, green, blue

    @property
    def channel_leaves(self) -> tuple[Leaves, ...]:
        """`leaves`, or those of `data` times the colour's red, green and blue."""
        return tuple(channel.leaves for channel in (self.channels if self._colour is not None else (self,)))

    def densities_at(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Density in each channel at world points [n, 3], float64 [n, 3].

        Trilinear between voxel centres, 0 one voxel beyond them; without colour the first channel is all.
        """
        index_from_world = np.linalg.inv(self.world_from_index)
        index = points @ index_from_world[:3, :3].T + index_from_world[:3, 3]
        densities = np.zeros((len(points), 3))
        for c, channel in enumerate(self.channels if self._colour is not None else (self,)):
            densities[:, c] = _trilinear(channel.data, index[:, ::-1])
        scaled: NDArray[np.float64] = self.density_scale * densities
        return scaled

    def interval(self, origin: NDArray[np.floating], direction: NDArray[np.floating]) -> tuple[float, float]:
        """Begin and end ≥ 0 of a world ray in the grid and its border of one voxel; (0, 0) without."""
        matrix = np.linalg.inv(self.world_from_index)
        start, along = matrix[:3, :3] @ origin + matrix[:3, 3], matrix[:3, :3] @ direction
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = (np.array([np.full(3, -1.0), self.shape[::-1]]) - start) / along
        begin, end = max(0.0, np.nanmin(sides, axis=0).max()), np.nanmax(sides, axis=0).min()
        return (float(begin), float(end)) if begin < end else (0.0, 0.0)

    def depths_along(
        self, origin: NDArray[np.floating], direction: NDArray[np.floating], edges: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """As `MarchedBody.depths_along`, by the midpoint rule."""
        middles, lengths = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
        densities = self.densities_at(origin + middles[:, None] * direction)
        depths: NDArray[np.float64] = densities * lengths[:, None]
        return depths

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
    def anchor(self) -> NDArray[np.float64]:
        """World position [3] of a voxel that begins a leaf; in frames of a sparse grid, leaves apart."""
        leaves = self._voxels.leaves
        z, y, x = (0, 0, 0) if leaves is None else leaves.first
        start: NDArray[np.float64] = (self.world_from_index @ [-x, -y, -z, 1])[:3]
        return start

    @property
    def occupied_bounds(self) -> NDArray[np.float64]:
        """World-space box around the voxels > 0, border included; `bounds` when there are none."""
        box = self._voxels.occupied_box
        if box is None:
            return self.bounds
        low, high = (index[::-1] for index in box)
        return _world_box(self.world_from_index, [i - 1.0 for i in low], [i + 1.0 for i in high])

    @property
    def largest(self) -> float:
        """Largest voxel, before ``density_scale``; of a coloured volume the largest in any channel."""
        if self._colour is not None:
            return max(channel.largest for channel in self.channels)
        return float(self._voxels.stored.max())

    @property
    def largest_density(self) -> NDArray[np.float64]:
        """The largest density in red, green and blue, [3]; without a colour they are the same."""
        if self._colour is None:
            return np.full(3, self.density_scale * self.largest)
        return np.array([self.density_scale * channel.largest for channel in self.channels])

    @property
    def why_empty(self) -> str:
        """Why it has no density at all; empty where it has some."""
        if self.density_scale == 0:
            return "density_scale is 0"
        if self.largest > 0:
            return ""
        return "all voxels are 0" if self._colour is None else "all voxels times their colours are 0"

    @property
    def typical_density(self) -> float:
        """Mean density of the voxels weighted by itself: that of the body, not of the empty space around it.

        In a coloured volume that of the strongest channel.
        """
        if self._colour is None:
            return self.density_scale * self._voxels.typical
        return self.density_scale * max(voxels.typical for voxels in self._colour.products)

    @property
    def detail(self) -> float:
        """The shortest edge of a voxel, world units."""
        return float(self.voxel_size.min())

    def mass_in(self, room: float) -> float:
        """As `Body.mass_in`."""
        del room
        return self.density_scale * float(self.line_sums(0).sum()) * float(np.prod(self.voxel_size))

    def outline(self) -> NDArray[np.float64]:
        """As `Body.outline`: corners of blocks of voxels, without wisps and what is fainter."""
        leaves = self.leaves
        edge = 4 if len(leaves.values) > FEW_LEAVES else 1
        blocks = leaves.values.reshape(-1, *(LEAF // edge, edge) * 3).mean(axis=(2, 4, 6), dtype=np.float64)
        leaf, *block = np.nonzero(blocks > WISP * self._voxels.typical)
        first = LEAF * leaves.coordinates[leaf] - leaves.first + edge * np.stack(block, axis=-1) - 0.5
        z, y, x = np.concatenate([first, first + edge]).T
        matrix = self.world_from_index
        return np.stack([x, y, z], axis=-1) @ matrix[:3, :3].T + matrix[:3, 3]

    @property
    def longest_ray(self) -> float:
        """World units: the grid's longest diagonal, from border to border."""
        z, y, x = self.shape
        edges = self.world_from_index[:3, :3] * (x + 1, y + 1, z + 1)
        ends = (edges @ np.array([1, *signs]) for signs in itertools.product((1, -1), repeat=2))
        return max(float(np.linalg.norm(end)) for end in ends)

    def line_depths(self) -> list[NDArray[np.float64]]:
        """As `MarchedBody.line_depths`, before ``density_scale``: along x, y and z."""
        return [self.line_sums(axis) * voxel for axis, voxel in zip((2, 1, 0), self.voxel_size, strict=True)]

    def line_sums(self, axis: int) -> NDArray[np.float64]:
        """Sum the voxels along the grid's lines of one direction, before ``density_scale``.

        In a coloured volume a voxel counts with the mean of its three channels.

        Parameters
        ----------
        axis
            0, 1 or 2: along z, y or x.

        Returns
        -------
        float64 [n], in no particular order. Lines that are left out are empty: their sums are 0.
        """
        if self._colour is not None:
            grey: NDArray[np.float64] = self._colour.times_mean().sum(axis=axis, dtype=np.float64)
            return grey.ravel()
        if self._voxels.leaves is not None:
            return self._voxels.leaves.column_sums(axis)[1].ravel()
        sums: NDArray[np.float64] = self._voxels.dense.sum(axis=axis, dtype=np.float64)
        return sums.ravel()

    @property
    def content(self) -> tuple[int, ...]:
        """Numbers that tell its voxels, and their colour, from all others of this process.

        They are the same for volumes that share these, and never given twice.
        """
        return (self._voxels.number,) if self._colour is None else (self._voxels.number, self._colour.number)

    @property
    def density_key(self) -> tuple[Any, ...]:
        """All that its density in space depends on."""
        return self.content, self.density_scale, self.world_from_index.tobytes()

    @property
    def digest(self) -> str:
        """As `MarchedBody.digest`."""
        parts = (self._voxels,) if self._colour is None else self._colour.products
        held = "".join(voxels.digest for voxels in parts)
        return digest_of(held, np.array([self.density_scale]), self.world_from_index)

    def same_voxels(self, other: Volume) -> bool:
        """Tell whether both hold the very same voxels and colour in memory, wherever and at any scale."""
        return self._voxels.stored is other._voxels.stored and self.colour is other.colour

    def same_density(self, other: object) -> bool:
        """Tell whether the density is the same everywhere, looking at what it was made from only."""
        return (
            isinstance(other, Volume)
            and self.same_voxels(other)
            and self.density_scale == other.density_scale
            and self.world_from_index is other.world_from_index
        )

    def transformed(self, world_from_volume: ArrayLike) -> Volume:
        """Return the same voxels (not copied) elsewhere: a 4×4 matrix after their own transform."""
        matrix = np.asarray(world_from_volume, dtype=np.float64) @ self.world_from_index
        _check_transform(matrix, self.label)
        matrix.flags.writeable = False
        made_from, moved = self.made_from, np.asarray(world_from_volume, dtype=np.float64)
        if made_from is not None:
            before = said_by(made_from)
            moved = moved if before is None else moved @ before
            made_from = made_from | dict.fromkeys(STEPS) | {"transform": moved.tolist()}
        return self._with(world_from_index=matrix, made_from=made_from)

    def as_stored(self) -> Volume:
        """Return the same voxels (not copied) where their file, or the constructor's transform, puts them."""
        return self._with(world_from_index=self._velocity_from_index)

    def to_table(self) -> dict[str, Any] | None:
        """As `Body.to_table`."""
        medium = None if self.medium is None else self.medium.to_dict()
        if self.made_from is None:
            return None
        return self.made_from | {"density_scale": self.density_scale, "medium": medium}

    def to_arrays(self) -> tuple[str, dict[str, Any], dict[str, NDArray[Any]]]:
        """As `Body.to_arrays`; voxels that are leaves become a dense array."""
        arrays: dict[str, NDArray[Any]] = {"density": self.data, "world_from_index": self.world_from_index}
        keys: dict[str, Any] = {"grid": "density", "density_scale": self.density_scale}
        if self.colour is not None:
            arrays["colour"], keys["colour"] = self.colour, "colour"
        if isinstance(self._asked.source, np.ndarray):
            turned = self.world_from_index[:3, :3] @ np.linalg.inv(self._velocity_from_index[:3, :3])
            arrays["velocity"] = (self._asked.source @ turned.T).astype(np.float32)
            keys |= self._asked.keys() | {"velocity": "velocity"}
        return "file", keys, arrays

    def with_density_scale(self, density_scale: float) -> Volume:
        """Return the same voxels and colours (not copied) under another density scale."""
        return self._with(density_scale=_non_negative(density_scale, "density_scale", self.label))

    def with_velocity(
        self,
        source: VelocitySource | NDArray[Any] = None,
        *,
        scale: float = 1.0,
        fps: float = FRAMES_A_SECOND,
        outlier_threshold: float = OUTLIERS,
    ) -> Volume:
        """Return the same voxels (not copied) that move, for motion blur; the velocity is read when needed.

        Parameters
        ----------
        source
            Where the velocity is: an array [z, y, x, 3] at the voxels, in world units per second along the
            world's x, y and z; or, of a volume of a file, in units of its file, the name of a grid of vectors
            or of an array [z, y, x, 3], a file with one, or three names of grids for x, y and z. None: what
            is called ``v``, ``vel`` or ``velocity``, if there is such. False: it does not move.
        scale
            Factor of the velocity.
        fps
            Frames a second.
        outlier_threshold
            Share of the voxels, those that move fastest along an axis, that are slowed down to the fastest of
            the others; 0: none.

        Raises
        ------
        VolumeError
            An array of another shape or type; numbers out of range.
        """
        if not (abs(scale) <= LARGEST_COLOUR and 0 < fps <= LARGEST_COLOUR and 0 <= outlier_threshold < 1):
            raise VolumeError(
                f"{self.label}: a velocity's scale is a number, fps > 0 and outlier_threshold from 0 to 1; "
                f"got {scale}, {fps} and {outlier_threshold}"
            )
        changes: dict[str, Any] = {}
        if isinstance(source, np.ndarray):
            if source.shape != (*self.shape, 3) or source.dtype.kind not in "fiu":
                raise VolumeError(
                    f"{self.label}: a velocity is an array of real numbers [z, y, x, 3], {[*self.shape, 3]}; "
                    f"got {source.dtype} {list(source.shape)}"
                )
            source = source.astype(np.float32)
            changes = {"made_from": None, "_velocity_from_index": self.world_from_index}
        asked = VelocityAsked(source, scale, fps, outlier_threshold)
        if not isinstance(source, np.ndarray) and self.made_from is not None:
            changes["made_from"] = self.made_from | asked.keys() | {"velocity": _told_velocity(source)}
        return self._with(_asked=asked, **changes)

    @property
    def velocity(self) -> Velocity | None:
        """How fast what it holds moves, read when first asked for; None where nothing says so.

        Raises
        ------
        VolumeError
            What was named does not exist or cannot be used; the message says why.
        """
        kept = self.kept.get("velocity")
        if kept is None or kept[0] is not self._asked:
            stored, found = self._stored_velocity(), None
            if stored is not None:
                place = self._velocity_from_index
                found = velocity_of(stored, self._asked, place, sanitize=self.sanitize)
            kept = self.kept["velocity"] = self._asked, found
        velocity: Velocity | None = kept[1]
        return velocity

    def _stored_velocity(self) -> StoredVelocity | None:
        source = self._asked.source
        if isinstance(source, np.ndarray):
            return StoredVelocity(f"{self.label}: the velocity", components_of(source))
        return None if self.source is None else read_velocity(self.source, self.shape, source)

    def moved_to(self, channels: Sequence[Leaves], low: Sequence[int]) -> Volume:
        """Return the volume when its contents have moved: others in the place of its voxels.

        Parameters
        ----------
        channels
            Its voxels, or, where it has a colour, what it is in red, green and blue.
        low
            Index (x, y, z), among the voxels that it has now, of the first of these.
        """
        shift = np.eye(4)
        shift[:3, 3] = low
        place = self.world_from_index @ shift
        place.flags.writeable = False
        voxels, colour = _Voxels(channels[0]), None
        if self._colour is not None:
            most = np.maximum.reduce([leaves.values for leaves in channels])
            voxels = _Voxels(Leaves(channels[0].shape, channels[0].first, channels[0].coordinates, most))
            colour = _Channels(voxels, channels)
        other = self._with(_voxels=voxels, _colour=colour, world_from_index=place, made_from=None, kept={})
        return other.with_velocity(source=False)

    def with_medium(self, medium: Medium | None) -> Volume:
        """Return the same voxels (not copied) of another medium; None: the scene's."""
        return self._with(medium=parse_medium(medium))

    def _with(self, **changes: Any) -> Volume:
        other = object.__new__(Volume)
        kept = {name: value for name, value in self.__dict__.items() if name != "channels"}
        other.__dict__.update(kept | changes)
        return other

    def equals(self, other: object) -> bool:
        """As `Body.equals`; sparse voxels do not equal dense ones."""
        return isinstance(other, Volume) and same(self._told, other._told)  # noqa: SLF001 - the same class

    @property
    def _told(self) -> tuple[Any, ...]:
        colour = None if self._colour is None else self._colour.told
        return self._voxels.stored, colour, self.density_scale, self.world_from_index, self.medium

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what was made of it, as for a device."""
        return {name: value for name, value in vars(self).items() if name != "channels"} | {"kept": {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.world_from_index.flags.writeable = False

    def __repr__(self) -> str:
        z, y, x = self.shape
        coloured = "" if self.colour is None else "coloured, "
        return f"Volume({self.label}, {x}×{y}×{z} voxels, {coloured}density_scale={self.density_scale:g})"

    @property
    def label(self) -> str:
        """What messages call it."""
        if self.source is None:
            return self.name or "array"
        return f"{self.source}: grid {shown(self.name)}" if self.name else str(self.source)


_NUMBERS = itertools.count()
"""Of voxels and colours, in the order in which this process made them."""


class _Voxels:
    """Voxels in the form they came in, and what was made of them; shared by volumes of another scale."""

    def __init__(self, stored: NDArray[np.float32] | Leaves) -> None:
        self.stored = stored
        self.number = next(_NUMBERS)

    def __reduce__(self) -> tuple[Any, ...]:
        """Be another elsewhere: numbers are a process's own."""
        return _voxels_of, (self.stored,)

    @property
    def leaves(self) -> Leaves | None:
        return self.stored if isinstance(self.stored, Leaves) else None

    @property
    def shape(self) -> Index:
        z, y, x = self.stored.shape
        return z, y, x

    @cached_property
    def dense(self) -> NDArray[np.float32]:
        if not isinstance(self.stored, Leaves):
            return self.stored
        dense = self.stored.to_dense()
        dense.flags.writeable = False
        return dense

    @cached_property
    def digest(self) -> str:
        """Of the contents, in the form they came in."""
        stored = self.stored
        if isinstance(stored, Leaves):
            return digest_of(f"{stored.shape} {stored.first}", stored.coordinates, stored.values)
        return digest_of("dense", stored)

    @cached_property
    def typical(self) -> float:
        """Mean of the voxels weighted by themselves; 0 when all are 0."""
        if isinstance(self.stored, Leaves):
            return self.stored.typical()
        total = float(self.stored.sum(dtype=np.float64))
        squares = sum(float(np.square(layer, dtype=np.float64).sum()) for layer in self.stored)
        return squares / total if total > 0 else 0.0

    @cached_property
    def occupied_box(self) -> tuple[Index, Index] | None:
        """First and last voxel (z, y, x) of the box around the voxels > 0."""
        if isinstance(self.stored, Leaves):
            return self.stored.occupied_box()
        ends = []
        for others in ((1, 2), (0, 2), (0, 1)):
            occupied = np.flatnonzero(self.stored.max(axis=others) > 0)
            if occupied.size == 0:
                return None
            ends.append((int(occupied[0]), int(occupied[-1])))
        (z, last_z), (y, last_y), (x, last_x) = ends
        return (z, y, x), (last_z, last_y, last_x)


def _voxels_of(stored: NDArray[np.float32] | Leaves) -> _Voxels:
    if isinstance(stored, np.ndarray):
        stored.flags.writeable = False
    return _Voxels(stored)


class _Colour:
    """The colour of voxels, and what they are in each channel; shared by volumes of another scale."""

    def __init__(self, voxels: _Voxels, rgb: ArrayLike, label: str, *, sanitize: bool) -> None:
        self.number = next(_NUMBERS)
        self._rgb = _as_colour(rgb, voxels.shape, label, sanitize=sanitize)
        self._voxels = voxels
        largest = float(voxels.stored.max()) * float(self.rgb.max())  # NaN where there are no leaves
        if largest > float(np.finfo(np.float32).max):
            raise VolumeError(f"{label}: the largest density times the largest colour is beyond float32")

    @property
    def rgb(self) -> NDArray[np.float32]:
        return self._rgb

    @property
    def told(self) -> Any:
        """All that it was made from, beside the voxels."""
        return self._rgb

    def __getstate__(self) -> dict[str, Any]:
        return {"_rgb": self._rgb, "_voxels": self._voxels}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Be another elsewhere, as `_Voxels`."""
        vars(self).update(state, number=next(_NUMBERS))
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @cached_property
    def products(self) -> tuple[_Voxels, ...]:
        """Voxels times red, green and blue, in the form that the voxels came in."""
        dense = self._dense()
        found = []
        for channel in range(3):
            product = dense * self.rgb[..., channel]
            product.flags.writeable = False
            found.append(_Voxels(product if self._voxels.leaves is None else Leaves.from_dense(product)))
        return tuple(found)

    def times_mean(self) -> NDArray[np.float32]:
        """Voxels [z, y, x] times the mean of the channels."""
        product: NDArray[np.float32] = self._dense() * self.rgb.mean(axis=-1)
        return product

    def _dense(self) -> NDArray[np.float32]:
        leaves = self._voxels.leaves
        return self._voxels.dense if leaves is None else leaves.to_dense()  # not to be kept


class _Channels(_Colour):
    """The colour of voxels of which it is known what they are in each channel."""

    def __init__(self, voxels: _Voxels, channels: Sequence[NDArray[np.float32] | Leaves]) -> None:
        self.number = next(_NUMBERS)
        self._voxels = voxels
        self.products = tuple(_Voxels(channel) for channel in channels)

    @property
    def told(self) -> Any:
        """As `_Colour.told`."""
        return [product.stored for product in self.products]

    def __getstate__(self) -> dict[str, Any]:
        return {"products": self.products, "_voxels": self._voxels}

    @cached_property
    def rgb(self) -> NDArray[np.float32]:
        """Each channel over the voxels, which are the largest of all."""
        most = self._dense()[..., None]
        channels = np.stack([product.dense for product in self.products], axis=-1)
        return np.divide(channels, most, out=np.zeros_like(channels), where=most > 0)


def bounds_of(shape: tuple[int, int, int], world_from_index: NDArray[np.float64]) -> NDArray[np.float64]:
    """World-space box around a grid of ``shape`` (z, y, x) and its border voxel."""
    z, y, x = shape
    return _world_box(world_from_index, (-1, -1, -1), (x, y, z))


def _world_box(
    world_from_index: NDArray[np.float64], low: Sequence[float], high: Sequence[float]
) -> NDArray[np.float64]:
    """World-space axis-aligned box around the index-space box from ``low`` to ``high`` (x, y, z)."""
    return _box_of_corners(world_from_index.tobytes(), *low, *high).copy()


@lru_cache(maxsize=256)
def _box_of_corners(matrix: bytes, *ends: float) -> NDArray[np.float64]:
    """`_world_box`, cached, since every frame asks for it often."""
    world_from_index = np.frombuffer(matrix).reshape(4, 4)
    corners = np.array(list(itertools.product(*zip(ends[:3], ends[3:], strict=True))), dtype=np.float64)
    world = corners @ world_from_index[:3, :3].T + world_from_index[:3, 3]
    return np.array([world.min(axis=0), world.max(axis=0)])


def _as_density(data: ArrayLike, label: str, *, sanitize: bool) -> NDArray[np.float32]:
    array = np.asarray(data)
    _check_shape(array.shape, label)
    if array.dtype.kind not in "fiub":
        raise VolumeError(f"{label}: densities are real numbers; these are of type {array.dtype}")
    density = _as_float32(array)
    # One pass over min and max finds all three defects without a mask of the volume's size.
    low, high = float(density.min()), float(density.max())
    if not (np.isfinite(low) and np.isfinite(high) and low >= 0.0):
        wrong = ~np.isfinite(density) | (density < 0)
        if not sanitize:
            z, y, x = (int(i) for i in np.argwhere(wrong)[0])
            raise _not_densities(
                NotDensities(int(np.count_nonzero(wrong)), (z, y, x), float(density[z, y, x])), label
            )
        if not density.flags.writeable:
            density = density.copy()
        density[wrong] = 0.0
    density.flags.writeable = False
    return density


def _as_float32(array: NDArray[Any]) -> NDArray[np.float32]:
    """Keep an array of float32 that nobody can write to, or copy it; what is too large becomes infinite."""
    if array.dtype == np.float32 and array.flags.c_contiguous and array.flags.aligned and _is_frozen(array):
        return array
    with np.errstate(over="ignore"):
        return np.array(array, dtype=np.float32, order="C")


def _as_colour(colour: ArrayLike, shape: Index, label: str, *, sanitize: bool) -> NDArray[np.float32]:
    array = np.asarray(colour)
    label = f"{label}: the colour"
    check_array(array.shape, array.dtype, shape, label)
    return checked(_as_float32(array), label, sanitize=sanitize)


def _as_density_leaves(leaves: Leaves, label: str, *, sanitize: bool) -> Leaves:
    _check_shape(leaves.shape, label)
    wrong = leaves.not_densities()
    if wrong is None:
        return leaves
    if not sanitize:
        raise _not_densities(wrong, label)
    return leaves.sanitized()


def _check_shape(shape: tuple[int, ...], label: str) -> None:
    if len(shape) != 3 or 0 in shape:  # noqa: PLR2004 - a volume has three axes
        raise VolumeError(f"{label}: a volume is a non-empty array [z, y, x]; this one has the shape {shape}")


def _not_densities(wrong: NotDensities, label: str) -> VolumeError:
    z, y, x = wrong.first
    return VolumeError(
        f"{label}: {wrong.total} densities are negative, infinite or NaN, the first "
        f"{wrong.value:g} at [z={z}, y={y}, x={x}]; set them to 0 with --set volume.sanitize=true, or shift "
        "a file's values with --set volume.offset=X"
    )


def _is_frozen(array: NDArray[Any]) -> bool:
    """Whether nobody can write to an array, or to what it is a view of."""
    owner: Any = array
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            return False
        owner = owner.base
    try:
        return owner is None or memoryview(owner).readonly
    except TypeError:
        return False


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


def _told_colour(colour: ColourSource, volume: Volume, path: Path) -> Any:
    """Return what a scene file says of where the colour is that has been read."""
    if isinstance(colour, Path):
        return str(real_path(colour))
    if isinstance(colour, str):
        return str(real_path(source_of(colour))) if volume_io.is_volume_file(colour) else colour
    if colour is None:
        return COLOUR if volume.colour is not None and path.suffix.lower() == ".npz" else None
    return colour if colour is False else list(colour)


def _told_velocity(source: VelocitySource) -> Any:
    """Return what a scene file says of where a velocity is."""
    if isinstance(source, Path) or (isinstance(source, str) and volume_io.is_volume_file(source)):
        return str(real_path(source_of(source)))
    return source if source is None or source is False or isinstance(source, str) else list(source)


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


def _trilinear(data: NDArray[np.float32], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of data [z, y, x] at indices z, y, x [n, 3], interpolated; 0 at the indices outside; [n]."""
    low = np.floor(at)
    after = at - low
    values = np.zeros(len(at))
    for corner in np.ndindex(2, 2, 2):
        index = low + corner
        inside = ((index >= 0) & (index < data.shape)).all(axis=1)
        weight = np.where(corner, after, 1 - after).prod(axis=1)
        values[inside] += weight[inside] * data[tuple(index[inside].astype(np.intp).T)]
    return values
