"""What a render returns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, Unpack

import numpy as np
from numpy.typing import NDArray

from tfm_cl._version import __version__
from tfm_cl.files import image_io
from tfm_cl.files.image_io.image import DeepSamples, Image, Metadata
from tfm_cl.plan.orders import orders_of
from tfm_cl.render.rows import rows_at_once
from tfm_cl.scene.background import check_surrounded, radiance_behind
from tfm_cl.scene.layers import GROUPS, Members, members
from tfm_cl.scene.lights.base import names_of
from tfm_cl.scene.settings import Background, ImageSettings

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from tfm_cl.maps.resolved import ResolvedMap
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.scene.scene import Scene


@dataclass
class RenderStats:
    """What a render cost."""

    device: str
    seconds: dict[str, float] = field(default_factory=lambda: {"light_pass": 0.0, "view_pass": 0.0})
    """``compile`` and, where there are solids, ``trace`` on the host, and ``host`` for all else there while
    the device waits; ``light_pass`` and ``view_pass`` on the device, over lights and tiles, and ``orders``
    where later orders of scattering are asked for; ``total`` of everything."""
    samples: dict[str, int] = field(default_factory=lambda: {"light_pass": 0, "view_pass": 0})
    """Density samples of ``light_pass`` and ``view_pass``."""
    made: dict[str, int] = field(default_factory=dict)
    """What was made, as no earlier frame had it, and how many: ``bricks``, ``map``, ``probe``, …"""
    refined_pixels: int = 0
    """Pixels that have more than one sample."""
    map_bytes: int = 0
    """Of the numbers of all maps together."""
    map: ResolvedMap | None = None
    """Of the maps in use, without ``"auto"``; None for the dual march."""
    error_estimate: float | None = None
    """Relative RMSE of the lit pixels against the converged dual march, measured where ``map.max_error`` asks
    for it."""

    def add_map(self, light_map: TransmittanceMap, *, built: bool) -> None:
        """Count a map in use, and its light pass where it was built for this render."""
        if built:
            self.seconds["light_pass"] += light_map.buffers.seconds
        self.samples["light_pass"] += light_map.buffers.samples
        self.map_bytes += light_map.nbytes
        alone = self.map is None
        if not alone and self.map != light_map.settings:
            # Fields have an α of their own: then only the request tells all of them.
            self.map = light_map.settings.replace(density_weighting=None)
        elif alone:
            self.map = light_map.settings

    def add(self, other: RenderStats) -> None:
        """Count another render of the same settings too; what is said of maps stays that of this one."""
        for name, seconds in other.seconds.items():
            self.seconds[name] = self.seconds.get(name, 0.0) + seconds
        for total, more in ((self.samples, other.samples), (self.made, other.made)):
            for name, count in more.items():
                total[name] = total.get(name, 0) + count
        self.refined_pixels = max(self.refined_pixels, other.refined_pixels)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            "device": {"name": self.device},
            "seconds": dict(self.seconds),
            "samples": dict(self.samples),
            "refined_pixels": self.refined_pixels,
            "map_bytes": self.map_bytes,
            "error_estimate": self.error_estimate,
        }


def members_of(scene: Scene, asked: Collection[str]) -> Members:
    """Return the members of the groups of layers that are among those asked for."""
    known: dict[str, Callable[[], Sequence[str]]] = {
        "lights": lambda: names_of(scene.lights),
        "orders": lambda: [str(order) for order in range(1, orders_of(scene) + 1)],
    }
    return {name: known[name]() for name in GROUPS if name in asked}


@dataclass(frozen=True, eq=False)
class RenderResult:
    """A picture, its extra layers and what they cost."""

    image: NDArray[np.float32]
    """[H, W, 4]: scene-linear Rec. 709, premultiplied; alpha = 1 - mean transmittance, and 1 on solids but
    holdouts. The ``background``, if any, is added to the colours."""
    aovs: Mapping[str, NDArray[np.float32]]
    """Each made when it is first asked for: ``depth`` and ``samples`` [H, W], ``transmittance`` and
    ``light_transmittance`` [H, W, 3]; with solids, or asked for, ``solid_distance`` [H, W], ``normal`` and
    ``albedo`` [H, W, 3]; the others of `tfm_cl.scene.layers`, and for ``lights`` ``light.NAME`` of each."""
    stats: RenderStats
    scene: Scene
    crop: tuple[int, int, int, int]
    """Pixels x0, y0, x1, y1 of the full frame that ``image`` holds."""
    warnings: tuple[str, ...] = ()
    """Things a user should know: one line each."""
    lit: bool = True
    """Whether the camera sees any of the medium where lights reach, were nothing in their way."""
    meets_medium: bool = True
    """Whether media extinguish or emit anything on any of the rays."""
    background: Background = (0.0, 0.0, 0.0)
    """RGB radiance behind all that ``image`` shows, or ``"environment"``."""
    foreground: NDArray[np.float32] | None = None
    """``image`` without the background; None without one."""
    shows_through: NDArray[np.float32] | None = None
    """[H, W, 3], how much of the background pixels show that are the mean of several; None without such."""
    deep: DeepSamples | None = None
    """What lies along one ray through each pixel's centre, if that was asked for."""

    def __repr__(self) -> str:
        height, width = self.image.shape[:2]
        seconds = self.stats.seconds.get("total", 0.0)
        return f"RenderResult({width}×{height} pixels, {', '.join(self.aovs)}, {seconds:.3g} s)"

    def over(self, background: Any) -> Self:
        """Return the picture over another background.

        Each channel is that without a background plus the background's times the ``transmittance``; no
        background is seen through solids, but for holdouts and `Camera.haze`.

        Parameters
        ----------
        background
            RGB radiance, scene-linear; one number means grey, 0 none. Or ``"environment"``: what the camera
            sees of the scene's environment and sky lights, which add up; each pixel shows the mean over
            about its solid angle.

        Raises
        ------
        SceneError
            Neither; no such light, or an image that cannot be used.
        """
        settings = ImageSettings(background=background)
        bare = self.picture(transparent=True)
        if not settings.has_background:
            return replace(self, image=bare, background=settings.background, foreground=None)
        scene = self.scene
        if settings.shows_environment:
            check_surrounded(scene.lights)
            behind = radiance_behind(scene.lights, scene.camera, self.crop)
        else:
            behind = np.array(settings.background, np.float32)
        behind = np.broadcast_to(behind, bare[..., :3].shape)
        share, image = self.background_share, np.empty_like(bare)
        for rows in rows_at_once(image.shape):
            image[rows] = bare[rows]
            for channel in range(3):  # short axes are slow
                image[rows, :, channel] += share[rows, :, channel] * behind[rows, :, channel]
        return replace(self, image=image, background=settings.background, foreground=bare)

    @property
    def background_share(self) -> NDArray[np.float32]:
        """How much of a background each pixel shows, [H, W, 3]: through solids what haze hides of them."""
        if self.shows_through is not None:
            return self.shows_through
        share = self.aovs["transmittance"]
        if "solid_distance" in self.aovs:
            share, distance = share.copy(), self.aovs["solid_distance"]
            solid = distance > 0
            share[solid] *= (1 - self.scene.camera.seen_of(distance[solid]))[:, None]
        return share

    def picture(self, *, transparent: bool = False) -> NDArray[np.float32]:
        """Return what a PNG shows, [H, W, 4]: with alpha, the picture without its background."""
        return self.image if self.foreground is None or not transparent else self.foreground

    def save(
        self,
        path: str | Path,
        *,
        exposure: image_io.Exposure = 0.0,
        aovs: tuple[str, ...] = (),
        pixel_type: image_io.PixelType = "float",
        compression: image_io.Compression = "zip",
        metadata: dict[str, Metadata] | None = None,
        **png: Unpack[image_io.PngOptions],
    ) -> None:
        """Write ``.exr`` (with the AOVs named), ``.png``, ``.npy`` or ``.deep.exr``, whole or not at all.

        Parameters
        ----------
        exposure
            Stops, or ``"auto"``, for PNG.
        aovs
            Layers to add to an EXR, ``lights`` for those of all lights; other files have no room for them
            (`image_io.holds_layers`).
        pixel_type
            ``float`` or ``half``, of an EXR's colours.
        compression
            Of an EXR, as of `image_io.save`.
        metadata
            Further EXR attributes; camera matrices and the version are always written.
        **png
            For PNG: ``view``, ``transparent``, ``png_bits`` and ``dither`` of `image_io.PngOptions`.

        Raises
        ------
        ImageError
            Unknown extension, an option that is none, no deep samples for a deep file, or the file cannot be
            written.
        """
        camera = self.scene.camera
        of_groups = members_of(self.scene, aovs)
        camera_from_world = np.linalg.inv(camera.world_from_camera).astype(np.float64)
        picture = Image(
            rgba=self.image,
            foreground=self.foreground,
            aovs={name: self.aovs[name] for asked in aovs for name in members(asked, of_groups)},
            display_window=camera.res,
            crop=self.crop,
            deep=self.deep,
            metadata={
                "software": f"tfm_cl {__version__}",
                "tfm_cl:device": self.stats.device,
                "worldToCamera": camera_from_world,
                "worldToNDC": camera.ndc_from_camera @ camera_from_world,
                **(metadata or {}),
            },
        )
        image_io.save(path, picture, exposure=exposure, pixel_type=pixel_type, compression=compression, **png)

    def _repr_png_(self, *, exposure: image_io.Exposure = 0.0, **png: Unpack[image_io.PngOptions]) -> bytes:
        """Show the picture in a notebook, which gives no options; those of `save` may be given by hand."""
        from tfm_cl.files.image_io.png import png_bytes  # noqa: PLC0415 - only notebooks need it

        picture = self.picture(transparent=png.get("transparent", False))
        return png_bytes(picture, exposure, corner=self.crop[:2], **png)

    def _repr_html_(self) -> str:
        """Show the picture and a row of its layers in a notebook."""
        from tfm_cl.render.html import html_of  # noqa: PLC0415 - only notebooks need it

        return html_of(self, repr(self))
