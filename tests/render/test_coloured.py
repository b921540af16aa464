"""Volumes whose extinction has a colour in every voxel: as pictures, as maps, as files."""

import tomllib
import zipfile
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from scenes import blobs, make_scene, turned
from tolerances import FLOAT32, PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.cli import main
from tfm_cl.errors import SceneError, VolumeError
from tfm_cl.files import volume_io
from tfm_cl.files.volume_io import limits
from tfm_cl.files.volume_io.colour import _overlap
from tfm_cl.plan import options
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.optical_depth import density_scale_for
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.scene.scene_file_writer import to_toml

PLACED = {"world_from_index": turned(25, (1, 2, 0.5), (0.15, 0.2, 0.14), (-1.1, -1.0, -0.9))}
TWICE = 2 * PASS
"""Two renders that should be the same, each of which is as far from the truth as `PASS`."""
SEVERAL = Path(__file__).resolve().parents[1] / "files" / "volume_io" / "data" / "several.vdb"
"""Scalar grids in one place (density[0], mask), beside it (density[1]), elsewhere (shared); a vector grid."""


def rainbow(shape=(14, 12, 16)):
    """A colour that differs from voxel to voxel: red falls along x, blue rises, green waves along y."""
    z, y, x = np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij")
    rgb = np.stack([1.5 - 1.4 * x, 0.6 + 0.5 * np.sin(7 * y + 2 * z), 0.1 + 1.2 * x * z], axis=-1)
    return rgb.astype(np.float32)


def constant(*rgb):
    return np.broadcast_to(np.float32(rgb), (14, 12, 16, 3))


def coloured_scene(colour, **changes):
    return make_scene(volume=Volume(blobs(), colour=colour, **PLACED, density_scale=4.0), **changes)


def grey_scene(scene, colour, channel):
    """The channel as a scene of its own, put together by hand."""
    volume, medium = scene.volume, scene.medium
    return scene.replace(
        volume=Volume(volume.data * colour[..., channel], **PLACED, density_scale=volume.density_scale),
        medium=medium.replace(sigma_s=medium.sigma_s[channel], sigma_a=medium.sigma_a[channel]),
        lights=[light.replace(intensity=light.intensity[channel]) for light in scene.lights],
    )


def precise(scene, **of_map):
    """Without what depends on all the colours together: the end of rays, the range of α."""
    return scene.replace(map=scene.map.replace(**of_map), march=scene.march.replace(cutoff=0.0))


# ----------------------------------------------------------------------------------------- pictures


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_each_channel_is_that_of_the_reference(renderer, method, save_on_failure):
    scene = precise(coloured_scene(rainbow()))

    result = renderer.render(scene, method=method)

    greys = [reference.render_with_aovs(grey_scene(scene, rainbow(), c), method) for c in range(3)]
    _, together = reference.render_with_aovs(scene, method)
    image = np.stack([grey[..., c] for c, (grey, _) in enumerate(greys)], axis=-1)
    with save_on_failure(result.image[..., :3], image):
        assert np.abs(result.image[..., :3] - image).max() <= PASS * image.max()
    layer = np.stack([layers["transmittance"][..., c] for c, (_, layers) in enumerate(greys)], axis=-1)
    assert np.abs(result.aovs["transmittance"] - layer).max() <= PASS
    # What the camera sees weighs the light of all channels alike.
    seen_light = together["light_transmittance"]
    assert np.abs(result.aovs["light_transmittance"] - seen_light).max() <= PASS
    for each in (layer, seen_light):
        assert np.ptp(each, axis=-1).max() > 0.1  # the channels do differ
    transmittance = np.stack([layers["transmittance"][..., 0] for _, layers in greys])
    assert np.abs(result.image[..., 3] - (1 - transmittance.mean(axis=0))).max() <= PASS
    opacity = 1 - transmittance
    depth = sum(o * layers["depth"] for o, (_, layers) in zip(opacity, greys, strict=True))
    seen = opacity.sum(axis=0) > 1e-3
    # The sum of weighted distances is as good as the pass; it is divided by the opacity.
    error = (result.aovs["depth"] - depth / np.maximum(opacity.sum(axis=0), 1e-3)) * opacity.mean(axis=0)
    assert np.abs(error[seen]).max() <= PASS * result.aovs["depth"].max()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_a_constant_colour_is_another_extinction(renderer, method):
    factors = (0.5, 1.3, 2.0)
    # The optical depth is linear in the density: a map of it does not care where a factor stands.
    scene = precise(coloured_scene(constant(*factors)), target="optical-depth")
    medium = scene.medium
    scaled = make_scene(
        medium=medium.replace(
            sigma_s=np.multiply(medium.sigma_s, factors), sigma_a=np.multiply(medium.sigma_a, factors)
        ),
        map=scene.map,
        march=scene.march,
    )

    ours, truth = (renderer.render(each, method=method) for each in (scene, scaled))

    assert np.abs(ours.image - truth.image).max() <= TWICE * truth.image.max()
    assert np.abs(ours.aovs["transmittance"] - truth.aovs["transmittance"]).max() <= TWICE
    seen = truth.image[..., 3] > 1e-2
    difference = np.abs(ours.aovs["depth"] - truth.aovs["depth"]) * truth.image[..., 3]
    assert difference[seen].max() <= TWICE * truth.aovs["depth"].max()


