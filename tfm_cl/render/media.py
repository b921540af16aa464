"""Media of scenes on the device: kept for the next frames, or made while another frame is rendered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tfm_cl.device.ahead import keep_ahead
from tfm_cl.device.bricks import build_bricks
from tfm_cl.device.frame import world_from_device
from tfm_cl.device.margins import camera_margin, light_margin
from tfm_cl.device.media import media_on_device
from tfm_cl.device.primitives import PrimitivesOnDevice

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.device.bricks import BrickGrid
    from tfm_cl.device.cache import Cache
    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.scene.bodies import Volume
    from tfm_cl.scene.scene import Scene

Key = tuple[Any, ...]

SHARE_AHEAD = 1 / 16
"""Of the bytes that are kept: what the voxels of such a scene have at most. Larger ones are made in turn,
when those of the frame before are given back."""


@dataclass(frozen=True)
class _Ahead:
    """Media of a scene whose turn is yet to come."""

    bricks: BrickGrid
    key: Key
    media: MediaOnDevice


class Media:
    """Puts the media of scenes on a device.

    Parameters
    ----------
    launcher
        The device.
    cache
        Of the session: bricks and primitives.
    """

    def __init__(self, launcher: Launcher, cache: Cache) -> None:
        self._launcher, self._cache = launcher, cache
        self._last: tuple[Key, MediaOnDevice] | None = None
        self._last_bricks: Key | None = None
        self._ahead: dict[Key, _Ahead] = {}

    def clear(self) -> None:
        """Keep nothing."""
        self._last = self._last_bricks = None
        self._ahead.clear()

    def of(self, scene: Scene, maps: Sequence[TransmittanceMap] | None) -> MediaOnDevice:
        """Put the media of a scene of single lights on the device; those of the last frame are there.

        Where maps are there already, and speak of the bounds' rays, these bounds stay.
        """
        margin = _margin(scene)
        if maps and maps[0].settings.range == "box":
            margin = maps[0].margin
        bricks, ahead = None, None
        if _grids(scene):
            self._last_bricks = bricks_key = _bricks_key(scene)
            ahead = self._ahead.pop(bricks_key, None)
            if ahead is not None:
                ahead.bricks.filling.give_up()
                if ahead.bricks.filling.has_failed:
                    ahead = None  # what failed beside another frame may not fail now
            bricks = self._cache.get(
                "bricks",
                bricks_key,
                lambda: self._build_bricks(scene) if ahead is None else ahead.bricks,
                lambda built: built.nbytes,
                held=True,
                serves=lambda kept: not kept.filling.has_failed,
            )
            bricks.filling.wait()
        primitives = self._primitives(scene) if scene.primitives else None
        key = _media_key(scene, margin)
        kept, media = self._last or (None, None)
        if media is None or kept != key or media.bricks is not bricks or media.primitives is not primitives:
            if ahead is not None and ahead.key == key and ahead.bricks is bricks and primitives is None:
                media = ahead.media
            else:
                media = media_on_device(self._launcher, scene, bricks, primitives, margin)
            self._last = key, media
        return media

    def prepare(self, beside: Launcher, scene: Scene) -> tuple[bool, MediaOnDevice | None]:
        """Put what `of` will be asked for on the device, from another thread; what is large is left to it.

        Parameters
        ----------
        beside
            Of that thread.

        Returns
        -------
        Whether its voxels are there, and its media, if they were made now.
        """
        grids = _grids(scene)
        if not grids or scene.primitives:
            return False, None
        key = _bricks_key(scene)
        if key == self._last_bricks or key in self._ahead:
            return True, None
        leaves = [grid.channel_leaves for grid in grids]
        nbytes = sum(one.nbytes for channels in leaves for one in channels)
        if nbytes > SHARE_AHEAD * self._cache.budget:
            return False, None
        bricks = build_bricks(beside, leaves, _what(grids), scene.march.voxels)
        margin = _margin(scene)
        media = media_on_device(beside, scene, bricks, None, margin)
        keep_ahead(self._ahead, key, _Ahead(bricks, _media_key(scene, margin), media))
        return True, media

    def _primitives(self, scene: Scene) -> PrimitivesOnDevice:
        """Put the primitives of a scene on the device; those of the last frames are there."""
        return self._cache.get(
            "primitives",
            (tuple(body.density_key for body in scene.primitives), world_from_device(scene).tobytes()),
            lambda: PrimitivesOnDevice(self._launcher, scene),
            lambda made: made.nbytes,
        )

    def _build_bricks(self, scene: Scene) -> BrickGrid:
        self._last = None  # gives back its voxels first
        grids = _grids(scene)
        leaves = [grid.channel_leaves for grid in grids]
        return build_bricks(self._launcher, leaves, _what(grids), scene.march.voxels)


def _grids(scene: Scene) -> tuple[Volume, ...]:
    return (*scene.grids, *scene.flames)


def _bricks_key(scene: Scene) -> Key:
    return (scene.march.voxels, *(grid.content for grid in _grids(scene)))


def _media_key(scene: Scene, margin: float) -> Key:
    """All that media depend on, but where the device has voxels and primitives."""
    return (
        scene.bodies,
        tuple(body.density_key for body in (*scene.marched, *scene.flames)),
        scene.medium,
        scene.spreads,
        tuple(scene.medium_of(body).phase.content for body in scene.bodies),
        scene.march.skip_empty,
        world_from_device(scene).tobytes(),
        margin,
    )


def _margin(scene: Scene) -> float:
    return max(light_margin(scene), camera_margin(scene))


def _what(grids: Sequence[Volume]) -> str:
    """Return what messages call the voxels of grids."""
    return "the volume ({})".format(", ".join("{2}×{1}×{0} voxels".format(*grid.shape) for grid in grids))
