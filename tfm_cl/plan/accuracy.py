"""Chooses settings for ``map.max_error`` by comparing some pixels with the converged dual march.

The requested error is that of the picture: the root mean square over its lit pixels, relative to their mean
(`tfm_cl.metrics`). A pilot, which is the same view with fewer pixels, is rendered by the dual march in more
and more steps until it has converged. Then the camera's steps, and the resolution, steps and coefficients of
the maps, are raised until the pilot agrees with that reference. Only settings that are ``"auto"`` are chosen;
others are kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import DeviceMemoryError, SceneError
from tfm_cl.maps.bases import BASES, BEST
from tfm_cl.maps.resolved import resolve
from tfm_cl.metrics import lit_mask
from tfm_cl.model import decided
from tfm_cl.plan import resolution

if TYPE_CHECKING:
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.scene import Scene

Crop = tuple[int, int, int, int]

PIXELS, LEAST_PIXELS = 1 << 14, 1 << 11
"""Number of lit pixels of a pilot, and the smallest number if pixels are expensive. A picture with fewer is
its own pilot: a few pixels at the edge of a shadow may carry most of the error."""
SAMPLES = 2e10
"""Nominal samples that the converged dual march of a pilot may take: some seconds."""
SCOUT_PIXELS = 4096
"""Number of pixels of the picture in which the lit part is found."""
CONVERGED = 4
"""Smallest number of steps of the dual march taken as the reference, as a multiple of the steps of
``"auto"``."""
OF_TRUTH = 0.4
"""Largest difference between the reference and a march with half its steps, as a fraction of the requested
error. The error of a march falls with the square of its steps, so a third of that difference remains."""
OF_CAMERA = 0.5
"""Share of the requested error that the camera's steps may cause: a quarter of the squared error."""
ENOUGH, AIM = 0.5, 0.95
"""Fractions of the requested error: below the first, cheaper settings are tried; up to the second, they are
kept."""
MOST = {"steps": 8192, "light_steps": 2048, "res": 4096}
"""Limits of the search."""
LEAST = 16
"""Smallest number of steps, or of texels along each side, that is tried."""
FINER, FAR = 1.5, 2.0
"""Factors by which texels along each side, or steps, are raised: the first, or the second if the error
exceeds the requested one by that factor."""
MUCH = 0.3
"""Fraction of the excess squared error: a change that removes this much is accepted without trying others."""
MOST_TRIALS = 30
"""Largest number of pilots that are rendered for a choice."""
LADDER = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
"""Numbers of coefficients per texel that are tried: each has kernels of its own, which take seconds to
compile."""


class Picture(Protocol):
    """What rendering gives."""

    @property
    def image(self) -> NDArray[np.float32]:
        """[H, W, 4]."""


@dataclass(frozen=True)
class Numbers:
    """The settings that are chosen."""

    steps: int
    """Steps along a camera ray."""
    light_steps: int
    res: int
    coeffs: int

    def of(self, scene: Scene) -> Scene:
        """Return the scene with these values, and without ``max_error``."""
        of_map = {"res": self.res, "steps": self.light_steps, "coeffs": self.coeffs, "max_error": None}
        return scene.replace(map=scene.map.replace(**of_map), march=scene.march.replace(steps=self.steps))


@dataclass(frozen=True)
class Choice:
    """A scene with the settings chosen for its error, and the error measured."""

    scene: Scene
    estimate: float
    """Relative RMSE of the picture's lit pixels against the converged dual march, as measured."""


