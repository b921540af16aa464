"""One frame of a shot, from its scene file to its pictures, in three steps.

`read` needs no device, and neither does `RenderedFrame.save`: other frames may be rendered meanwhile.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tfm_cl.errors import SceneError
from tfm_cl.files import image_io
from tfm_cl.files.image_io.display import automatic_exposure
from tfm_cl.plan import options
from tfm_cl.plan.plan import Plan, plan
from tfm_cl.scene.scene import Scene
from tfm_cl.scene.scene_file import Made

if TYPE_CHECKING:
    from tfm_cl.device.launch import Progress
    from tfm_cl.render.result import RenderResult
    from tfm_cl.scene.scene_file import SceneFile, Values
    from tfm_cl.scene.settings import ImageSettings
    from tfm_cl.sequence.renderer import Renderer


@dataclass(frozen=True)
class ReadFrame:
    """A frame that is read and planned."""

    number: float | None
    """None of what does not change."""
    file: SceneFile
    scene: Scene
    planned: Plan
    options: Values
    """All options as resolved, in the shape of a scene file."""

    def warnings(self) -> tuple[str, ...]:
        """Tell, one line each, what the file leaves out and most likely should not."""
        return options.warnings(self.file, self.scene)

    def warnings_of_scene(self) -> tuple[str, ...]:
        """Tell, one line each, what a scene file of this frame alone leaves out."""
        lost = self.file.lost_motion
        return () if lost is None else (f"{lost}; the scene file leaves it out",)

    def read_files(self) -> None:
        """Read what rendering needs besides: solids, textures, phase functions.

        Raises
        ------
        SceneError, ImageError
            Files that are missing, with the lines that name them, or cannot be read.
        """
        self.file.check_files()
        self.scene.read_files()

    def at(self, after: float) -> Scene:
        """Return the scene so many frames later, or earlier, by its keyframes; files stay the frame's.

        Raises
        ------
        SceneError, VolumeError
            As `SceneFile.make`.
        """
        file = self.file.moment(after) if after else self.file
        return self.scene if file is self.file else file.make(Scene, Made(self.file, self.scene.bodies))

    def render(
        self, renderer: Renderer, pictures: Sequence[Path], progress: Progress | None = None
    ) -> RenderedFrame:
        """Render it.

        Parameters
        ----------
        pictures
            That it will be saved as: their formats tell what is needed.

        Raises
        ------
        SceneError, VolumeError, DeviceError
            As of the renderer; a deep image that is to be blurred.
        """
        image = self.file.image
        if image.is_blurred:
            asked = {**image.frame, "shutter": image.shutter, "motion_samples": image.motion_samples}
            check_blurred(image, pictures)
            result = renderer.render_blurred(self.at, progress=progress, **asked)
        else:
            result = renderer.render(self.scene, progress=progress, **_asked(image, pictures))
        return self._rendered(result, pictures)

    def begin(
        self, renderer: Renderer, pictures: Sequence[Path], progress: Progress | None = None
    ) -> Callable[[], RenderedFrame]:
        """Begin to render it; what is returned waits for it, and other frames may be begun before.

        As `render`; what is blurred has ended already.
        """
        image = self.file.image
        if image.is_blurred:
            done = self.render(renderer, pictures, progress)
            return lambda: done
        result = renderer.begin(self.scene, progress=progress, **_asked(image, pictures))
        return lambda: self._rendered(result(), pictures)

    def _rendered(self, result: RenderResult, pictures: Sequence[Path]) -> RenderedFrame:
        from tfm_cl.render.diagnosis import too_dark  # noqa: PLC0415 - reading needs no OpenCL

        image = self.file.image
        # What is not there yet, or any more, was asked for.
        warnings, resolved = [] if self.file.is_empty else list(result.warnings), dict(self.options)
        stops = _exposure(result, pictures, image)
        if stops is not None:
            dark = too_dark(result, stops, image.view, transparent=image.transparent)
            warnings += filter(None, [None if self.file.is_empty else dark])
            resolved["image"] = resolved["image"] | {"exposure": stops}
        resolved["map"] = _used_map(resolved["map"], result)
        resolved["march"] = resolved["march"] | {"steps": result.scene.march.steps}
        planned = self.planned.completed(result.scene, result.stats.map, result.stats.error_estimate, stops)
        return RenderedFrame(self, result, tuple(warnings), stops, planned, resolved)


@dataclass(frozen=True)
class RenderedFrame:
    """A frame that is rendered."""

    read: ReadFrame
    result: RenderResult
    warnings: tuple[str, ...]
    """What a user should know: one line each."""
    stops: float | None
    """Exposure of its PNGs; None without one."""
    planned: Plan
    options: Values
    """As `ReadFrame.options`, with what rendering found out."""

    def save(self, pictures: Sequence[Path]) -> None:
        """Write its pictures, each whole or not at all.

        Raises
        ------
        ImageError
            A file cannot be written.
        """
        image = self.read.file.image
        for path in pictures:
            self.result.save(
                path,
                exposure=self.options["image"]["exposure"],
                aovs=image.aov,
                pixel_type=image.pixel_type,
                compression=image.compression,
                metadata={"tfm_cl:options": json.dumps(self.options)},
                **image.png,
            )

    def report(self) -> dict[str, Any]:
        """Return options, plan and figures, for JSON."""
        report = {"options": self.options, "plan": self.planned.to_dict()} | self.result.stats.to_dict()
        return report if self.read.number is None else {"frame": self.read.number} | report


def read(file: SceneFile, number: float | None, like: ReadFrame | None = None) -> ReadFrame:
    """Read the volumes of a frame's scene file, and plan it; solids and textures are read later.

    Parameters
    ----------
    like
        The same with other settings, or another frame: what is the same is taken from there.

    Raises
    ------
    SceneError, VolumeError
        As `SceneFile.make`.
    """
    scene = file.make(Scene, None if like is None else Made(like.file, like.scene.bodies, is_moment=False))
    planned = plan(scene, file=file)
    return ReadFrame(number, file, scene, planned, options.table(file, planned.scene))


def check_blurred(image: ImageSettings, pictures: Sequence[Path]) -> None:
    """Refuse pictures that cannot be blurred.

    Raises
    ------
    SceneError
        A deep image.
    """
    deep = [path for path in pictures if image_io.is_deep(path)]
    if image.is_blurred and deep:
        raise SceneError(
            f"image.shutter = {list(image.shutter or ())}: {deep[0].name} is deep, and its samples lie along "
            "the rays of one moment; render it without a shutter, as --shutter 0,0"
        )


def _asked(image: ImageSettings, pictures: Sequence[Path]) -> dict[str, Any]:
    """Return what the renderer is asked for; deep images have no use for several samples of a pixel."""
    deep = [image_io.is_deep(path) for path in pictures]
    asked: dict[str, Any] = {**image.frame, "deep_colour": image.deep_colour}
    only_deep = bool(deep) and all(deep)
    return (
        asked | ({"deep": image.deep_tolerance} if any(deep) else {}) | ({"samples": 1} if only_deep else {})
    )


def _exposure(result: RenderResult, pictures: Sequence[Path], image: ImageSettings) -> float | None:
    """Return the stops of the PNGs; None without one."""
    if not any(path.suffix.lower() == ".png" for path in pictures):
        return None
    if image.exposure != "auto":
        return image.exposure
    picture = result.picture(transparent=image.transparent)
    return automatic_exposure(picture, image.view, transparent=image.transparent)


def _used_map(asked: Values, result: RenderResult) -> Values:
    """Return what the map's settings came to; asked for: those of the scene."""
    used = result.stats.map
    if used is None:
        return asked
    # Where the target is not the transmittance, α means nothing.
    alpha = {} if used.target == "transmittance" else {"density_weighting": asked["density_weighting"]}
    return used.to_dict() | alpha
