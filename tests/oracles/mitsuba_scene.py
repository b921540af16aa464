"""A `tfm_cl.Scene` rendered by Mitsuba 3, single scattering, one ray through each pixel's centre.

Conventions that differ: Mitsuba's volumes span [0, 1]³ with voxel centres at (i + ½)/N and are clamped
beyond them, so the array goes in with one layer of zeros around it, and the box [-1.5, N + 0.5] of index
space becomes the unit cube. ``max_depth = 2`` is single scattering, and direct light on solids, both dimmed
by the medium. A spot's angles are half angles; its light and a point's always fall off with the square of the
distance. Solids within the medium need no medium of their own: only a surface between two media changes that
of a ray.
"""

import os
import re
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

mi = pytest.importorskip("mitsuba")  # skips whichever test module imports this one
dr = pytest.importorskip("drjit")

OLDEST_LLVM = 17
"""Dr.Jit aborts the process on some older ones (15 was seen to)."""
HARD_EDGE = 1e-5
"""Part of a spot's half angle over which it may soften: Mitsuba divides by the width of the edge."""


def find_llvm():
    """Newest libLLVM that the distribution installed, or None."""
    versions = {}
    for folder in ("/usr/lib", "/usr/lib64", "/usr/local/lib"):
        for pattern in ("libLLVM*.so*", "*-linux-gnu/libLLVM*.so*", "llvm*/lib/libLLVM*.so*"):
            for path in Path(folder).glob(pattern):
                if found := re.search(r"libLLVM(?:-|\.so\.)(\d+)", path.name):
                    versions[int(found[1])] = str(path)
    newest = max(versions, default=0)
    return versions[newest] if newest >= OLDEST_LLVM else None


@contextmanager
def mitsuba_variant():
    """Select Mitsuba's LLVM variant, or without LLVM the scalar one; yield its name."""
    with pytest.MonkeyPatch.context() as patch:
        llvm = os.environ.get("DRJIT_LIBLLVM_PATH") or find_llvm()
        if llvm:
            patch.setenv("DRJIT_LIBLLVM_PATH", llvm)
        mi.set_variant("llvm_ad_rgb" if llvm else "scalar_rgb")
        yield mi.variant()


