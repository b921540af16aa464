"""Motion blur: the mean of sharp pictures of the moments that an open shutter shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.device.advection import moved
from tfm_cl.errors import SceneError
from tfm_cl.interrupts import check_cancelled
from tfm_cl.scene.bodies.flame import flame_in, heat_of, keep_flame
from tfm_cl.scene.bodies.primitives import Primitives
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.layers import LAYERS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tfm_cl.device.cache import Cache
    from tfm_cl.device.launch import Launcher, Progress
    from tfm_cl.render.result import RenderResult
    from tfm_cl.scene.bodies.base import Body
    from tfm_cl.scene.bodies.velocity import Velocity
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene

NOTHING_MOVES = (
    "image.shutter: nothing moves while it is open: there are no keyframes, and no body has velocities"
)


def moments_of(shutter: tuple[float, float], count: int) -> list[float]:
    """Return the middles of as many equal parts of the time that a shutter is open."""
    opens, closes = shutter
    return [opens + (closes - opens) * (number + 0.5) / count for number in range(count)]


class Mover:
    """Moves what has velocities.

    Parameters
    ----------
    launcher
        The device, which moves what grids hold.
    cache
        Of the session: moved grids.
    """

    def __init__(self, launcher: Launcher, cache: Cache) -> None:
        self._launcher, self._cache = launcher, cache

    def moved(self, scene: Scene, frames: float) -> Scene:
        """Return a scene so many frames later, or earlier: itself where nothing has velocities.

        Raises
        ------
        VolumeError
            A velocity that cannot be read or used.
        """
        if not frames:
            return scene
        bodies = tuple(self._body(body, scene.medium_of(body), frames) for body in scene.bodies)
        same = all(one is other for one, other in zip(bodies, scene.bodies, strict=True))
        return scene if same else scene.replace(volume=bodies)

    def _body(self, body: Body, medium: Medium, frames: float) -> Body:
        if isinstance(body, Primitives):
            return body.moved(frames)
        if not isinstance(body, Volume) or (velocity := body.velocity) is None:
            return body
        key = (*body.density_key, velocity.number, frames, heat_of(medium))
        made = self._cache.get("moved", key, lambda: self._volume(body, velocity, medium, frames), _bytes_of)
        return body if made is None else made.with_medium(body.medium)

    def _volume(self, body: Volume, velocity: Velocity, medium: Medium, frames: float) -> Volume | None:
        found = moved(self._launcher, body.channel_leaves, body.leaves, velocity, frames)
        if found is None:
            return None
        later = body.moved_to(found.channels, found.low)
        flame = flame_in(body, medium)
        if flame is not None:
            own = velocity.within(flame.world_from_index)
            glow = moved(self._launcher, flame.channel_leaves, flame.leaves, own, frames)
            flame = flame if glow is None else flame.moved_to(glow.channels, glow.low)
            back = np.eye(4)
            back[:3, 3] = np.negative(found.low)
            keep_flame(later, medium, flame.transformed(back))
        return later


def _bytes_of(volume: Volume | None) -> int:
    return 0 if volume is None else sum(leaves.nbytes for leaves in volume.channel_leaves)


class Moments:
    """The scene at the moments that a shutter shows.

    Parameters
    ----------
    scene
        One, or what returns that of any moment, given the frames that have passed.
    shutter, count
        When it opens and closes, in frames, and how many moments there are.
    move
        Moves what has velocities.
    """

    def __init__(
        self,
        scene: Scene | Callable[[float], Scene],
        shutter: tuple[float, float],
        count: int,
        move: Callable[[Scene, float], Scene],
    ) -> None:
        self._scene, self._move = scene, move
        self._middle_at, self._moments = sum(shutter) / 2, moments_of(shutter, count)
        if count % 2:
            self._moments[count // 2] = self._middle_at
        self._moves = shutter[0] < shutter[1]
        self.middle = self._at(self._middle_at)
        """The scene half-way."""

    def _at(self, frames: float) -> Scene:
        scene = self._scene(frames) if callable(self._scene) else self._scene
        return self._move(scene, frames)

    def rendered(self, render: Callable[[Scene, Progress], RenderResult], progress: Progress) -> RenderResult:
        """Render each moment, and return their mean; the same scene is not rendered twice in a row.

        Parameters
        ----------
        render
            Renders one; told of its progress.
        progress
            Told of all.

        Raises
        ------
        SceneError
            Pictures of other sizes, or lights of other names whose layers are asked for.
        """
        last = self.middle
        result = sharp = render(self.middle, _part_of(progress, 0, len(self._moments) + 1))
        mean, still = _Mean(sharp), True
        for number, frames in enumerate(self._moments, 1):
            scene = self.middle if frames == self._middle_at else self._at(frames)
            if scene is self.middle or scene == self.middle:
                scene, result = self.middle, sharp
            elif scene != last:
                still = False
                result = render(scene, _part_of(progress, number, len(self._moments) + 1))
                mean.count(result)
            mean.add(result)
            last = scene
        told = (NOTHING_MOVES,) if still and self._moves else ()
        return replace(mean.result(), warnings=(*mean.warnings, *told))


def _part_of(progress: Progress, number: int, count: int) -> Progress:
    """Tell of one picture of several."""
    return lambda stage, fraction: progress(stage, (number + fraction) / count)


class _Mean:
    """Sums of pictures; stats, scene and what is not blurred are those of the middle."""

    def __init__(self, middle: RenderResult) -> None:
        self._middle, self._count = middle, 0
        self._sums: dict[str, NDArray[np.float64]] = {}
        self._lit, self._meets = middle.lit, middle.meets_medium
        self.warnings = dict.fromkeys(middle.warnings)

    def count(self, result: RenderResult) -> None:
        """Count what a picture cost, and what it tells."""
        self._middle.stats.add(result.stats)
        self.warnings |= dict.fromkeys(result.warnings)
        self._lit, self._meets = self._lit or result.lit, self._meets or result.meets_medium

    def add(self, result: RenderResult) -> None:
        """Add a picture and its layers; raises `SceneError` where it is no other moment of the same."""
        self._check(result)
        self._count += 1
        self._put("image", result.image)
        self._put("through", result.background_share)
        if result.foreground is not None:
            self._put("foreground", result.foreground)
        for name in result.aovs:
            if _blurred(name) != "middle":
                self._put(f"aov.{name}", result.aovs[name])

    def _check(self, result: RenderResult) -> None:
        """Refuse pictures of other sizes, and with other layers."""
        sizes = [one.image.shape[1::-1] for one in (self._middle, result)]
        if sizes[0] != sizes[1]:
            middle, other = ("×".join(map(str, size)) for size in sizes)
            raise SceneError(
                f"image.shutter: the picture is {middle} pixels half-way and {other} at another moment; keep "
                "camera.res as it is while the shutter is open"
            )
        strange = sorted(self._middle.aovs.keys() ^ result.aovs.keys())
        if strange:
            raise SceneError(
                f"image.shutter: there is a layer {strange[0]} at some moments only; keep the names of "
                "lights as they are while the shutter is open"
            )

    def _put(self, name: str, values: NDArray[np.float32]) -> None:
        check_cancelled()
        if name in self._sums:
            self._sums[name] += values
        else:
            self._sums[name] = values.astype(np.float64)

    def _of(self, name: str, *, total: bool = False) -> NDArray[np.float32]:
        check_cancelled()
        found = self._sums[name] / (1 if total else self._count)
        return found.astype(np.float32)

    def result(self) -> RenderResult:
        """Return the mean of all that were added."""
        aovs = {
            name: layer
            if _blurred(name) == "middle"
            else self._of(f"aov.{name}", total=_blurred(name) == "sum")
            for name, layer in self._middle.aovs.items()
        }
        return replace(
            self._middle,
            image=self._of("image"),
            aovs=aovs,
            foreground=self._of("foreground") if "foreground" in self._sums else None,
            shows_through=self._of("through"),
            lit=self._lit,
            meets_medium=self._meets,
        )


def _blurred(name: str) -> str:
    """How a layer is blurred; those of each light are means."""
    return LAYERS[name].blurred if name in LAYERS else "mean"