@pytest.mark.slow
def test_the_paper_s_weighting_belongs_to_the_coloured_density(renderer):
    scene = precise(coloured_scene(constant(0.5, 0.5, 0.5)), density_weighting=5.0)
    medium = scene.medium
    scaled = make_scene(
        medium=medium.replace(
            sigma_s=np.multiply(medium.sigma_s, 0.5), sigma_a=np.multiply(medium.sigma_a, 0.5)
        ),
        map=scene.map.replace(density_weighting=10.0),
        march=scene.march,
    )

    ours, truth = (renderer.render(each).image for each in (scene, scaled))

    assert np.abs(ours - truth).max() <= TWICE * truth.max()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_a_colour_of_1_is_none(renderer, method):
    scene = precise(coloured_scene(constant(1, 1, 1)))

    ours = renderer.render(scene, method=method)
    truth = renderer.render(scene.replace(volume=make_scene().volume), method=method)

    assert np.abs(ours.image - truth.image).max() <= TWICE * truth.image.max()
    assert np.abs(ours.aovs["transmittance"] - truth.aovs["transmittance"]).max() <= TWICE


@pytest.mark.slow
@pytest.mark.parametrize("basis", ["auto", "dct"])
def test_a_grey_colour_of_a_grey_medium_under_grey_light_is_its_product(renderer, basis):
    grey = rainbow()[..., :1]
    scene = coloured_scene(
        np.broadcast_to(grey, rainbow().shape),
        medium=tfm.Medium(sigma_s=0.75, sigma_a=0.25),
        lights=[make_scene().lights[0].replace(intensity=3.0)],
    )
    coeffs = {"basis": basis, "coeffs": "auto", "density_weighting": "auto"}
    scene = scene.replace(map=scene.map.replace(**coeffs))
    product = scene.replace(volume=Volume(blobs() * grey[..., 0], **PLACED, density_scale=4.0))

    ours, truth = (renderer.render(each, aovs=["map_error"]) for each in (scene, product))

    # The very same voxels, in three colours at once instead of one.
    assert np.abs(ours.image - truth.image).max() <= PASS * truth.image.max()
    for name in ("transmittance", "light_transmittance", "map_error"):
        assert np.abs(ours.aovs[name] - truth.aovs[name]).max() <= PASS, name
    np.testing.assert_array_equal(ours.aovs["samples"], truth.aovs["samples"])
    depth = np.abs(ours.aovs["depth"] - truth.aovs["depth"]) * truth.image[..., 3]
    assert depth.max() <= PASS * truth.aovs["depth"].max()
    assert ours.stats.map == truth.stats.map
    assert ours.stats.map_bytes == 3 * truth.stats.map_bytes


@pytest.mark.slow
def test_a_channel_without_extinction_is_black_and_clear(renderer):
    scene = coloured_scene(constant(1, 0, 1))

    result = renderer.render(scene, method="tfm")

    assert (result.image[..., 1] == 0).all()
    assert (result.aovs["transmittance"][..., 1] == 1).all()
    assert result.image[..., 0].max() > 0.01


@pytest.mark.slow
def test_one_crop_of_all_channels_and_what_it_cost(renderer):
    scene = coloured_scene(rainbow())
    whole = renderer.render(scene, method="dual")

    part = renderer.render(scene, method="dual", crop=(3, 4, 20, 16))

    np.testing.assert_array_equal(part.image, whole.image[4:16, 3:20])
    assert part.crop == (3, 4, 20, 16)
    assert part.scene.volume is scene.volume
    assert part.stats.samples["view_pass"] == part.aovs["samples"].sum(dtype=np.float64)
    assert part.stats.map is None
    for wrong in ({"crop": (0, 0, 99, 1)}, {"method": "best"}):
        with pytest.raises(SceneError, match=next(iter(wrong))):
            renderer.render(scene, **wrong)


# --------------------------------------------------------------------------------------------- maps