class MitsubaScene:
    """The same scene for Mitsuba; its lights are those that `emitter` knows, its solids spheres.

    Parameters
    ----------
    scene
        What `tfm_cl` renders.
    backlit
        Instead of its lights, radiance 1 from everywhere, unscattered: the image is the transmittance.
    """

    def __init__(self, scene, *, backlit=False):
        to_world = mi.ScalarTransform4f
        volume, medium, camera = scene.volume, scene.medium, scene.camera
        x, y, z = (count + 2 for count in volume.shape[::-1])
        box = volume.world_from_index @ [[x, 0, 0, -1.5], [0, y, 0, -1.5], [0, 0, z, -1.5], [0, 0, 0, 1]]
        cube = box @ [
            [0.5, 0, 0, 0.5],
            [0, 0.5, 0, 0.5],
            [0, 0, 0.5, 0.5],
            [0, 0, 0, 1],
        ]  # its own is [-1, 1]³
        extinction = np.pad(volume.data, 1)[..., None] * medium.sigma_t
        description = {
            "type": "scene",
            "integrator": {"type": "volpath", "max_depth": 1 if backlit else 2},
            "medium": {
                "type": "heterogeneous",
                "scale": volume.density_scale,
                "sigma_t": {
                    "type": "gridvolume",
                    "grid": mi.VolumeGrid(extinction.astype(np.float32)),
                    "raw": True,
                    "to_world": to_world(box),
                },
                "albedo": {"type": "constvolume", "value": rgb(np.array(medium.sigma_s) / medium.sigma_t)},
                "phase": {"type": "hg", "g": getattr(medium.phase, "g", 0.0)},
            },
            "box": {
                "type": "cube",
                "to_world": to_world(cube),
                "bsdf": {"type": "null"},
                "interior": {"type": "ref", "id": "medium"},
            },
            "sensor": {
                "type": "perspective",
                "to_world": to_world().look_at(camera.from_, camera.to, camera.up),
                "fov": camera.fov,
                "fov_axis": "y",
                "near_clip": 1e-4,
                "film": {"type": "hdrfilm", "width": camera.res[0], "height": camera.res[1]},
            },
        }
        if backlit:
            description["sky"] = {"type": "constant", "radiance": rgb((1, 1, 1))}
        else:
            description |= {f"light {n}": emitter(light) for n, light in enumerate(scene.lights)}
        description |= {f"solid {n}": shape(solid) for n, solid in enumerate(scene.solids)}
        self.res = camera.res
        self.scene = mi.load_dict(description)
        eye = np.linalg.solve(box, [*camera.from_, 1])[:3]
        inside = (eye > 0).all() and (eye < 1).all()
        self.medium_at_eye = self.scene.shapes()[0].interior_medium() if inside else None

    def batches(self, count, samples, seed):
        """Means of independent batches, ``[count, height, width, RGB]``, of ``samples`` samples per pixel."""
        one = self._vectorised if "llvm" in mi.variant() else self._scalar
        return np.array([one(samples, seed + n) for n in range(count)])

    def _vectorised(self, samples, seed):
        width, height = self.res
        count = width * height * samples
        pixel = dr.arange(mi.UInt32, count) // samples
        position = mi.Point2f(
            (mi.Float(pixel % width) + 0.5) / width, (mi.Float(pixel // width) + 0.5) / height
        )
        radiance = np.array(self._radiance(position, seed, count), dtype=np.float64).T
        return radiance.reshape(height, width, samples, 3).mean(axis=2)

    def _scalar(self, samples, seed):
        width, height = self.res
        sampler = independent(seed, 1)
        image = np.zeros((height, width, 3))
        for row, column in np.ndindex(height, width):
            position = [(column + 0.5) / width, (row + 0.5) / height]
            for _ in range(samples):
                image[row, column] += np.array(self._radiance(position, sampler=sampler)) / samples
        return image

    def _radiance(self, position, seed=0, count=1, sampler=None):
        ray, _ = self.scene.sensors()[0].sample_ray(0.0, 0.5, position, [0.5, 0.5])
        sampler = sampler or independent(seed, count)
        return self.scene.integrator().sample(self.scene, sampler, ray, self.medium_at_eye)[0]


def independent(seed, count):
    """Random numbers for ``count`` rays at once."""
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    return sampler


def rgb(values):
    """A colour that Mitsuba takes as it is."""
    return {"type": "rgb", "value": [float(value) for value in values]}


def emitter(light):
    """Mitsuba's description of a `tfm_cl` spot, point or sun."""
    if light.type == "sun":
        direction = np.subtract(light.to, light.from_).tolist()
        return {"type": "directional", "direction": direction, "irradiance": rgb(light.intensity)}
    assert light.falloff == "inverse-square", "Mitsuba knows no such light"
    assert light.reach is None, "Mitsuba knows no such light"
    if light.type == "point":
        return {"type": "point", "position": list(light.from_), "intensity": rgb(light.intensity)}
    assert light.blend == 0.0, "Mitsuba knows no such light"
    up = light.frame().world_from_light[:3, 1].tolist()  # any will do: the light is round
    return {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(light.from_, light.to, up),
        "intensity": rgb(light.intensity),
        "cutoff_angle": light.cone,
        "beam_width": light.cone * (1 - HARD_EDGE),
    }


def shape(solid):
    """Mitsuba's description of a `tfm_cl.scene.solids.SphereSolid` without a transform."""
    assert (solid.shape, solid.world_from_object.tolist()) == ("sphere", np.eye(4).tolist())
    surface = {"type": "diffuse", "reflectance": rgb(solid.albedo)}
    return {"type": "sphere", "center": list(solid.centre), "radius": solid.radius, "bsdf": surface}


def write_exr(path, image):
    """Write an image ``[height, width, RGB]``; Mitsuba's own writer, so that ours may be at fault."""
    mi.Bitmap(np.ascontiguousarray(image, dtype=np.float32)).write(str(path))
