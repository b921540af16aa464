"""The work of a sweep, in jobs that any process can do with the scenes, a renderer and the folder."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl import metrics
from tfm_cl._version import __version__
from tfm_cl.errors import DeviceError, InputError, SceneError, VolumeError
from tfm_cl.extras import missing
from tfm_cl.model import decided
from tfm_cl.plan import lattice, resolution
from tfm_cl.scene.scene import Scene
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.sweep import curves as sweep_curves
from tfm_cl.sweep.keys import content_hash, reference_key
from tfm_cl.sweep.rows import SweepRow, keep_image, keep_march, kept_image, kept_march

if TYPE_CHECKING:
    from tfm_cl.jobs.job import Progress
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.scene.settings import MapSettings
    from tfm_cl.sweep.axes import Axes
    from tfm_cl.sweep.curves import Curve, Ray
    from tfm_cl.sweep.renderer import Renderer

Overrides = Iterable[tuple[str, Any]] | Callable[[Scene], Scene]

CONVERGED_FACTOR = 4
"""Factor by which both marches of the converged dual march take more steps than the reference."""
CONVERGED_MOST = 1000
"""Largest number of steps of the converged dual march, but never fewer than those of the reference."""

OVERHEAD = 5e8
"""Number of samples that take as long as the rest of a job (loading, compiling, comparing): about a
second."""


@dataclass(frozen=True)
class Task:
    """The settings that are the same for all inputs of a sweep."""

    out: Path
    axes: Axes
    overrides: Overrides
    converged: bool
    converged_steps: int | None
    frame: float | None = None
    """Of scenes that change from frame to frame."""


@dataclass(frozen=True)
class Plan:
    """The rows that one input asks for."""

    path: Path
    name: str
    device: str
    """Name of the device that all of it is measured on."""
    res: tuple[int, int]
    """Width and height of the image."""
    reference: str
    """Key of the dual march with the steps of the maps; the next one is that of the converged one, if
    requested."""
    converged: str | None
    variants: dict[str, MapSettings]
    """Map settings by the key of the row."""
    stands_for: dict[str, tuple[int, ...]]
    """`SweepRow.stands_for` by key, for rows with another number of coefficients than requested."""
    notices: list[str]
    """Lines on omissions and replacements, and on light that no lattice holds."""
    march_samples: dict[str, float]
    """Approximate number of densities that the dual marches read, by key, plus `OVERHEAD`."""
    row_samples: dict[str, float]


class Worker:
    """Does the work with one renderer; caches the scene and the maps that it used last.

    Parameters
    ----------
    task
        The task of the sweep.
    renderer
        The renderer to use.
    """

    def __init__(self, task: Task, renderer: Renderer) -> None:
        self._task, self._renderer = task, renderer
        self._scene: tuple[Path, Scene] | None = None
        self._maps: tuple[str, list[TransmittanceMap]] | None = None

    def close(self) -> None:
        """Release the device's memory."""
        self._scene = self._maps = None
        self._renderer.close()

    def plan(self, path: Path, name: str, progress: Progress) -> Plan:
        """Read an input, and check every setting requested for it.

        Raises
        ------
        InputError
            The input cannot be read, or no basis accepts its settings.
        """
        del progress
        scene = self._load(path)
        variants, notices = self._task.axes.variants(scene.map)
        if any(variant.lookup == "lattice" for variant in variants):
            notices += [f"{name}: {line}" for line in [lattice.left_out(scene)] if line]
        scenes = [resolution.resolved(scene.replace(map=variant)) for variant in variants]
        device = self._renderer.device_name
        reference = reference_key(scene, device)
        marches, converged = {reference: scene}, None
        if self._task.converged:
            finer = self._converged(scene, name)
            converged = reference_key(finer, device)
            marches[converged] = finer
        keys = [content_hash(reference, each.map) for each in scenes]
        pixels = float(np.prod(scene.camera.res))
        return Plan(
            path=path,
            name=name,
            device=device,
            res=scene.camera.res,
            reference=reference,
            converged=converged,
            variants=dict(zip(keys, variants, strict=True)),
            stands_for={key: asked for key, asked in zip(keys, variants.values(), strict=True) if asked},
            notices=notices,
            march_samples={
                key: OVERHEAD + pixels * decided(each.march.steps) * (1 + decided(each.map.steps) / 2)
                for key, each in marches.items()
            },
            row_samples={
                key: OVERHEAD
                + pixels * decided(each.march.steps)
                + decided(each.map.steps) * float(decided(each.map.res)) ** 2
                for key, each in zip(keys, scenes, strict=True)
            },
        )

    def march(self, plan: Plan, key: str, progress: Progress) -> None:
        """Render the dual march with that key, and keep it."""
        self._check_device(plan)
        scene = self._load(plan.path)
        if key != plan.reference:
            scene = self._converged(scene, plan.name)
        result = self._renderer.render(scene, method="dual", progress=progress)
        seconds = result.stats.seconds["light_pass"] + result.stats.seconds["view_pass"]
        keep_march(self._task.out, key, result.image, seconds)

    def ray(self, plan: Plan, ray: Ray | None, progress: Progress) -> Ray | None:
        """Choose the ray of the curves on the first variant's map; None if there is no suitable ray.

        Raises
        ------
        SceneError
            If the requested ray misses the medium.
        """
        first = self._build(plan, next(iter(plan.variants)), progress)[0]
        if ray is None:
            with contextlib.suppress(VolumeError):  # too large to march on the host
                return sweep_curves.choose_ray(first)
            return None
        first.curve(*ray, 2)
        return ray

    def curve(self, plan: Plan, key: str, ray: Ray, progress: Progress) -> Curve:
        """Evaluate the map of an existing row along the ray."""
        return sweep_curves.curve_of(self._build(plan, key, progress)[0], ray)

    def row(self, plan: Plan, key: str, ray: Ray | None, progress: Progress) -> tuple[SweepRow, Curve | None]:
        """Build maps, render with them, keep the image, measure both, and evaluate the ray, if any.

        Raises
        ------
        SceneError
            If the reference shows nothing.
        """
        self._check_device(plan)
        maps = self._build(plan, key, progress)
        scene = self._variant(plan, key)
        result = self._renderer.render(scene, maps=maps, method="tfm", progress=progress)
        image = result.image
        truth, reference_seconds = self._march(plan, plan.reference)
        found = metrics.compare(image, truth)
        if found.lit is None:
            raise SceneError(
                f"{plan.name}: the reference shows nothing (alpha ≤ 0.001 everywhere), so there is no "
                "quality to measure; check camera, density_scale and light"
            )
        keep_image(self._task.out, key, image)
        settings = maps[0].settings
        width, height = plan.res
        row = SweepRow(
            volume=plan.name,
            coeffs=settings.coeffs,
            stands_for=plan.stands_for.get(key, ()),
            density_weighting=plan.variants[key].density_weighting,
            basis=settings.basis,
            target=settings.target,
            range=settings.range,
            fit=settings.fit,
            lookup=settings.lookup,
            storage=settings.storage,
            map_res=settings.res,
            map_steps=settings.steps,
            view_steps=decided(scene.march.steps),
            width=width,
            height=height,
            ssim=found.ssim,
            psnr=found.psnr,
            rmse=found.rmse,
            lit_ssim=found.lit.ssim,
            lit_psnr=found.lit.psnr,
            lit_rmse=found.lit.rmse,
            flip=None if missing("flip") else metrics.flip(image, truth),
            t_error=float(np.mean([light_map.error for light_map in maps])),
            seconds_light_pass=sum(light_map.buffers.seconds for light_map in maps),
            seconds_view_pass=result.stats.seconds["view_pass"],
            seconds_reference=reference_seconds,
            map_bytes=result.stats.map_bytes,
            bytes_per_texel=float(np.mean([light_map.bytes_per_texel for light_map in maps])),
            device=self._renderer.device_name,
            version=__version__,
            reference=plan.reference,
            key=key,
        )
        curve = None if ray is None else sweep_curves.curve_of(maps[0], ray)
        return self._against_converged(plan, row, image), curve

    def measure(self, plan: Plan, row: SweepRow, progress: Progress) -> SweepRow:
        """Compare the image kept for a row with the converged march."""
        del progress
        image = kept_image(self._task.out, row.key, plan.res)
        if image is None:
            raise self._vanished(row.key)
        return self._against_converged(plan, row, image)

    def _against_converged(self, plan: Plan, row: SweepRow, image: NDArray[np.float32]) -> SweepRow:
        if plan.converged is None:
            return row
        truth, _ = self._march(plan, plan.converged)
        found = metrics.compare(image, truth)
        lit = found.lit or found
        return dataclasses.replace(
            row,
            converged=plan.converged,
            converged_ssim=found.ssim,
            converged_psnr=found.psnr,
            converged_rmse=found.rmse,
            converged_lit_ssim=lit.ssim,
            converged_lit_psnr=lit.psnr,
            converged_lit_rmse=lit.rmse,
        )

    def _march(self, plan: Plan, key: str) -> tuple[NDArray[np.float32], float]:
        found = kept_march(self._task.out, key, plan.res)
        if found is None:
            raise self._vanished(key)
        return found

    def _vanished(self, key: str) -> InputError:
        path = self._task.out / "images" / f"{key}.npy"
        return InputError(f"{path}: was removed or changed during the sweep; start it again")

    def _check_device(self, plan: Plan) -> None:
        ours = self._renderer.device_name
        if ours != plan.device:
            raise DeviceError(
                f"{plan.name}: a worker has {ours}, where the sweep began on {plan.device}; times compare on "
                "devices of one kind only"
            )

    def _load(self, path: Path) -> Scene:
        if self._scene is None or self._scene[0] != path:
            # Release the previous scene first: two large volumes may not fit.
            self._scene = self._maps = None
            overrides = self._task.overrides
            if callable(overrides):
                scene = overrides(Scene.load(path, frame=self._task.frame))
            else:
                file = SceneFile.read(path, overrides, frame=self._task.frame)
                file.check_files()
                scene = file.make(Scene)
            scene.read_files()
            self._scene = path, resolution.resolved(scene)
        return self._scene[1]

    def _variant(self, plan: Plan, key: str) -> Scene:
        return self._load(plan.path).replace(map=plan.variants[key])

    def _build(self, plan: Plan, key: str, progress: Progress) -> list[TransmittanceMap]:
        if self._maps is None or self._maps[0] != key:
            self._maps = None
            scene = self._variant(plan, key)
            self._maps = key, self._renderer.build_maps(scene, progress)
        return self._maps[1]

    def _converged(self, scene: Scene, name: str) -> Scene:
        """Return a scene with the steps of the converged march.

        Raises
        ------
        SceneError
            If fewer steps are requested than the scene has.
        """

        def steps(own: int) -> int:
            asked = self._task.converged_steps
            if asked is None:
                return max(own, min(CONVERGED_FACTOR * own, CONVERGED_MOST))
            if asked < own:
                raise SceneError(
                    f"{name}: {asked} converged steps are fewer than the {own} of the scene; ask for more"
                )
            return asked

        return scene.replace(
            map=scene.map.replace(steps=steps(decided(scene.map.steps))),
            march=scene.march.replace(steps=steps(decided(scene.march.steps))),
        )


@dataclass(frozen=True)
class Workshop:
    """Makes workers, here or in other processes."""

    task: Task
    renderer: Renderer | Callable[[], Renderer]
    """The one to use, or what makes one for each worker."""

    def worker(self) -> Worker:
        """Make one with a renderer of its own."""
        return Worker(self.task, self.renderer() if callable(self.renderer) else self.renderer)

    @contextlib.contextmanager
    def using(self) -> Iterator[Worker]:
        """Make one with the renderer that is there, or with one that is closed afterwards."""
        renderer = self.renderer
        owned = contextlib.closing(renderer()) if callable(renderer) else contextlib.nullcontext(renderer)
        with owned as used:
            yield Worker(self.task, used)