def area_lights():
    (light,) = make_scene().lights
    return [light.replace(radius=0.3, samples=2), light.replace(from_=(-2.0, 3.0, 1.0))]


def test_maps_come_light_by_light_in_three_colours(renderer):
    scene = coloured_scene(rainbow(), lights=area_lights())

    maps = renderer.build_maps(scene)

    points = list(chain.from_iterable(light.parts() for light in scene.lights))
    assert len(maps) == 3 * len(points) == 9
    for index, light_map in enumerate(maps):
        light, channel = points[index // 3], index % 3
        fitted = light.fitted(scene.volume.occupied_bounds)
        assert light_map.light.map_key() == fitted.map_key()
        assert light_map.bodies == scene.grids
        assert light_map.field_index == channel
        _, exact, of_map = light_map.curve(0.5, 0.5)
        assert np.abs(of_map - exact).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("basis", ["auto", "dct"])
def test_maps_serve_other_colours_of_the_medium(renderer, basis):
    scene = coloured_scene(rainbow(), lights=area_lights())
    if basis == "auto":
        scene = scene.replace(map=tfm.MapSettings(density_weighting=10.0, res="auto", steps=24))
    maps = renderer.build_maps(scene)
    other = scene.replace(medium=tfm.Medium(sigma_s=(0.2, 1.0, 0.6), sigma_a=0.1))

    same, recoloured = renderer.render(scene, maps=maps), renderer.render(other, maps=maps)

    np.testing.assert_array_equal(same.image, renderer.render(scene).image)
    if basis == "dct":  # its numbers do not depend on the extinction
        np.testing.assert_array_equal(recoloured.image, renderer.render(other).image)
    assert np.abs(recoloured.image - same.image).max() > 0.01
    assert same.stats.seconds["light_pass"] == 0
    assert same.stats.map_bytes == sum(light_map.nbytes for light_map in maps)


@pytest.mark.slow
def test_maps_of_another_colour_are_refused(renderer):
    lights = make_scene().lights * 3
    scene, other = coloured_scene(rainbow()), coloured_scene(rainbow()[..., ::-1])
    maps, of_other = renderer.build_maps(scene), renderer.build_maps(other)
    without = scene.replace(volume=make_scene().volume)
    for wrong, message in (
        (of_other, "map 1 was built for another volume"),
        ([maps[0], maps[2], maps[1]], "map 2 was built for another field of density"),
        (renderer.build_maps(without), "another volume"),
        (maps[:1], "1 maps for 1 lights .*, each of which takes 3"),
        (renderer.build_maps(without.replace(lights=lights)), "another volume"),
        (maps * 2, "6 maps for 1 lights"),
        ([], "0 maps for 1 lights"),
    ):
        with pytest.raises(SceneError, match=message):
            renderer.render(scene, maps=wrong)
    with pytest.raises(SceneError, match="another volume"):
        renderer.render(without.replace(lights=lights), maps=maps)
    with pytest.raises(SceneError, match="another volume"):
        renderer.render(scene.replace(volume=scene.volume.with_density_scale(1)), maps=maps)
    rescaled = scene.volume.with_density_scale(1).with_density_scale(4)
    renderer.render(scene.replace(volume=rescaled), maps=maps)


@pytest.mark.slow
def test_maps_are_not_looked_at_by_the_dual_march(renderer):
    scene = coloured_scene(rainbow())
    image = renderer.render(scene, maps=renderer.build_maps(make_scene()), method="dual").image
    np.testing.assert_array_equal(image, renderer.render(scene, method="dual").image)


@pytest.mark.slow
def test_its_channels_are_put_on_the_device_once(new_renderer):
    scene = coloured_scene(rainbow())
    moved = scene.replace(camera=scene.camera.replace(fov=20))
    other = coloured_scene(rainbow()[..., ::-1])
    with new_renderer() as session:
        maps = session.build_maps(scene)
        frames = [session.render(scene, maps=maps)]
        frames += [session.render(each, method="dual") for each in (moved, other)]
    assert [frame.stats.made.get("bricks", 0) for frame in frames] == [0, 0, 1]


def test_settings_that_the_channels_decide_apart_are_told_as_asked_for(one_lane_renderer):
    scene = coloured_scene(constant(1, 1, 4))
    scene = scene.replace(map=scene.map.replace(density_weighting="auto", basis="dct"))

    told = one_lane_renderer.render(scene).stats.map

    assert len({each.density_weighting for each in one_lane_renderer.build_maps(scene)}) > 1
    assert (told.density_weighting, told.coeffs, told.basis) == (None, 8, "dct")
    assert told.to_dict()["density_weighting"] == "auto"
    assert (told.target, told.range) == ("transmittance", "box")


# ------------------------------------------------------------------------------------------ volumes


@pytest.fixture
def data():
    return np.random.default_rng(0).random((2, 3, 4), np.float32)


@pytest.fixture
def rgb():
    return np.random.default_rng(1).random((2, 3, 4, 3), np.float32)


def test_a_volume_keeps_its_colour(data, rgb):
    volume = Volume(data, colour=rgb.astype(">f8"), name="smoke", density_scale=2)

    assert volume.colour.dtype == np.float32
    np.testing.assert_array_equal(volume.colour, rgb)
    with pytest.raises(ValueError, match="read-only"):
        volume.colour[0] = 1
    assert repr(volume) == "Volume(smoke, 4×3×2 voxels, coloured, density_scale=2)"
    assert Volume(data).colour is None
    rgb.flags.writeable = False
    assert Volume(data, colour=rgb).colour is rgb


def test_channels_are_the_products(data, rgb):
    volume = Volume(data, colour=rgb, voxel_size=2, density_scale=3)

    for channel in range(3):
        part = volume.channels[channel]
        np.testing.assert_array_equal(part.data, data * rgb[..., channel])
        assert (part.density_scale, part.colour) == (3, None)
        assert part.world_from_index is volume.world_from_index
        assert part is volume.channels[channel]
    uncoloured = Volume(data)
    assert uncoloured.channels == (uncoloured,) * 3


def test_another_density_scale_keeps_colour_and_products(data, rgb):
    volume = Volume(data, colour=rgb, density_scale=3)
    before = volume.channels

    other = volume.with_density_scale(5)

    assert other.colour is volume.colour
    assert [part.density_scale for part in other.channels] == [5, 5, 5]
    assert all(one.same_voxels(two) for one, two in zip(before, other.channels, strict=True))
    assert volume.channels is before


def test_the_same_voxels_have_the_same_colour(data, rgb):
    data.flags.writeable = rgb.flags.writeable = False
    volume = Volume(data, colour=rgb)
    assert volume.same_voxels(volume.with_density_scale(2))
    assert volume.same_voxels(Volume(data, colour=rgb))
    assert not volume.same_voxels(Volume(data))
    assert not volume.same_voxels(Volume(data, colour=rgb.copy()))
    assert not volume.channels[0].same_voxels(volume.channels[1])


def test_sums_and_the_scale_chosen_from_them_count_the_colour(data, rgb):
    volume = Volume(data, colour=rgb)
    for axis in range(3):
        expected = (data * rgb.mean(axis=-1)).sum(axis=axis).ravel()
        np.testing.assert_allclose(volume.line_sums(axis), expected, rtol=8 * FLOAT32)
    faint = Volume(data, colour=np.full_like(rgb, 0.125))
    assert density_scale_for(faint) == pytest.approx(
        8 * density_scale_for(Volume(data)), rel=0.05
    )  # 2 digits


@pytest.mark.slow
def test_leaves_are_coloured_too(renderer):
    colour = rainbow()
    dense = coloured_scene(colour)
    sparse = dense.replace(volume=Volume(dense.volume.leaves, colour=colour, **PLACED, density_scale=4.0))
    for channel in range(3):
        np.testing.assert_array_equal(
            sparse.volume.channels[channel].data, dense.volume.channels[channel].data
        )
    for axis in range(3):
        np.testing.assert_allclose(
            np.sort(sparse.volume.line_sums(axis)), np.sort(dense.volume.line_sums(axis)), rtol=8 * FLOAT32
        )
    np.testing.assert_array_equal(
        renderer.render(sparse, method="dual").image, renderer.render(dense, method="dual").image
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda rgb: rgb[..., :2],
            r"shape \[2, 3, 4, 2\]; expected \[z, y, x, 3\] of the volume, \[2, 3, 4, 3\]",
        ),
        (lambda rgb: rgb[:1], r"shape \[1, 3, 4, 3\]"),
        (lambda rgb: rgb[..., 0], r"shape \[2, 3, 4\]"),
        (lambda rgb: rgb.astype(complex), "complex128"),
        (lambda rgb: rgb.astype(str), "real numbers"),
        (lambda rgb: rgb.astype(object), "object"),
        (
            lambda rgb: np.where(rgb == rgb[1, 2, 0, 1], np.nan, rgb),
            r"1 numbers .*nan at \[z=1, y=2, x=0, g\]",
        ),
        (lambda rgb: -rgb, "72 numbers"),
        (lambda rgb: rgb + np.inf, "inf"),
        (lambda rgb: rgb + 1e26, r"from 0 to 1e\+25"),
    ],
)
def test_what_is_no_colour(data, rgb, change, message):
    with pytest.raises(VolumeError, match=message) as caught:
        Volume(data, colour=change(rgb), name="smoke")
    assert str(caught.value).startswith("smoke: the colour ")
    assert "\n" not in str(caught.value)


