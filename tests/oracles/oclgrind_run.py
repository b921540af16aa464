"""Run the renderer at tiny sizes on the Oclgrind simulator, in an environment where it is installed.

``python oclgrind_run.py render OUT`` reads names of ``CASES`` from its input, writes the result of each as
``.npy`` into the folder OUT, and prints the file's name;
``python oclgrind_run.py out-of-bounds`` and ``race`` run kernels that Oclgrind has to complain of.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import tfm_cl as tfm
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher

Array = NDArray[np.float32]

DEVICE = "Oclgrind"
PLAIN = ("-DTFM_NO_INLINE", "-cl-opt-disable")
"""Oclgrind does not know what Clang leaves behind where it inlines."""

BROKEN_KERNELS = """
__kernel void out_of_bounds(__global float *values)
{
  values[get_global_id(0) + 1] = 1.0f;
}

__kernel void race(__global float *values)
{
  values[get_global_id(0)] = values[(get_global_id(0) + 1) % get_global_size(0)];
}
"""


TWICE = tfm.Medium(sigma_s=(0.8, 0.5, 0.2), sigma_a=0.1, orders=2)


def _scene(**changes) -> tfm.Scene:
    """A lumpy volume of unequal sides in turned anisotropic voxels, far from the origin; 12×8 pixels."""
    density = np.random.default_rng(5).random((5, 6, 7))
    turn = np.array([[0.96, -0.28, 0, 100], [0.28, 0.96, 0, -50], [0, 0, 1.5, 7], [0, 0, 0, 1]])
    volume = tfm.Volume(density, world_from_index=turn, density_scale=0.5)
    camera = changes.pop("camera", {})
    parts = {
        "camera": _camera(volume, **camera),
        "map": tfm.MapSettings(basis="dct", density_weighting=10.0, res=8, steps=6, coeffs=4),
        "march": tfm.MarchSettings(steps=6),
    }
    return tfm.Scene(volume).replace(**parts).replace(**changes)


def _camera(volume: tfm.Volume, *, back: float = 12.0, res: tuple[int, int] = (12, 8)) -> tfm.Camera:
    centre = volume.bounds.mean(axis=0)
    return tfm.Camera(from_=np.add(centre, (0.3, 0.2, back)), to=centre, res=res)


def _map(**settings) -> tfm.Scene:
    return _scene(
        map=tfm.MapSettings(
            **{"basis": "dct", "density_weighting": 10.0, "res": 8, "steps": 6, "coeffs": 4, **settings}
        )
    )


def _lights(scene: tfm.Scene) -> tfm.Scene:
    """A light inside the medium, one of nearly a half space, and one whose cone misses everything."""
    centre = _centre(scene)
    spots = (
        tfm.SpotLight(from_=centre, to=np.add(centre, (1, 0.2, 0)), cone=30, falloff="inverse-square"),
        tfm.SpotLight(from_=np.add(centre, (0, 9, 0)), to=centre, cone=89.9, blend=0.5),
        tfm.SpotLight(from_=np.add(centre, (0, 90, 0)), to=np.add(centre, (0, 180, 1)), cone=10),
    )
    return scene.replace(lights=spots)


def _evaluate(renderer: tfm.Renderer) -> Array:
    """Points before, in and behind the medium, outside the cone, and at the apex."""
    scene = _map(storage="u8")
    low, high = scene.volume.bounds
    places = np.random.default_rng(6).uniform(-0.5, 1.5, (40, 3)) * (high - low) + low
    points = np.vstack([places, scene.lights[0].from_, scene.lights[0].to])
    return renderer.build_maps(scene)[0].evaluate(points, (1.0, 0.5, 0.1))


def _one_voxel(renderer: tfm.Renderer) -> Array:
    scene = tfm.Scene(
        tfm.Volume(np.full((1, 1, 1), 3.0)),
        map=tfm.MapSettings(basis="dct", density_weighting=10.0, res=5, steps=1, coeffs=1),
    )
    camera = scene.camera.replace(res=(5, 3))
    return renderer.render(scene.replace(camera=camera, march=tfm.MarchSettings(steps=1))).image


def _centre(scene: tfm.Scene) -> NDArray[np.float64]:
    return scene.bodies[0].bounds.mean(axis=0)


def _with_solids(scene: tfm.Scene, **shadow) -> tfm.Scene:
    """A ball in the medium, a floor below, and ambient light."""
    centre = _centre(scene)
    floor = tfm.PlaneSolid(point=tuple(np.subtract(centre, (0, 7, 0))))
    return scene.replace(
        solids=(tfm.SphereSolid(centre=tuple(centre), radius=1.5), floor),
        shadow=tfm.ShadowSettings(**{"res": 9, **shadow}),
        ambient=tfm.Ambient(radiance=(0.1, 0.2, 0.3)),
    )


def _other_lights(scene: tfm.Scene) -> tfm.Scene:
    centre = _centre(scene)
    sun = tfm.SunLight(from_=np.add(centre, (1, 2, 0.5)), to=centre)
    point = tfm.PointLight(from_=np.add(centre, (2, 5, 1)), falloff="inverse-square", reach=20)
    sky = tfm.EnvironmentLight(samples=2)
    return scene.replace(lights=(sun, point, sky))


def _coloured_suns(scene: tfm.Scene) -> tfm.Scene:
    sun = tfm.SunLight(from_=(1, 2, 0.5), to=(0, 0, 0), intensity=(1, 0.5, 0))
    return scene.replace(lights=(sun, sun.replace(from_=(-1, 2, 3), intensity=(0, 0.3, 1))))


def _several(scene: tfm.Scene) -> tfm.Scene:
    moved = np.eye(4)
    moved[:3, 3] = (3, -1, 0.5)
    volume = scene.grids[0]
    return scene.replace(volume=[volume, volume.transformed(moved), volume.with_density_scale(0.2)])


def _on_lattice(renderer: tfm.Renderer) -> Array:
    """The picture, and the lattice's error."""
    result = renderer.render(_other_lights(_map(lookup="lattice")), aovs=["lattice_error"])
    error = result.aovs["lattice_error"]
    return np.dstack([result.image, error])