class Chooser:
    """Chooses the settings with which a picture keeps ``map.max_error``.

    Parameters
    ----------
    render
        ``render(scene, method, crop)`` renders a scene without ``max_error``.
    scene
        A scene with ``max_error``; whether its light is on a lattice is decided.
    method
        ``tfm`` or ``dual``.
    crop
        Pixels x0, y0, x1, y1 of the picture.
    progress
        Called as ``progress("choosing", fraction)``.
    """

    def __init__(
        self,
        render: Callable[[Scene, str, Crop], Picture],
        scene: Scene,
        method: str,
        crop: Crop,
        progress: Callable[[str, float], None],
    ) -> None:
        self._render, self._scene, self._method, self._crop = render, scene, method, crop
        self._progress, self._trials = progress, 0
        self._error = float(scene.map.max_error or 0)
        self._marches_to_lights = bool(scene.marched and scene.is_lit)
        self._has_maps = method == "tfm" and self._marches_to_lights
        plain = resolution.resolved(scene.replace(map=scene.map.replace(max_error=None)))
        # The reference resolves the medium, whatever steps are given.
        auto = resolution.resolved(
            plain.replace(map=plain.map.replace(steps="auto"), march=plain.march.replace(steps="auto"))
        )
        basis = BASES[BEST if plain.map.basis == "auto" else plain.map.basis]
        self._coeffs = sorted(
            {max((n for n in basis.counts if n <= most), default=min(basis.counts)) for most in LADDER}
        )
        self._pilot = scene.camera, crop
        light_steps, res, light_steps_of_auto = 1, 1, 1
        if self._marches_to_lights:
            light_steps, res = decided(plain.map.steps), decided(plain.map.res)
            light_steps_of_auto = decided(auto.map.steps)
        coeffs = resolve(plain.map, res=res, steps=light_steps).coeffs
        self._first = Numbers(decided(plain.march.steps), light_steps, res, coeffs)
        self._auto = decided(auto.march.steps), light_steps_of_auto

    def choice(self) -> Choice:
        """Choose the settings.

        Raises
        ------
        SceneError
            When no settings suffice; the message says what was reached.
        """
        pilot = self._choose_pilot()
        if pilot is None:  # nothing is visible, whatever the settings
            return Choice(self._first.of(self._scene), 0.0)
        self._pilot = pilot
        numbers = self._camera_steps()
        first = numbers
        numbers, error = self._better(numbers, self._error_of(numbers))
        if error > self._error:
            raise SceneError(self._refusal(numbers, error))
        if numbers != first or error < ENOUGH * self._error:
            numbers, error = self._cheaper(numbers, error)
        return Choice(numbers.of(self._scene), error)

    # ------------------------------------------------------------------------------------ the pilot

    def _choose_pilot(self) -> tuple[Camera, Crop] | None:
        """Camera and crop of the pilot, with about `PIXELS` lit pixels; None if nothing is lit."""
        camera, crop = self._reduced(SCOUT_PIXELS, self._crop)
        # Light is irrelevant here.
        scout = replace(self._first, light_steps=1).of(self._scene.replace(camera=camera))
        lit = lit_mask(self._render(scout, "dual", crop).image)
        if not lit.any():
            return None
        rows, columns = np.flatnonzero(lit.any(axis=1)), np.flatnonzero(lit.any(axis=0))
        scale = np.divide(self._scene.camera.res, camera.res)
        low = np.floor((np.array([columns[0], rows[0]]) + crop[:2]) * scale).astype(int)
        high = np.ceil((np.array([columns[-1], rows[-1]]) + crop[:2] + 1) * scale).astype(int)
        x0, y0 = np.maximum(low, self._crop[:2]).tolist()
        x1, y1 = np.minimum(high, self._crop[2:]).tolist()
        share = float(lit[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].mean())
        lights = max(1, sum(len(light.parts()) for light in self._scene.lights))
        a_pixel = CONVERGED**2 * math.prod(self._auto) * lights
        return self._reduced(
            float(np.clip(SAMPLES / a_pixel, LEAST_PIXELS, PIXELS)) / share, (x0, y0, x1, y1)
        )

    def _reduced(self, pixels: float, crop: Crop) -> tuple[Camera, Crop]:
        """Return the camera with fewer pixels, and the crop in these pixels."""
        x0, y0, x1, y1 = crop
        width, height = self._scene.camera.res
        scale = min(1.0, math.sqrt(pixels / ((x1 - x0) * (y1 - y0))))
        res = max(1, round(width * scale)), max(1, round(height * scale))
        across, down = res[0] / width, res[1] / height
        left, top = min(int(x0 * across), res[0] - 1), min(int(y0 * down), res[1] - 1)
        right, bottom = max(left + 1, math.ceil(x1 * across)), max(top + 1, math.ceil(y1 * down))
        return self._scene.camera.replace(res=res), (left, top, min(right, res[0]), min(bottom, res[1]))

    def _image(self, numbers: Numbers, method: str) -> NDArray[np.float32]:
        camera, crop = self._pilot
        self._trials += 1
        self._progress("choosing", min(self._trials / MOST_TRIALS, 1.0))
        return self._render(numbers.of(self._scene.replace(camera=camera)), method, crop).image

    @cached_property
    def _truth(self) -> tuple[NDArray[np.float32], Numbers]:
        """Pilot by the dual march, converged so that half the steps change it little, and its steps."""
        factor, coarse = CONVERGED, self._image(self._times(CONVERGED / 2), "dual")
        while True:
            steps = self._times(factor)
            truth = self._image(steps, "dual")
            if difference(coarse, truth) <= OF_TRUTH * self._error or 2 * steps.steps > MOST["steps"]:
                return truth, steps
            factor, coarse = 2 * factor, truth

    def _times(self, factor: float) -> Numbers:
        steps, light_steps = (math.ceil(factor * auto) for auto in self._auto)
        return replace(self._first, steps=steps, light_steps=light_steps)

    def _error_of(self, numbers: Numbers, method: str | None = None) -> float:
        """Measure an error; of a sample of pixels with its standard error: few may carry most of it."""
        truth, _ = self._truth
        image = self._image(numbers, method or self._method)
        return difference(image, truth, surely=self._pilot[0].res != self._scene.camera.res)

    # ---------------------------------------------------------------------------------- the numbers

    def _camera_steps(self) -> Numbers:
        """Choose the camera's steps, with the reference's steps towards the light."""
        numbers, allowed = self._first, OF_CAMERA * self._error
        if self._scene.march.steps != "auto":
            return numbers

        def error(steps: int) -> float:
            return self._error_of(replace(self._truth[1], steps=steps), "dual")

        steps = numbers.steps
        found = error(steps)
        while found > allowed and steps < MOST["steps"]:
            # The error falls with the square of the steps, more slowly at edges.
            factor = min(max(1.1 * math.sqrt(found / allowed), 1.2), 4)
            steps = min(math.ceil(factor * steps), MOST["steps"])
            found = error(steps)
        while found < allowed / 3 and steps > LEAST:
            fewer = max(LEAST, steps // 2)
            found = error(fewer)
            if found > allowed:
                break
            steps = fewer
        return replace(numbers, steps=steps)

    def _free(self) -> Iterator[str]:
        """Names of the settings that may be chosen, in the order of their effect on the cost of a map."""
        settings = self._scene.map
        if self._has_maps and settings.res == "auto":
            yield "res"
        if self._has_maps and settings.coeffs == "auto":
            yield "coeffs"
        if self._marches_to_lights and settings.steps == "auto":
            yield "light_steps"
        if self._scene.march.steps == "auto":
            yield "steps"

    def _better(self, numbers: Numbers, error: float) -> tuple[Numbers, float]:
        """Raise settings until the error is low enough: the resolution first, else all of them."""
        while error > AIM * self._error and self._trials < MOST_TRIALS:
            too_much = error**2 - (AIM * self._error) ** 2
            factor = FINER if error < FAR * self._error else FAR
            best, least = numbers, error
            for more in self._more(numbers, factor):
                found = self._error_if_possible(more)
                if found < least:
                    best, least = more, found
                if error**2 - found**2 > MUCH * too_much:
                    break
            if best == numbers:
                break
            numbers, error = best, least
        return numbers, error

    def _more(self, numbers: Numbers, factor: float) -> Iterator[Numbers]:
        """Yield what is tried next: a finer map, and higher values of all settings."""
        together = numbers
        for name in self._free():
            more = self._changed(together, name, factor)
            if name == "res" and more:
                yield more
            together = more or together
        if together != numbers:
            yield together

    def _cheaper(self, numbers: Numbers, error: float) -> tuple[Numbers, float]:
        """Lower one setting after another as long as the error stays below the requested one."""
        for name in self._free():
            while self._trials < MOST_TRIALS:
                factor = 0.5 if error < ENOUGH * self._error else 1 / FINER
                fewer = self._changed(numbers, name, factor)
                found = math.inf if fewer is None else self._error_of(fewer)
                if fewer is None or found > AIM * self._error:
                    break
                numbers, error = fewer, found
        return numbers, error

    def _error_if_possible(self, numbers: Numbers) -> float:
        """Measure the error; it is infinite if a map is too large for the device."""
        try:
            return self._error_of(numbers)
        except DeviceMemoryError:
            return math.inf

    def _changed(self, numbers: Numbers, name: str, factor: float) -> Numbers | None:
        """Multiply a setting, or take the next number of coefficients; None beyond its limits."""
        now = getattr(numbers, name)
        if name == "coeffs":
            others = [n for n in self._coeffs if (n > now if factor > 1 else n < now)]
            if not others:
                return None
            return replace(numbers, coeffs=others[0] if factor > 1 else others[-1])
        changed = round(factor * now)
        changed = min(changed, max(now, MOST[name])) if factor > 1 else max(changed, min(now, LEAST))
        return None if changed == now else replace(numbers, **{name: changed})

    def _refusal(self, numbers: Numbers, error: float) -> str:
        settings, march = self._scene.map, self._scene.march
        given = {"map.res": settings.res, "map.steps": settings.steps, "march.steps": march.steps}
        fixed = [f"{key} = {value}" for key, value in given.items() if value != "auto"]
        advice = f"remove {', '.join(fixed)}, or allow" if fixed else "allow"
        of_map = f"{numbers.coeffs} coefficients per texel, " if self._has_maps else ""
        return (
            f"map.max_error = {self._error:g}: the picture reaches {error:.2g} with {of_map}map.res = "
            f"{numbers.res}, map.steps = {numbers.light_steps}, march.steps = {numbers.steps}; "
            f"{advice} a larger error"
        )


def difference(image: NDArray[np.float32], truth: NDArray[np.float32], *, surely: bool = False) -> float:
    """RMSE of the reference's lit pixels relative to their mean; 0 if they are black.

    ``surely``: one standard error is added to the mean square.
    """
    lit = lit_mask(truth)
    mean = float(truth[lit, :3].mean(dtype=np.float64)) if lit.any() else 0.0
    if mean == 0:
        return 0.0
    squared = np.square(image[lit, :3].astype(np.float64) - truth[lit, :3]).mean(axis=-1)
    total = float(squared.mean()) + (float(squared.std()) / math.sqrt(squared.size) if surely else 0.0)
    return math.sqrt(total) / mean