def test_products_beyond_float32_are_refused(data, rgb):
    with pytest.raises(VolumeError, match="beyond float32"):
        Volume(1e25 * (1 + data), colour=1e20 * (1 + rgb))


def test_sanitizing_sets_wrong_colours_to_0(data, rgb):
    wrong = rgb.copy()
    wrong[0, 0, 0] = np.nan, -1, np.inf
    expected = rgb.copy()
    expected[0, 0, 0] = 0
    volume = Volume(data, colour=wrong, sanitize=True)
    np.testing.assert_array_equal(volume.colour, expected)
    wrong.flags.writeable = False
    assert Volume(data, colour=wrong, sanitize=True).colour is not wrong


# -------------------------------------------------------------------------------------------- files


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["f4", ">f8", "f2", "u1", "?"])
def test_an_archive_brings_its_colour(tmp_path, data, rgb, save, order, dtype):
    stored = (3 * rgb).astype(dtype)
    save(tmp_path / "a.npz", density=data, colour=np.asarray(stored, order=order))
    volume = Volume.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(volume.colour, stored.astype(np.float32))
    assert volume.colour.flags.c_contiguous
    assert Volume.load(tmp_path / "a.npz", colour=False).colour is None


def test_a_scalar_grid_of_that_name_is_no_colour(tmp_path, data):
    np.savez(tmp_path / "a.npz", density=data, colour=data)
    assert Volume.load(tmp_path / "a.npz").colour is None