def _layers(renderer: tfm.Renderer, scene: tfm.Scene) -> Array:
    layers = renderer.render(scene, aovs=("lights", "ambient")).aovs
    return np.stack([layer for name, layer in layers.items() if name.startswith(("light.", "ambient"))])


WARM = tfm.Medium(sigma_s=(1.0, 0.7, 0.4), sigma_a=(0.1, 0.2, 0.5), phase=tfm.HenyeyGreenstein(0.4))
COLD = tfm.Medium(sigma_s=(0.2, 0.5, 1.1), sigma_a=(0.3, 0.1, 0.0), octaves=3)
FLAME = tfm.Medium(sigma_s=0, sigma_a=0, emission=(2, 1, 0.5))


def _mixture(what: str, **changes) -> tfm.Scene:
    """The lumpy volume, in other media."""
    scene = _scene(ambient=tfm.Ambient(radiance=(0.1, 0.2, 0.3)), **changes)
    grid = scene.grids[0]
    low, high = grid.bounds
    centre = (low + high) / 2
    colour = np.random.default_rng(7).random((*grid.shape, 3))
    coloured = tfm.Volume(
        grid.data, world_from_index=grid.world_from_index, density_scale=0.5, colour=colour, medium=WARM
    )
    moved = np.eye(4)
    moved[:3, 3] = (2, -1, 0.5)
    return scene.replace(
        volume={
            "grid in fog": [grid, tfm.EverywhereVolume(density=0.02)],
            "two tints": [grid.with_medium(WARM), grid.transformed(moved).with_medium(COLD)],
            "coloured grid in a box": [
                coloured,
                tfm.BoxVolume(from_=tuple(low + 1), to=tuple(high + 2), density=0.1, medium=COLD),
            ],
            "flame in a glowing grid": [
                grid.with_medium(WARM.replace(emission=(1, 0.5, 0.2))),
                coloured.transformed(moved).with_medium(FLAME),
            ],
            "two bodies": [
                tfm.SphereVolume(centre=tuple(centre), radius=3, density=0.2, medium=WARM),
                tfm.BoxVolume(from_=tuple(low), to=tuple(centre), density=0.3, medium=COLD),
            ],
        }[what]
    )


