"""A `tfm_cl.Scene` rendered by Mitsuba 3, single scattering, one ray through each pixel's centre.

Conventions that differ: Mitsuba's volumes span [0, 1]³ with voxel centres at (i + ½)/N and are clamped
beyond them, so the array goes in with one layer of zeros around it, and the box [-1.5, N + 0.5] of index
space becomes the unit cube. ``max_depth`` is one more than the orders of scattering: 2 is single scattering,
and direct light on solids, both dimmed by the medium. A spot's angles are half angles; its light and a
point's always fall off with the square of the distance. Solids within the medium need no medium of their own:
only a surface between two media changes that of a ray.

Mitsuba knows one medium at a place, so bodies that share space are a medium written here, whose coefficients
are the sums of theirs. A grid of the sum's albedo would not do: between voxel centres the ratio of two
interpolations is not the interpolated ratio. Each body is one of Mitsuba's own media, and they may have
voxels of any size and direction. Bodies of several phase functions are rendered once for each, the others
black, and added up: single scattering is linear in what scatters. `volpath` takes all three colours of a
sample from the free flights of one: that has no bias as long as nothing is opaque in one colour and clear in
another.

Balls of constant density are spheres with a medium in each, so they may not overlap, nor may other media
reach into them. Points of other profiles are sampled on a grid. A surface has no phase function, so strands
and polygons are black: strands opaque cones with round ends and joints, polygons masks of some opacity.
"""

import math
import os
import re
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.plan.orders import orders_of

mi = pytest.importorskip("mitsuba")  # skips whichever test module imports this one
dr = pytest.importorskip("drjit")

OLDEST_LLVM = 17
"""Dr.Jit aborts the process on some older ones (15 was seen to)."""
HARD_EDGE = 1e-5
"""Part of a spot's half angle over which it may soften: Mitsuba divides by the width of the edge."""
VOXELS = 128
"""Along each axis of the grid that points of a smooth profile are sampled on."""
FAR = 100.0
"""Half the side of the square that stands for a plane; world units."""


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
        register_mixture()
        yield mi.variant()