def test_colours_by_name_and_from_another_file(tmp_path, data, rgb):
    np.savez(tmp_path / "a.npz", density=data, colour=rgb, blush=rgb / 2)
    np.save(tmp_path / "b.npy", np.asfortranarray(rgb))
    np.savez(tmp_path / "one.npz", frame=np.arange(3), any_name=rgb / 4)
    np.savez(tmp_path / "two.npz", colour=rgb / 8, other=rgb)
    np.save(tmp_path / "density.npy", data)
    for source, factor in (("blush", 1 / 2), (tmp_path / "b.npy", 1), (str(tmp_path / "one.npz"), 1 / 4)):
        np.testing.assert_array_equal(
            Volume.load(tmp_path / "a.npz", colour=source).colour, rgb * np.float32(factor)
        )
    volume = Volume.load(tmp_path / "density.npy", colour=tmp_path / "two.npz")
    np.testing.assert_array_equal(volume.colour, rgb / 8)


def test_three_grids_make_a_colour(tmp_path, data, rgb):
    red, green, blue = np.moveaxis(rgb, -1, 0)
    np.savez(tmp_path / "a.npz", density=data, r=red, g=green, b=blue, small=data[:1])
    np.testing.assert_array_equal(
        Volume.load(tmp_path / "a.npz", "density", colour=["r", "g", "b"]).colour, rgb
    )
    for names, message in (
        (["r", "g"], "three names"),
        (["r", "g", "c"], "no grid named 'c'"),
        (["r", "g", "small"], r"grid 'small', a channel of the colour, has the shape \[1, 3, 4\]"),
    ):
        with pytest.raises(VolumeError, match=message):
            Volume.load(tmp_path / "a.npz", "density", colour=names)


def test_three_grids_of_a_tree():
    grids = {grid.name: grid for grid in volume_io.open_grids(SEVERAL)}
    volume = Volume.load(SEVERAL, "density[0]", colour=["mask", "density[0]", "density[1]"])
    np.testing.assert_array_equal(volume.colour[..., 0], grids["mask"].read())
    np.testing.assert_array_equal(volume.colour[..., 1], grids["density[0]"].read())
    assert (volume.colour[..., 2] == 0).all()  # it lies beside the other: the trees' boxes differ
    for name, message in (("shared", "does not have its voxels where"), ("velocity", "vectors are no")):
        with pytest.raises(VolumeError, match=message):
            Volume.load(SEVERAL, "density[0]", colour=["mask", "mask", name])