def _fog(shape: str) -> tfm.Scene:
    volume = {
        "box": tfm.BoxVolume(density=0.4),
        "sphere": tfm.SphereVolume(density=0.4),
        "everywhere": tfm.EverywhereVolume(density=0.1),
    }[shape]
    lights = [
        tfm.SpotLight(from_=(x, 2, 0.3), to=(x, 0, 0), cone=30, blend=0.3, reach=4) for x in (-0.5, 0, 0.6)
    ]
    scene = tfm.Scene(
        volume,
        medium=tfm.Medium(sigma_s=(1, 0.5, 0.2)),
        camera=tfm.Camera(from_=(0.3, 0.6, 4), to=(0, 0, 0), res=(20, 17)),
        lights=[*lights, tfm.PointLight(from_=(0, 0.2, 0))],
        march=tfm.MarchSettings(steps=5),
    )
    return _with_solids(scene) if shape == "box" else scene


def _phases() -> tfm.Scene:
    """Two with tables and one of powers, of which one is seen against its light."""
    table = tfm.TabulatedPhase(values=(3, 1, 2, 9))
    phases = (table, tfm.PhaseMixture(phases=(table, "mie"), weights=(1, 2)), tfm.FournierForand())
    bodies = [tfm.SphereVolume(density=0.3, medium=tfm.Medium(phase=phase)) for phase in phases]
    sun = tfm.SunLight(from_=(0, 0, -1), to=(0, 0, 0))
    return _fog("sphere").replace(volume=bodies, lights=[sun, tfm.PointLight(from_=(0, 0.2, 0))])


def _primitives(what: str, **settings) -> tfm.Scene:
    """Some that are widened and some that are not, near the lumpy volume or alone."""
    scene = _map(**settings)
    centre, rng = _centre(scene), np.random.default_rng(8)
    places = centre + rng.uniform(-3, 3, (24, 3))
    points = tfm.Points(places, rng.uniform(0.05, 1.5, 24), 0.3, profile="gaussian")
    strands = tfm.Curves(
        places, [5, 3, 16], 0.2, opacity=0.9, medium=tfm.Medium(sigma_s=(1, 0.6, 0.3), phase=tfm.KajiyaKay())
    )
    leaves = tfm.Polygons(places, np.arange(24).reshape(-1, 3), 0.5, medium=COLD)
    bodies = {
        "points": points,
        "grid and points": [scene.grids[0], points],
        "strands and leaves in fog": [
            strands,
            leaves,
            tfm.BoxVolume(from_=tuple(centre - 4), to=tuple(centre + 4), density=0.02),
        ],
    }
    return scene.replace(volume=bodies[what])