class MitsubaScene:
    """The same scene for Mitsuba; its lights are those that `emitter` knows, its solids those of `shape`.

    Parameters
    ----------
    scene
        What `tfm_cl` renders.
    backlit
        Instead of its lights, radiance 1 from everywhere, unscattered: the image is the transmittance.
    whole_pixels
        Rays through places in the pixels at random, not through their centres.
    """

    def __init__(self, scene, *, backlit=False, whole_pixels=False):
        camera = scene.camera
        description = {
            "type": "scene",
            "integrator": {
                "type": "volpath",
                "max_depth": 1 if backlit else 1 + orders_of(scene),
                "hide_emitters": not backlit,
            },
            "sensor": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at(camera.from_, camera.to, camera.up),
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
        for n, body in enumerate(scene.bodies):
            description |= {f"body {n}, {name}": each for name, each in shapes_of(body, scene).items()}
        self.res, self.whole_pixels = camera.res, whole_pixels
        media = media_of(scene)[: 1 if backlit else None]
        assert len(media) < 2 or not scene.solids, (
            "each phase function's picture would have the solids' light"
        )
        held, inside = [{}], False
        if media:
            box = bounding_box(scene)
            held = [enclosed(medium, box) for medium in media]
            eye = np.linalg.solve(box, [*camera.from_, 1])[:3]
            inside = (eye > 0).all() and (eye < 1).all()
        self.scenes = [mi.load_dict(description | each) for each in held]
        """Their radiances add up."""
        self.media_at_eye = [medium_in(each) if inside else None for each in self.scenes]

    def batches(self, count, samples, seed):
        """Means of independent batches, ``[count, height, width, RGB]``, of ``samples`` samples per pixel."""
        one = self._vectorised if "llvm" in mi.variant() else self._scalar
        return np.array([one(samples, seed + n) for n in range(count)])

    def _vectorised(self, samples, seed):
        width, height = self.res
        count = width * height * samples
        pixel = dr.arange(mi.UInt32, count) // samples
        sampler = independent(seed, count)
        x, y = sampler.next_2d() if self.whole_pixels else (0.5, 0.5)
        position = mi.Point2f((mi.Float(pixel % width) + x) / width, (mi.Float(pixel // width) + y) / height)
        radiance = np.array(self._radiance(position, sampler), dtype=np.float64).T
        return radiance.reshape(height, width, samples, 3).mean(axis=2)

    def _scalar(self, samples, seed):
        width, height = self.res
        sampler = independent(seed, 1)
        image = np.zeros((height, width, 3))
        for row, column in np.ndindex(height, width):
            for _ in range(samples):
                x, y = sampler.next_2d() if self.whole_pixels else (0.5, 0.5)
                position = [(column + x) / width, (row + y) / height]
                image[row, column] += np.array(self._radiance(position, sampler)) / samples
        return image

    def _radiance(self, position, sampler):
        ray, _ = self.scenes[0].sensors()[0].sample_ray(0.0, 0.5, position, [0.5, 0.5])
        return sum(
            scene.integrator().sample(scene, sampler, ray, medium)[0]
            for scene, medium in zip(self.scenes, self.media_at_eye, strict=True)
        )


def bounding_box(scene):
    """World from the unit cube that holds all bodies, 4×4: a grid's own turned box, or along the axes."""
    if len(scene.bodies) == 1 and scene.grids:
        return padded_box(scene.volume)
    return box_between(*scene.bounds)


def padded_box(volume):
    """World from the unit cube of a grid with one layer of zeros around it."""
    x, y, z = (count + 2 for count in volume.shape[::-1])
    return volume.world_from_index @ [[x, 0, 0, -1.5], [0, y, 0, -1.5], [0, 0, z, -1.5], [0, 0, 0, 1]]


def box_between(low, high):
    """World from the unit cube, for a box along the axes."""
    box = np.diag([*np.subtract(high, low), 1.0])
    box[:3, 3] = low
    return box


def enclosed(medium, box):
    """Description of what holds a medium: a box with no surface."""
    cube = box @ box_between([0.5] * 3, [1] * 3)  # Mitsuba's own is [-1, 1]³
    return {
        "medium": medium,
        "box": {
            "type": "cube",
            "to_world": mi.ScalarTransform4f(cube),
            "bsdf": {"type": "null"},
            "interior": {"type": "ref", "id": "medium"},
        },
    }


def medium_in(scene):
    """Medium of the one shape of Mitsuba's scene that holds any."""
    return next(shape.interior_medium() for shape in scene.shapes() if shape.interior_medium())


def media_of(scene):
    """Descriptions of media whose pictures add up, one for each phase function; none of `shapes_of`."""
    phases = dict.fromkeys(scene.medium_of(body).phase for body in scene.bodies if not is_shapes(body))
    return [mixture(scene, phase) for phase in phases]


def mixture(scene, phase):
    """Description of all bodies together, of which those of one phase function scatter."""
    parts = []
    for body in scene.bodies:
        if is_shapes(body):
            continue
        medium = scene.medium_of(body)
        scatters = medium.phase == phase
        albedo = scatters * np.array(medium.sigma_s) / np.maximum(medium.sigma_t, 1e-30)  # 0 of nothing
        parts.append(
            {
                "type": "heterogeneous",
                "sigma_t": extinction(body, medium.sigma_t),
                "albedo": {"type": "constvolume", "value": rgb(albedo)},
                "phase": phase_function(phase),
            }
        )
    if len(parts) == 1:
        return parts[0]
    low, high = scene.bounds
    return {
        "type": "mixture",
        "low": low.tolist(),
        "high": high.tolist(),
        "phase": parts[0]["phase"],
    } | {f"part {n}": part for n, part in enumerate(parts)}


def extinction(body, sigma_t):
    """Description of the volume of σ_t of a grid, of a box, or of points that have no edge."""
    if isinstance(body, tfm.Volume):
        colour = 1.0 if body.colour is None else body.colour
        values = body.density_scale * np.pad(body.data[..., None] * colour, [(1, 1)] * 3 + [(0, 0)]) * sigma_t
        box, between = padded_box(body), "trilinear"
    elif isinstance(body, tfm.Points):
        (low, high), between = body.bounds, "trilinear"
        values, box = sampled(body, low, high) * sigma_t, box_between(low, high)
    else:
        assert isinstance(body, tfm.BoxVolume), "no description of such a body"
        values = body.density * np.pad(np.ones((1, 1, 1, 1)), [(1, 1)] * 3 + [(0, 0)]) * sigma_t
        low, high = body.bounds
        box, between = box_between(2 * low - high, 2 * high - low), "nearest"
    return {
        "type": "gridvolume",
        "grid": mi.VolumeGrid(values.astype(np.float32)),
        "raw": True,
        "filter_type": between,
        "to_world": mi.ScalarTransform4f(box),
    }


def sampled(points, low, high):
    """Density of points at the voxels' centres of a grid, ``[z, y, x, RGB]``."""
    axes = [np.linspace(a, b, 2 * VOXELS + 1)[1::2] for a, b in zip(low, high, strict=True)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    profile = {"gaussian": lambda square: np.exp(-4.5 * square), "smooth": lambda square: (1 - square) ** 3}
    values = np.zeros((*x.shape, 3))
    for centre, radius, density, colour in each_of(points):
        square = ((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2) / radius**2
        values += np.where(square < 1, density * profile[points.profile](square), 0)[..., None] * colour
    return values.transpose(2, 1, 0, 3)


def each_of(points):
    """Middle, radius, density and colour of each."""
    colours = np.ones((len(points.positions), 3)) if points.colour is None else points.colour
    return zip(points.positions, points.radii, points.densities, colours, strict=True)


def is_shapes(body):
    """Whether Mitsuba has shapes for it."""
    return isinstance(body, tfm.Curves | tfm.Polygons) or getattr(body, "profile", None) == "ball"


def shapes_of(body, scene):
    """Mitsuba's shapes, by name, for balls, strands and polygons; none for other bodies."""
    if not is_shapes(body):
        return {}
    medium = scene.medium_of(body)
    if isinstance(body, tfm.Points):
        return balls(body, medium)
    assert not np.any(medium.sigma_s), "surfaces here are black"
    assert body.colour is None, "surfaces here are grey"
    assert np.all(np.equal(medium.sigma_t, 1)), "an opacity is of one crossing at sigma_t = 1"
    return {"strands": strands(body)} if isinstance(body, tfm.Curves) else veils(body)


def balls(points, medium):
    """A sphere with a medium of its own for each point."""
    apart = np.linalg.norm(points.positions[:, None] - points.positions, axis=2)
    assert (apart >= np.add.outer(points.radii, points.radii))[~np.eye(len(apart), dtype=bool)].all()
    albedo = np.array(medium.sigma_s) / medium.sigma_t
    return {
        f"ball {n}": {
            "type": "sphere",
            "center": centre.tolist(),
            "radius": float(radius),
            "bsdf": {"type": "null"},
            "interior": homogeneous(density * colour * medium.sigma_t, albedo, medium.phase),
        }
        for n, (centre, radius, density, colour) in enumerate(each_of(points))
    }


def homogeneous(sigma_t, albedo, phase):
    """Description of a medium; its colours are to be within [0, 1]."""
    largest = max(float(np.max(sigma_t)), 1e-30)
    return {
        "type": "homogeneous",
        "scale": largest,
        "sigma_t": rgb(np.divide(sigma_t, largest)),
        "albedo": rgb(albedo),
        "phase": phase_function(phase),
    }


def phase_function(phase):
    """Description of a phase function; lobes of which Mitsuba has no blend are blended here."""
    if isinstance(phase, tfm.DoubleHenyeyGreenstein):
        parts = (tfm.HenyeyGreenstein(phase.g1), tfm.HenyeyGreenstein(phase.g2))
        phase = tfm.PhaseMixture(phases=parts, weights=(phase.weight, 1 - phase.weight))
    if isinstance(phase, tfm.PhaseMixture):
        (one, other), (weight, rest) = phase.phases, phase.weights
        parts = {"one": phase_function(one), "other": phase_function(other)}
        return {"type": "blendphase", "weight": rest / (weight + rest), **parts}
    if isinstance(phase, tfm.TabulatedPhase):
        assert phase.values, "no file"
        assert not phase.cosines, "Mitsuba's are evenly spaced"
        return {"type": "tabphase", "values": ", ".join(map(str, phase.values))}
    if isinstance(phase, tfm.Rayleigh):
        return {"type": "rayleigh"}
    assert isinstance(phase, tfm.Isotropic | tfm.HenyeyGreenstein), "Mitsuba knows no such phase function"
    return {"type": "hg", "g": getattr(phase, "g", 0.0)}


def phase_values(phase, cosines):
    """What Mitsuba's own function is at cosines."""
    function, met = mi.load_dict(phase_function(phase)), mi.MediumInteraction3f()
    met.wi = mi.Vector3f(0, 0, 1)
    found = []
    for mu in cosines.tolist():
        away = mi.Vector3f(math.sqrt(1 - mu**2), 0, -mu)
        _, density = function.eval_pdf(mi.PhaseFunctionContext(None), met, away)
        found.append(np.asarray(density).item())
    return np.array(found)


def strands(curves):
    """Cones, of each segment a curve of its own: they have round ends, so joints are the same."""
    assert curves.opacity > 1 - 1e-6, "Mitsuba's strands are opaque"
    ends = np.concatenate([curves.corners, curves.widths[..., None] / 2], axis=2)
    lines = [[" ".join(f"{number:.9g}" for number in end) for end in segment] for segment in ends]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "strands.txt"
        path.write_text("\n\n".join("\n".join(segment) for segment in lines) + "\n", encoding="ascii")
        return mi.load_dict({"type": "linearcurve", "filename": str(path), "bsdf": black(1.0)})


def veils(polygons):
    """A mesh for each opacity."""
    found = {}
    for n, depth in enumerate(np.unique(polygons.densities)):
        corners = polygons.corners[polygons.densities == depth]
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(black(-np.expm1(-depth)))
        mesh = mi.Mesh("veil", 3 * len(corners), len(corners), props=properties)
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = corners.ravel().astype(np.float32)
        parameters["faces"] = np.arange(3 * len(corners), dtype=np.uint32)
        parameters.update()
        found[f"veil {n}"] = mesh
    return found


def black(opacity):
    """A surface that takes a part of the light that crosses it, from either side, and sends none back."""
    return {
        "type": "mask",
        "opacity": float(opacity),
        "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb((0, 0, 0))}},
    }


def register_mixture():
    """Tell Mitsuba's present variant of the medium that is the sum of its parts."""

    class Mixture(mi.Medium):
        def __init__(self, props):
            super().__init__(props)
            self.m_is_homogeneous, self.m_has_spectral_extinction = False, True
            self.box = mi.BoundingBox3f(mi.Point3f(props["low"]), mi.Point3f(props["high"]))
            names = [name for name in props if name.startswith("part ")]
            self.parts = [props[name] for name in names]

        def intersect_aabb(self, ray):
            return self.box.ray_intersect(ray)

        def get_majorant(self, interaction, active=True):
            return sum(part.get_majorant(interaction, active) for part in self.parts)

        def get_scattering_coefficients(self, interaction, active=True):
            """Return σ_s, what is left to the majorant, and σ_t."""
            found = [part.get_scattering_coefficients(interaction, active) for part in self.parts]
            return tuple(sum(values) for values in zip(*found, strict=True))

        def traverse(self, callback):
            pass

    mi.register_medium("mixture", Mixture)


def independent(seed, count):
    """Random numbers for ``count`` rays at once."""
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    return sampler


def rgb(values):
    """A colour that Mitsuba takes as it is."""
    return {"type": "rgb", "value": [float(value) for value in values]}


def emitter(light):
    """Mitsuba's description of a `tfm_cl` spot, point, sun, or radiance from everywhere."""
    if light.type == "environment":
        assert not light.texture, "Mitsuba's are Z up"
        return {"type": "constant", "radiance": rgb(light.intensity)}
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
    """Mitsuba's description of a sphere or a plane of `tfm_cl.scene.solids`, without a transform."""
    assert solid.world_from_object.tolist() == np.eye(4).tolist()
    surface = {"type": "diffuse", "reflectance": rgb(solid.albedo)}
    if solid.shape == "sphere":
        return {"type": "sphere", "center": list(solid.centre), "radius": solid.radius, "bsdf": surface}
    assert solid.shape == "plane", "no description of such a solid"
    up = np.eye(3)[np.abs(solid.normal).argmin()].tolist()
    to_world = mi.ScalarTransform4f().look_at(solid.point, np.add(solid.point, solid.normal), up)
    return {
        "type": "rectangle",
        "to_world": to_world @ mi.ScalarTransform4f().scale(FAR),
        "bsdf": {"type": "twosided", "bsdf": surface},
    }


def write_exr(path, image):
    """Write an image ``[height, width, RGB]``; Mitsuba's own writer, so that ours may be at fault."""
    mi.Bitmap(np.ascontiguousarray(image, dtype=np.float32)).write(str(path))