def test_a_grid_of_vectors_of_a_tree():
    """Its box is another than the density's, and its background fills what is beside it."""
    vectors = {grid.name: grid for grid in volume_io.open_grids(SEVERAL)}["velocity"]
    volume = Volume.load(SEVERAL, "density[0]", colour="velocity")
    np.testing.assert_array_equal(volume.colour, vectors.read_colour())
    np.testing.assert_array_equal(volume.colour[0, 0, 0], [1, 2, 3])
    beside = Volume.load(SEVERAL, "density[1]", colour="velocity")
    np.testing.assert_array_equal(beside.colour, np.zeros((8, 8, 8, 3)))
    for name, message in (
        ("mask", r"grid 'mask', of bool values, is not a colour .*\['r', 'g', 'b'\]"),
        ("Cd", "no grid named 'Cd'; it has 'density"),
    ):
        with pytest.raises(VolumeError, match=message):
            Volume.load(SEVERAL, "density[0]", colour=name)


def test_a_colour_of_a_grid_that_is_flat(tmp_path, rgb, data):
    """What cannot be inverted is told in words, whatever is asked for first."""
    flat = np.diag([1.0, 0.0, 1.0, 1.0])
    np.savez(tmp_path / "a.npz", density=data, r=data, world_from_index=flat)
    with pytest.raises(VolumeError, match="does not have its voxels where"):
        Volume.load(tmp_path / "a.npz", "density", colour=["r", "r", "r"])
    write_nrrd(tmp_path / "a.nrrd", rgb)
    with pytest.raises(VolumeError, match="'colour' is a colour by itself, not a channel"):
        Volume.load(tmp_path / "a.nrrd", "colour[0]", colour=["colour", "colour[1]", "colour[2]"])


def test_a_name_shared_by_channels_is_noted():
    volume = Volume.load(SEVERAL, "mask", colour=["density", "density", "density[1]"])
    (note,) = volume.notes
    assert "2 grids are named 'density'; this is 'density[0]'" in note
    assert volume.with_density_scale(2).notes == volume.notes


def write_nrrd(path, array, kinds="RGB-color space space space"):
    """``array`` is [z, y, x], or [z, y, x, 3]."""
    sizes = " ".join(map(str, array.shape[::-1]))
    header = (
        f"NRRD0004\ntype: float\ndimension: {array.ndim}\nsizes: {sizes}\nendian: little\nencoding: raw\n"
    )
    header += f"kinds: {kinds}\n\n" if array.ndim == 4 else "\n"
    path.write_bytes(header.encode() + np.asarray(array, "<f4").tobytes())


@pytest.mark.parametrize("kinds", ["RGB-color space space space", "vector space space space"])
def test_the_colour_may_be_a_file_of_any_format(tmp_path, data, rgb, kinds):
    np.save(tmp_path / "a.npy", data)
    write_nrrd(tmp_path / "colour.nrrd", rgb, kinds)
    volume = Volume.load(tmp_path / "a.npy", colour=tmp_path / "colour.nrrd")
    np.testing.assert_array_equal(volume.data, data)
    np.testing.assert_array_equal(volume.colour, rgb)
    write_nrrd(tmp_path / "other.nrrd", rgb[:, :2])
    write_nrrd(tmp_path / "grey.nrrd", data)
    for name, message in (
        (
            "other.nrrd",
            r"other\.nrrd: grid 'colour', the colour, has the shape \[2, 2, 4\]; expected \[2, 3, 4\]",
        ),
        ("grey.nrrd", "grey.nrrd: has no grid with three values per voxel .*its grids: 'density'"),
    ):
        with pytest.raises(VolumeError, match=message):
            Volume.load(tmp_path / "a.npy", colour=tmp_path / name)


def test_a_file_that_is_a_colour_takes_no_other(tmp_path, rgb):
    write_nrrd(tmp_path / "a.nrrd", rgb)
    np.testing.assert_array_equal(Volume.load(tmp_path / "a.nrrd").colour, rgb)
    for source in (False, "colour", tmp_path / "a.nrrd"):
        with pytest.raises(VolumeError, match="is a colour by itself; leave out colour"):
            Volume.load(tmp_path / "a.nrrd", colour=source)
    write_nrrd(tmp_path / "a.nrrd", -rgb - 1)
    with pytest.raises(VolumeError, match="holds 72 numbers that are not from 0"):
        Volume.load(tmp_path / "a.nrrd")
    assert Volume.load(tmp_path / "a.nrrd", sanitize=True).colour.max() == 0


@pytest.mark.parametrize("offset", [-20, -6, -5, -2, 0, 3, 7, 8, 1e15])
@pytest.mark.parametrize("size", [1, 6, 20])
def test_overlap_of_rows(offset, size):
    row, other = np.arange(8), offset + np.arange(float(size))
    of_row, of_other = _overlap(8, size, offset)
    np.testing.assert_array_equal(row[of_row], np.intersect1d(row, other))
    np.testing.assert_array_equal(other[of_other], np.intersect1d(row, other))