CASES: dict[str, Callable[[tfm.Renderer], Array]] = {
    **{
        f"{coeffs} coefficients": lambda r, n=coeffs: r.render(_map(coeffs=n, steps=max(n, 6))).image
        for coeffs in (1, 2, 7, 32)
    },
    **{
        f"storage {storage}": lambda r, s=storage: r.render(_map(storage=s, coeffs=3)).image
        for storage in ("f16", "u8")
    },
    "map of 1 texel": lambda r: r.render(_map(res=1)).image,
    "map of 16 texels": lambda r: r.render(_map(res=16)).image,
    "automatic weighting": lambda r: r.render(_map(density_weighting="auto")).image,
    "dual": lambda r: r.render(_scene(), method="dual").image,
    "sampling world": lambda r: r.render(_scene(march=tfm.MarchSettings(steps=6, sampling="world"))).image,
    "dual, sampling world": lambda r: (
        r.render(_scene(march=tfm.MarchSettings(steps=6, sampling="world", method="dual"))).image
    ),
    "Henyey-Greenstein": lambda r: (
        r.render(
            _scene(
                medium=tfm.Medium(sigma_s=(1, 0.5, 0), sigma_a=(0.1, 0, 0), phase=tfm.HenyeyGreenstein(-0.4))
            )
        ).image
    ),
    "phase functions": lambda r: r.render(_phases()).image,
    "crop": lambda r: r.render(_scene(), crop=(3, 2, 12, 8)).image,
    "odd frame": lambda r: r.render(_scene(camera={"res": (13, 1)})).image,
    "camera inside": lambda r: r.render(_scene(camera={"back": 0.1})).image,
    "camera turned away": lambda r: (
        r.render((s := _scene()).replace(camera=s.camera.replace(to=np.add(s.camera.from_, (0, 0, 1))))).image
    ),
    "many lights": lambda r: r.render(_lights(_scene())).image,
    "many lights, dual": lambda r: r.render(_lights(_scene()), method="dual").image,
    "solids": lambda r: r.render(_with_solids(_scene())).image,
    "solids, nearest, dual": lambda r: (
        r.render(_with_solids(_scene(), filter="nearest", res=1), method="dual").image
    ),
    "solids, learnt basis": lambda r: r.render(_with_solids(_map(basis="klt"))).image,
    "other lights": lambda r: r.render(_other_lights(_scene())).image,
    "light on a lattice": _on_lattice,
    "coloured light on a lattice, several volumes": lambda r: (
        r.render(_several(_coloured_suns(_map(lookup="lattice")))).image
    ),
    "light from all around at points": lambda r: (
        r.render(_with_solids(_scene(lights=[tfm.EnvironmentLight(samples=2, lookup="points")]))).image
    ),
    "several volumes": lambda r: r.render(_several(_scene())).image,
    "later orders": lambda r: r.render(_map().replace(medium=TWICE)).image,
    "later orders, lobe, solids": lambda r: (
        r.render(_with_solids(_map()).replace(medium=TWICE.replace(sigma_s=0.8, phase="hg:0.4"))).image
    ),
    "fog in a box, solids": lambda r: r.render(_fog("box")).image,
    "fog in a sphere": lambda r: r.render(_fog("sphere")).image,
    "fog everywhere": lambda r: r.render(_fog("everywhere")).image,
    **{
        f"{what}, {method}": lambda r, w=what, m=method: r.render(_mixture(w), method=m).image
        for what in (
            *("grid in fog", "two tints", "coloured grid in a box", "two bodies"),
            "flame in a glowing grid",
        )
        for method in ("tfm", "dual")
    },
    "mixture, other lights, solids": lambda r: (
        r.render(_with_solids(_other_lights(_mixture("coloured grid in a box")))).image
    ),
    **{
        f"{what}, {method}": lambda r, w=what, m=method: r.render(_primitives(w), method=m).image
        for what in ("points", "grid and points", "strands and leaves in fog")
        for method in ("tfm", "dual")
    },
    "strands and leaves in fog, solids": lambda r: (
        r.render(_with_solids(_primitives("strands and leaves in fog"))).image
    ),
    **{
        f"{what} at their own depths, {basis}": lambda r, w=what, b=basis: (
            r.render(_primitives(w, basis=b, coeffs=5, density_weighting="auto", deposits="depth")).image
        )
        for what, basis in (("points", "trig-moments"), ("points", "moments"), ("grid and points", "fourier"))
    },
    "emission without light": lambda r: r.render(
        _scene(medium=FLAME.replace(sigma_a=0.5), lights=()), aovs=["emission"]
    ).aovs["emission"],
    "emission, light on a lattice": lambda r: (
        r.render(_coloured_suns(_map(lookup="lattice")).replace(medium=WARM.replace(emission=1))).image
    ),
    "layers of lights, solids": lambda r: _layers(r, _with_solids(_other_lights(_scene()))),
    "layers of lights on a lattice": lambda r: _layers(r, _coloured_suns(_map(lookup="lattice"))),
    "no light": lambda r: r.render(_mixture("grid in fog", lights=())).image,
    "no light, solids": lambda r: r.render(_with_solids(_mixture("two tints", lights=()))).image,
    "evaluate": _evaluate,
    "one voxel": _one_voxel,
}
"""Name -> a picture or transmittances, made with the renderer given."""


def _run_broken(name: str) -> None:
    launcher = Launcher(choose_device(DEVICE))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "broken.cl"
        file.write_text(BROKEN_KERNELS, encoding="utf-8")
        kernel = launcher.kernels.kernel(name, str(file))
        launcher.run(kernel, (4,), {"values": launcher.upload("four values", np.zeros(4, np.float32))})


def _main(what: str, *out: str) -> None:
    if what != "render":
        _run_broken(what.replace("-", "_"))
        return
    names = list(CASES)
    with tfm.Renderer(DEVICE, build_options=PLAIN, lanes=1) as renderer:
        for line in sys.stdin:
            name = line.rstrip("\n")
            file = Path(out[0]) / f"{names.index(name)}.npy"
            np.save(file, CASES[name](renderer))
            sys.stdout.write(f"{file}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    _main(*sys.argv[1:])
