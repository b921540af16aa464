"""A user's script that makes something of every public class; type checkers accept all of it."""

from pathlib import Path

import numpy as np

import tfm_cl as tfm

# Phase functions, by position, by name, or as text.
phases: list[tfm.Isotropic | tfm.HenyeyGreenstein | tfm.Mie] = [tfm.Isotropic(), tfm.HenyeyGreenstein(0.3)]
droplets = tfm.Mie(diameter=10)
lobes = tfm.DoubleHenyeyGreenstein(g1=0.8, g2=-0.2, weight=0.7)
ocean, dust, air, strands = (
    tfm.FournierForand(),
    tfm.Draine(g=0.5),
    tfm.Rayleigh(),
    tfm.KajiyaKay(exponent=20),
)
measured = tfm.TabulatedPhase(cosines=[-1, 0, 1], values=np.array([0.5, 1.0, 2.0]))
mixed = tfm.PhaseMixture(phases=[droplets, "rayleigh", {"type": "hg", "g": 0.5}], weights=[0.6, 0.3, 0.1])
cloud = tfm.Medium(sigma_s=0.9, sigma_a=[0.1, 0.1, 0.2], phase=mixed)
smoke = tfm.Medium(preset="smoke", phase="hg:0.4", emission=np.array([0.0, 0.1, 0.0]))
red, green, blue = cloud.sigma_s

# Bodies.
voxels = np.zeros((8, 8, 8), np.float32)
voxels[2:6, 2:6, 2:6] = 1
volume = tfm.Volume(voxels, voxel_size=0.1, origin=(-0.4, -0.4, -0.4), density_scale=4.0, medium=cloud)
box = tfm.BoxVolume(from_=(0.5, 0, 0), to=[1, 1, 1], density=0.5, medium=smoke)
ball = tfm.SphereVolume(centre=(-1, 0, 0), radius=0.3)
haze = tfm.EverywhereVolume(density=0.01, medium=tfm.Medium(phase=tfm.HenyeyGreenstein(g=0.7)))
points = tfm.Points(np.zeros((1, 3)), 0.2, opacity=0.5, profile="ball")
curves = tfm.Curves([[0, 0, 0], [0, 1, 0]], [2], width=0.05)
veil = tfm.Polygons([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], opacity=0.3)

# Lights, solids, camera, settings.
spot = tfm.SpotLight(from_=(-3, 3, 2), to=np.zeros(3), cone=20, intensity=12, falloff="inverse-square")
sun = tfm.SunLight(from_=(1, 2, 0), to=(0, 0, 0), intensity=[1, 0.9, 0.8])
bulb = tfm.PointLight(from_=[0, 2, 0], reach=9, name="bulb")
sky = tfm.SkyLight(elevation=30, ground_albedo=0.2, up=(0, 1, 0))
dome = tfm.EnvironmentLight(intensity=0.1, samples=4)
ground = tfm.GroundSolid(albedo=0.5)
wall = tfm.PlaneSolid(point=(0, 0, -2), normal=(0, 0, 1), albedo=(0.8, 0.7, 0.6))
solids = [ground, wall, tfm.SphereSolid(centre=(1, 0, 1), radius=0.2), tfm.BoxSolid(transform=np.eye(4))]
mesh = tfm.MeshSolid.from_arrays([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], albedo=0.5)
statue = tfm.MeshSolid(mesh=Path("statue.glb"), albedo="marble.png", smooth=30)
camera = tfm.Camera(from_=(1.1, 0.35, 3.9), to=(0, 0, 0), fov=31, res=(32, 24))
x, y, z = camera.from_
width: int = camera.res[0]
settings = tfm.MapSettings(res=32, coeffs=4, basis="dct"), tfm.MarchSettings(steps="auto")
scene = tfm.Scene(
    [volume, box, ball, haze],
    medium=cloud,
    camera=camera,
    lights=[spot, bulb],
    map=settings[0],
    march=settings[1],
    solids=[wall],
    ambient=tfm.Ambient(radiance=0.1),
    shadow=tfm.ShadowSettings(res=64),
)
bluer = scene.replace(medium=cloud.replace(sigma_s=(0.5, 0.8, 1.0)))
plain = tfm.Scene(volume, medium=smoke, lights=(sun, sky, dome))

# What is added by plugins.
kinds: list[type[tfm.Phase] | type[tfm.Light] | type[tfm.AnalyticSolid]] = [
    tfm.Mie,
    tfm.SunLight,
    tfm.BoxSolid,
]


def add(folder: Path, basis: tfm.Basis) -> None:
    """Register kinds of ours, as a plugin does."""
    tfm.load_plugin(folder / "plugin.py")
    tfm.register_basis(basis)
    tfm.register_phase(tfm.Rayleigh)
    tfm.register_light(tfm.SunLight)
    tfm.register_solid(tfm.BoxSolid)
    tfm.register_volume_format(".abc", "my_formats.abc")
    tfm.register_image_format(".abc", "my_formats.abc")


def frames(path: Path) -> list[tfm.Scene]:
    """Return scenes of a shot, of which one is between whole frames."""
    shot = tfm.Shot(path, [("camera.fov", 30.0)], look="plain", turntable=24)
    return [shot.scene(frame) for frame in (1, 2.5)]


def render(path: Path) -> tfm.Comparison:
    """Render the scene both ways, and compare the pictures."""
    with tfm.Renderer(device=None) as renderer:
        maps: list[tfm.TransmittanceMap] = list(renderer.build_maps(scene))
        result: tfm.RenderResult = renderer.render(scene, maps=maps)
        result.save(path)
        reference = renderer.render(scene, method="dual")
    lit = maps[0].evaluate(np.zeros((1, 3)))
    return tfm.compare(result.image * float(lit.shape[0] > 0), reference.image)


def look(path: Path) -> tfm.Scene:
    """Return a scene as it was changed in a notebook."""
    with tfm.view(path, height="600px") as viewer:
        changed: tfm.Scene = viewer.scene
    return changed


if __name__ == "__main__":
    try:
        psnr = render(Path("picture.exr")).psnr
        Path("psnr.txt").write_text(f"{tfm.__version__}: {psnr:.1f} dB\n", encoding="utf-8")
    except (tfm.InputError, tfm.DeviceError) as error:
        raise SystemExit(str(error)) from error
    except (tfm.TfmError, tfm.TfmWarning):  # a warning, where these are made errors
        raise