def hostile(rgb):
    """Contents of a colour file, and what is said of it."""
    negative, nan = rgb.copy(), rgb.copy()
    negative[1, 2, 3, 2], nan[0, 0, 1, 0] = -1, np.nan
    return {
        "shape": (
            rgb[:, :2],
            r"has the shape \[2, 2, 4, 3\]; expected \[z, y, x, 3\] of the volume, \[2, 3, 4, 3\]",
        ),
        "two channels": (rgb[..., :2], r"has the shape \[2, 3, 4, 2\]; expected"),
        "three axes": (rgb[..., 0], r"has the shape \[2, 3, 4\]; expected"),
        "negative": (negative, r"holds 1 numbers .* -1 at \[z=1, y=2, x=3, b\]"),
        "nan": (nan, r"holds 1 numbers .* nan at \[z=0, y=0, x=1, r\]"),
        "complex": (rgb.astype(complex), "holds values of type complex128"),
        "text": (rgb.astype(str), "holds values of type str"),
        "pickled": (rgb.astype(object), "holds pickled Python objects, which are never loaded"),
    }


@pytest.mark.parametrize("what", hostile(np.ones((2, 3, 4, 3))))
@pytest.mark.parametrize("place", ["array", "npy", "npz"])
def test_hostile_colours_are_one_line(tmp_path, data, rgb, what, place):
    array, message = hostile(rgb)[what]
    np.save(tmp_path / "a.npy", data)
    if place == "array":
        path, source, label = tmp_path / "a.npz", "tint", f"{tmp_path / 'a.npz'}: array 'tint'"
        np.savez(path, density=data, tint=array)
    elif place == "npy":
        path, source = tmp_path / "a.npy", tmp_path / "c.npy"
        np.save(source, array)
        label = f"{source}: the colour"
    else:
        path, source = tmp_path / "a.npy", tmp_path / "c.npz"
        np.savez(source, colour=array)
        label = f"{source}: array 'colour'"
    with pytest.raises(VolumeError, match=message) as caught:
        Volume.load(path, "density", colour=source)
    assert str(caught.value).startswith(label)
    assert "\n" not in str(caught.value)


def test_a_colour_that_came_by_itself_can_be_left_out(tmp_path, data, rgb):
    np.savez(tmp_path / "a.npz", density=data, colour=rgb[..., :1])
    with pytest.raises(VolumeError, match=r"array 'colour' has the shape .* volume\.colour=false"):
        Volume.load(tmp_path / "a.npz")
    Volume.load(tmp_path / "a.npz", colour=False)


def test_missing_and_damaged_files(tmp_path, data, rgb):
    np.save(tmp_path / "a.npy", data)
    np.savez(tmp_path / "a.npz", density=data, one=rgb, two=rgb)
    np.save(tmp_path / "c.npy", rgb)
    (tmp_path / "short.npy").write_bytes((tmp_path / "c.npy").read_bytes()[:-1])
    (tmp_path / "not.npz").write_bytes(b"PK")
    (tmp_path / "folder.npy").mkdir()
    with zipfile.ZipFile(tmp_path / "huge.npz", "w") as archive:
        header = (tmp_path / "c.npy").read_bytes()[:128].replace(b"(2, 3, 4, 3)", b"(9999,999,999,3)")
        archive.writestr("colour.npy", header)
    for source, message in (
        (tmp_path / "none.npy", "none.npy: no such file"),
        (tmp_path / "folder.npy", "folder.npy: is not a file"),
        (tmp_path / "short.npy", "short.npy: declares shape .* the file is damaged"),
        (tmp_path / "not.npz", "not.npz: not a readable .npz archive"),
        (tmp_path / "huge.npz", "huge.npz: "),
        (tmp_path / "a.npz", "a.npz: no array 'colour' .*its arrays: 'density', 'one', 'two'"),
        ("three", "a.npy: colour = 'three'"),
    ):
        with pytest.raises(VolumeError, match=message) as caught:
            Volume.load(tmp_path / "a.npy", colour=source)
        assert "\n" not in str(caught.value)
    with pytest.raises(VolumeError, match="no array 'three'"):
        Volume.load(tmp_path / "a.npz", colour="three")


def test_a_flipped_bit_is_found(tmp_path, data, rgb):
    path = tmp_path / "a.npz"
    np.savez(path, density=data, colour=rgb)
    content = bytearray(path.read_bytes())
    content[content.index(rgb.tobytes()) + 5] ^= 1
    path.write_bytes(content)
    with pytest.raises(VolumeError, match=r"CRC.*colour"):
        Volume.load(path)


