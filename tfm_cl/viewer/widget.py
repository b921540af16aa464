"""``tfm.view``: a scene in a notebook that is rendered as it is changed there."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from copy import copy
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tfm_cl.errors import InputError
from tfm_cl.extras import needs
from tfm_cl.files.paths import real_path, source_of
from tfm_cl.scene.bodies.base import Body
from tfm_cl.scene.bodies.primitives import Primitives
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.scene import Scene
from tfm_cl.scene.scene_file import Made
from tfm_cl.sequence.frame import read
from tfm_cl.sequence.shot import Shot
from tfm_cl.viewer.files import Files
from tfm_cl.viewer.renderer import LAUNCH_SECONDS

if TYPE_CHECKING:
    from tfm_cl.render.renderer import Renderer
    from tfm_cl.sequence.frame import ReadFrame
    from tfm_cl.viewer.cell import Viewer
    from tfm_cl.viewer.loop import RenderLoop
    from tfm_cl.viewer.session import Session

_loops: dict[str | None, tuple[RenderLoop, int]] = {}
"""By the device that was asked for: what renders, and for how many viewers."""
_lock = threading.Lock()


def view(
    source: Scene | Shot | str | os.PathLike[str],
    frame: float | None = None,
    *,
    device: str | None = None,
    folder: str | os.PathLike[str] = ".",
    height: str | None = None,
) -> Viewer:
    """Show a scene in a notebook and render it, on this machine's device, as it is changed there.

    >>> viewer = tfm.view("volumes/cumulus.toml")   # doctest: +SKIP
    >>> viewer                                       # doctest: +SKIP
    >>> viewer.scene.camera.from_                    # doctest: +SKIP

    Parameters
    ----------
    source
        A scene, a scene file, a volume, a pattern of these, or a shot.
    frame
        That is shown first, of what changes from frame to frame; by default the first one.
    device
        Part of an OpenCL device's name, as of `tfm_cl.render.renderer.Renderer`.
    folder
        The only one that its page opens and saves files in.
    height
        Of the view, as CSS says it: ``"600px"``.

    Returns
    -------
    Viewer
        The widget, which a cell shows that ends with it. Its ``scene`` is the scene as it is now, ``close()``
        ends it; all viewers share one renderer, which is closed with the last.

    Raises
    ------
    SceneError, VolumeError
        As `Shot.scene_file` and `Scene.save`: a scene of curves, polygons or meshes that no file holds.
    InputError
        What is installed with ``tfm_cl[notebook]`` is missing, or there is no such folder.
    """
    with needs("notebook", "tfm.view", InputError):
        # What is installed on request, and OpenCL, which asking for the function does not need.
        from tfm_cl.viewer.cell import HEIGHT, Shown, Viewer  # noqa: PLC0415
        from tfm_cl.viewer.curve import curve_at  # noqa: PLC0415
        from tfm_cl.viewer.loop import RenderLoop  # noqa: PLC0415

        make = partial(RenderLoop, partial(_renderer, device), read, curve_at)

    if height is not None and not isinstance(height, str):
        raise InputError(f"height = {height!r:.40}: should be a length as CSS says it, as '600px'")
    files, held = Files(source_of(folder)), ExitStack()
    with ExitStack() as failing:
        failing.push(held)
        shot = _written(source, held) if isinstance(source, Scene) else _shot(source)
        first = _first_frame(shot, frame)
        file = shot.scene_file(first)
        files.trust([file.path, *file.files()], file.is_file_of_a_frame)
        made = Made(file, source.bodies, is_moment=False) if isinstance(source, Scene) else None
        write = None if made is None else partial(_write, made)
        loop = held.enter_context(_loop(device, make))
        session = loop.session(shot, files, first, write_scene=write)
        shown = Shown(session, files, partial(_scene, session, made), held.close)
        viewer = Viewer(shown, HEIGHT if height is None else height)
        failing.pop_all()
    return viewer


def _shot(source: Shot | str | os.PathLike[str]) -> Shot:
    return source if isinstance(source, Shot) else Shot(source)


def _written(scene: Scene, held: ExitStack) -> Shot:
    """Write a scene to a file that is there as long as the viewer."""
    folder = tempfile.TemporaryDirectory(prefix="tfm_view_", ignore_cleanup_errors=True)
    path = Path(held.enter_context(folder)) / "scene.toml"
    scene.save(path)
    return Shot(path)


def _first_frame(shot: Shot, frame: float | None) -> float | None:
    frames = shot.frames() if frame is None else None
    return frame if frames is None else frames[0]


@contextmanager
def _loop(device: str | None, make: Callable[[], RenderLoop]) -> Iterator[RenderLoop]:
    """Give what renders on a device: one for all who hold it, which ends with the last."""
    with _lock:
        loop, users = _loops.get(device) or (make(), 0)
        _loops[device] = loop, users + 1
        loop.start()
    try:
        yield loop
    finally:
        with _lock:
            loop, users = _loops.pop(device)
            if users > 1:
                _loops[device] = loop, users - 1
        if users == 1:
            loop.close()


def _renderer(device: str | None) -> Renderer:
    from tfm_cl.render.renderer import Renderer  # noqa: PLC0415 - imports OpenCL

    return Renderer(device, launch_seconds=LAUNCH_SECONDS)


def _scene(session: Session, made: Made | None) -> Scene:
    """Return the scene as it is now; arrays that were not changed are those of the scene that was given."""
    scene = session.settings.file().make(Scene, made)
    return scene if made is None else _without_files(scene, made)


def _write(made: Made, read: ReadFrame, path: Path) -> None:
    """Save a scene with its arrays beside it."""
    _without_files(read.scene, made).save(path, image=read.file.image)


def _without_files(scene: Scene, made: Made) -> Scene:
    """Return a scene whose arrays are no longer those of files that do not stay."""
    folder = real_path(made.file.path.parent)

    def freed(body: Body) -> Body:
        if not isinstance(body, Volume | Primitives) or body.made_from is None:
            return body
        source = next((body.made_from[key] for key in ("file", "points") if key in body.made_from), "")
        if source is not None and not Path(source).is_relative_to(folder):
            return body
        other = copy(body)
        other.made_from = None
        return other

    return scene.replace(volume=[freed(body) for body in scene.bodies])