def test_more_numbers_than_a_volume_may_have_are_refused_unread(tmp_path, data, rgb, monkeypatch):
    np.savez(tmp_path / "a.npz", density=data, colour=rgb)
    monkeypatch.setattr(limits, "MAX_VOXELS", 3 * data.size - 1)
    with pytest.raises(VolumeError, match=r"the colour of grid 'density' .* the limit is 71"):
        Volume.load(tmp_path / "a.npz")


# -------------------------------------------------------------------------------------- scene files


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "scene"
    folder.mkdir()
    np.savez(folder / "auto.npz", density=blobs(), colour=rainbow())
    grids = dict(zip(("r", "g", "b"), np.moveaxis(rainbow(), -1, 0), strict=True))
    np.savez(folder / "plain.npz", density=blobs(), tint=rainbow(), **grids)
    np.save(folder / "tint.npy", rainbow())
    np.savez(folder / "tint.npz", tint=rainbow())
    return folder


KEYS = {
    "found": ("auto.npz", None, "colour"),
    "an array": ("plain.npz", "tint", "tint"),
    "a npy": ("plain.npz", "tint.npy", "{folder}/tint.npy"),
    "a npz": ("plain.npz", "tint.npz", "{folder}/tint.npz"),
    "three grids": ("plain.npz", ["r", "g", "b"], ["r", "g", "b"]),
    "left out": ("auto.npz", False, False),
    "none": ("plain.npz", None, None),
}


@pytest.mark.parametrize("kind", KEYS)
def test_a_scene_file_and_the_one_written_from_it(folder, tmp_path, kind):
    name, colour, told = KEYS[kind]
    volume = {"file": name, "grid": "density"} | ({} if colour is None else {"colour": colour})
    (folder / "scene.toml").write_text(to_toml({"volume": volume}))
    file = SceneFile.read(folder / "scene.toml")
    scene = file.make(tfm.Scene)
    expected = None if kind in {"left out", "none"} else rainbow()
    written = tmp_path / "written.toml"  # elsewhere: paths must not be relative
    written.write_text(to_toml(options.table(file, scene)))

    again = SceneFile.read(written).make(tfm.Scene)

    for each in (scene, again):
        np.testing.assert_array_equal(each.volume.colour, expected)
    told = told.format(folder=folder.resolve()) if isinstance(told, str) else told
    assert options.table(file, scene)["volume"]["colour"] == told
    again_file = SceneFile.read(written)
    assert options.table(again_file, again)["volume"] == options.table(file, scene)["volume"]


def test_print_config_and_set(folder, capsys):
    (folder / "scene.toml").write_text('[volume]\nfile = "auto.npz"\n')
    for setting, told in ((), "colour"), (("--set", "volume.colour=false"), False):
        assert main(["render", str(folder / "scene.toml"), "--print-config", *setting]) == 0
        assert tomllib.loads(capsys.readouterr().out)["volume"]["colour"] == told
    arguments = [
        "--set",
        "volume.file=plain.npz",
        "--grid",
        "density",
        "--set",
        'volume.colour=["r", "g", "b"]',
    ]
    assert main(["render", str(folder / "scene.toml"), "--print-config", *arguments]) == 0
    assert tomllib.loads(capsys.readouterr().out)["volume"]["colour"] == ["r", "g", "b"]


@pytest.mark.slow
def test_a_bare_archive_renders_in_its_colours(folder, capsys):
    tiny = ("--look", "plain", "--res", "16x9", "--method", "dual", "--steps", "8", "--light-steps", "8")
    images = []
    for number, setting in enumerate(((), ("--set", "volume.colour=false"))):
        out = folder / f"{number}.npy"
        assert main(["render", str(folder / "auto.npz"), "-o", str(out), *tiny, *setting]) == 0, (
            capsys.readouterr()
        )
        images.append(np.load(out))
    assert np.ptp(images[0][..., :3], axis=-1).max() > 0.01
    assert np.ptp(images[1][..., :3], axis=-1).max() < 1e-6


@pytest.mark.parametrize(
    "value",
    ["true", "3", '""', '"a\\nb"', '["r", "g"]', '["r", "g", 3]', '["r", "g", ""]', "[]", "{}", "nan"],
)
def test_values_that_name_no_colour_are_one_line(folder, value):
    (folder / "scene.toml").write_text(f'[volume]\nfile = "plain.npz"\ncolour = {value}\n')
    with pytest.raises(SceneError, match=r"volume\.colour.*: should be the name of an array") as caught:
        SceneFile.read(folder / "scene.toml")
    assert "\n" not in str(caught.value)
