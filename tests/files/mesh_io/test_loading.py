"""Mesh files: colours, scene graphs, and what is damaged or hostile."""

import base64
import contextlib
import json
import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from tfm_cl.errors import SceneError
from tfm_cl.files import srgb
from tfm_cl.files.mesh_io import loading, triangles
from tfm_cl.render.tracing.tracer import Tracer
from tfm_cl.scene.solids import MeshSolid

LEVEL = 0.5 / 255
"""Half a level: trimesh keeps factors in 8 bits."""

FILE = 1e-6
"""Coordinates near 1 in float32, or in eight digits."""


def from_srgb(level):
    value = level / 255
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def seen(path, x=0.0, y=0.0, **options):
    """Albedo and distance where a ray from above (z = 10) falls."""
    hits = Tracer([MeshSolid(mesh=str(path), **options)]).nearest([x, y, 10.0], [0, 0, -1])
    return hits.albedo[0], float(hits.distance[0])


def square():
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    return trimesh.Trimesh(vertices, [[0, 1, 2], [0, 2, 3]], process=False)


@pytest.mark.parametrize("extension", ["glb", "gltf", "obj", "off", "ply", "stl", "PLY"])
def test_every_format_gives_the_same_surface(tmp_path, rng, extension):
    mesh = trimesh.creation.icosphere(subdivisions=2)
    path = tmp_path / f"ball.{extension}"
    if extension == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(mesh.scene()).items():
            (tmp_path / name.replace("model.gltf", "ball.gltf")).write_bytes(data)
    else:
        mesh.export(path, file_type=extension.lower())
    solid = MeshSolid(mesh=str(path))
    assert solid.load() is solid.load()
    origins = rng.normal(size=(500, 3)) * 5
    directions = -origins / np.linalg.norm(origins, axis=1, keepdims=True)
    one = Tracer([solid]).nearest(origins, directions)
    other = Tracer([MeshSolid.from_arrays(mesh.vertices, mesh.faces)]).nearest(origins, directions)
    np.testing.assert_allclose(one.distance, other.distance, atol=FILE)
    np.testing.assert_array_equal(one.albedo, np.full((500, 3), 0.8, np.float32))


def test_a_gltf_names_its_files_by_uri(tmp_path):
    for name, data in trimesh.exchange.gltf.export_gltf(square().scene()).items():
        (tmp_path / name.replace("buffer", "my buffer")).write_bytes(
            data.replace(b"gltf_buffer", b"gltf_my%20buffer")
        )
    assert len(MeshSolid(mesh=str(tmp_path / "model.gltf")).load().faces) == 2


def test_vertex_colours_are_srgb_and_interpolated(tmp_path):
    mesh = square()
    mesh.visual.vertex_colors = [[255, 0, 100, 255]] * 2 + [[0, 255, 100, 255]] * 2
    mesh.export(tmp_path / "a.ply")
    mesh.export(tmp_path / "a.obj")
    for name in ("a.ply", "a.obj"):
        for y in (-0.9, 0.0, 0.6):
            expected = [(1 - y) / 2, (1 + y) / 2, from_srgb(100)]
            np.testing.assert_allclose(seen(tmp_path / name, y=y)[0], expected, atol=FILE)


def test_vertex_colours_of_gltf_are_linear(tmp_path):
    mesh = square()
    mesh.visual.vertex_colors = [[255, 0, 100, 255]] * 4
    mesh.export(tmp_path / "a.glb")
    np.testing.assert_allclose(seen(tmp_path / "a.glb")[0], [1, 0, 100 / 255], atol=FILE)


def test_face_colours(tmp_path):
    mesh = square()
    mesh.visual.face_colors = [[200, 0, 0, 255], [0, 200, 0, 255]]
    mesh.export(tmp_path / "a.ply")
    np.testing.assert_allclose(seen(tmp_path / "a.ply", 0.5, -0.5)[0], [from_srgb(200), 0, 0], atol=FILE)
    np.testing.assert_allclose(seen(tmp_path / "a.ply", -0.5, 0.5)[0], [0, from_srgb(200), 0], atol=FILE)


def textured(material):
    mesh = square()
    uv = [[0.01, 0.01], [0.99, 0.01], [0.99, 0.99], [0.01, 0.99]]
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return mesh


def picture():
    """Top row red and green, bottom row blue and grey."""
    return Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [100, 100, 100]]], np.uint8))


CENTRE = 0.5 / 0.98
"""Where the texels' centres lie: texture coordinates leave out a hundredth on every side."""
CORNERS = [(-1, 1, [1, 0, 0]), (1, 1, [0, 1, 0]), (-1, -1, [0, 0, 1]), (1, -1, [from_srgb(100)] * 3)]


def test_a_gltf_texture_and_factor_multiply(tmp_path):
    factor = np.array([0.5, 0.25, 1.0, 1.0])
    textured(PBRMaterial(baseColorFactor=factor, baseColorTexture=picture())).export(tmp_path / "a.glb")
    for x, y, colour in CORNERS:
        found = seen(tmp_path / "a.glb", x * CENTRE, y * CENTRE)[0]
        np.testing.assert_allclose(found, factor[:3] * colour, atol=LEVEL + 1e-4)


def test_an_obj_texture_and_diffuse_multiply(tmp_path):
    textured(SimpleMaterial(image=picture(), diffuse=[0.5, 0.5, 1.0])).export(tmp_path / "a.obj")
    for x, y, colour in CORNERS:
        found = seen(tmp_path / "a.obj", x * CENTRE, y * CENTRE)[0]
        np.testing.assert_allclose(found, np.array([0.5, 0.5, 1.0]) * colour, atol=LEVEL + 1e-4)


def normals_of(path, **options):
    """Where a ray from above falls on a square whose normals lean; flat ones are 0, 0, 1."""
    hits = Tracer([MeshSolid(mesh=str(path), **options)]).nearest([0.1, 0.2, 10.0], [0, 0, -1])
    return hits.normal[0]


@pytest.mark.parametrize("extension", ["glb", "obj", "ply"])
def test_normals_of_a_file_are_smooth(tmp_path, extension):
    path, leaning = tmp_path / f"a.{extension}", np.array([0.6, 0, 0.8])
    mesh = square()
    mesh.vertex_normals = np.tile(leaning, (4, 1))
    mesh.export(path, **{"vertex_normal" if extension == "ply" else "include_normals": True})
    for options in ({}, {"smooth": True}):
        np.testing.assert_allclose(normals_of(path, **options), leaning, atol=FILE)
    for options in ({"smooth": False}, {"smooth": 30}):
        np.testing.assert_allclose(normals_of(path, **options), [0, 0, 1], atol=FILE)
    square().export(path)
    assert MeshSolid(mesh=str(path)).load().normals is None


def test_normals_of_parts_turn_with_them(tmp_path):
    scene, leaning = trimesh.Scene(), np.array([0.6, 0, 0.8])
    for x, smooth in ((0, True), (5, False)):
        mesh = square()
        if smooth:
            mesh.vertex_normals = np.tile(leaning, (4, 1))
        matrix = np.diag([-1.0, 2, 0.5, 1])
        matrix[0, 3] = x
        scene.add_geometry(mesh, transform=matrix)
    (tmp_path / "a.glb").write_bytes(trimesh.exchange.gltf.export_glb(scene, include_normals=None))
    solid = MeshSolid(mesh=str(tmp_path / "a.glb"))
    hits = Tracer([solid]).nearest([[0.1, 0.2, 10.0], [5.1, 0.2, 10]], [0, 0, -1])
    turned = leaning / (-1, 2, 0.5)
    np.testing.assert_allclose(hits.normal, [turned / np.linalg.norm(turned), [0, 0, 1]], atol=FILE)


def written(tmp_path, *, attributes=None, arrays=(), **changes):
    """A glTF of one triangle with texture coordinates; further arrays are accessors from 2 on."""
    uv = np.array([[0, 1], [1, 1], [0, 0]], np.float32)  # v downwards
    stored = [np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32), uv, *arrays]
    codes = {"float32": 5126, "uint8": 5121, "uint16": 5123}
    data, views, accessors = b"", [], []
    for number, values in enumerate(stored):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        accessor = {"bufferView": number, "componentType": codes[values.dtype.name], "count": 3}
        accessors.append(accessor | {"type": f"VEC{values.shape[1]}"})
        data += values.tobytes()
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1} | (attributes or {})}
    if "materials" in changes:
        primitive["material"] = 0
    picture().save(tmp_path / "picture.png")
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    header = {
        "buffers": [{"uri": uri, "byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": [primitive]}],
        "images": [{"uri": "picture.png"}],
        "textures": [{"source": 0}],
    }
    (tmp_path / "a.gltf").write_text(gltf(**header | changes))
    return tmp_path / "a.gltf"


def material(**use):
    return [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0} | use}}]


def test_vertex_colours_of_gltf_keep_their_bits(tmp_path):
    levels = np.full((3, 4), (1000, 30000, 65535, 65535), np.uint16)
    path = written(tmp_path, attributes={"COLOR_0": 2}, arrays=[levels])
    np.testing.assert_allclose(seen(path, 0.2, 0.2)[0], levels[0, :3] / 65535, atol=FILE)
    path = written(tmp_path, attributes={"COLOR_0": 2}, arrays=[levels], materials=material())
    # Times the texture, whose lower left texel is blue.
    np.testing.assert_allclose(seen(path, 0.25, 0.25)[0], [0, 0, 1], atol=1e-3)


SHIFTED = {"extensions": {"KHR_texture_transform": {"offset": [0.5, 0.0]}}}
TURNED = {
    "extensions": {"KHR_texture_transform": {"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5]}}
}


BLUE, GREY = np.array([0, 0, 1.0]), np.full(3, from_srgb(100))


@pytest.mark.parametrize(
    ("use", "sampler", "x", "colour"),
    [
        ({}, {}, 0.25, BLUE),
        (SHIFTED, {}, 0.25, GREY),
        (SHIFTED, {}, 0.7, 0.9 * BLUE + 0.1 * GREY),
        (SHIFTED, {"wrapS": 33071}, 0.7, GREY),
        (SHIFTED, {"wrapS": 33648}, 0.7, GREY),
        # Its page: the lower left quadrant, and the image turns clockwise.
        (TURNED, {"wrapT": 33071}, 0.1, 0.75 * BLUE + 0.25 * GREY),
    ],
    ids=range(6),
)
def test_a_gltf_texture_lies_where_its_sampler_says(tmp_path, use, sampler, x, colour):
    changes = {"textures": [{"source": 0, "sampler": 0}], "samplers": [sampler]}
    path = written(tmp_path, materials=material(**use), **changes)
    np.testing.assert_allclose(seen(path, x, 0.25)[0], colour, atol=LEVEL)


def test_a_second_set_of_texture_coordinates_is_refused(tmp_path):
    path = written(tmp_path, materials=material(texCoord=1))
    assert "uses a second set of texture coordinates" in refused(path)
    assert seen(path, 0.2, 0.2, albedo=0.5)[0].tolist() == [0.5] * 3


def test_an_image_as_albedo_replaces_the_files_colours(tmp_path):
    for path in (written(tmp_path), written(tmp_path, materials=material())):
        image = tmp_path / "grey.png"
        Image.fromarray(np.uint8([[100]])).save(image)
        np.testing.assert_allclose(
            seen(path, 0.2, 0.2, albedo=str(image))[0], [from_srgb(100)] * 3, rtol=5e-4
        )
    square().export(tmp_path / "a.ply")
    with pytest.raises(SceneError, match="has no texture coordinates"):
        MeshSolid(mesh=str(tmp_path / "a.ply"), albedo=str(image)).load()
    for name, data in (("cut.png", image.read_bytes()[:40]), ("text.jpg", b"none"), ("missing.png", None)):
        if data is not None:
            (tmp_path / name).write_bytes(data)
        with pytest.raises(SceneError, match=name) as caught:
            MeshSolid(mesh=str(path), albedo=str(tmp_path / name)).load()
        assert str(caught.value).isprintable()


def test_images_of_a_file_are_bounded(tmp_path, monkeypatch):
    path = written(tmp_path, materials=material())
    monkeypatch.setattr(loading, "MAX_TEXELS", 3)
    assert "its images have more than 3 texels" in refused(path)
    monkeypatch.undo()
    monkeypatch.setattr(srgb, "MAX_TEXELS", 3)
    assert "an image of 2×2 texels; the limit is 3" in refused(path)
    monkeypatch.undo()
    picture().save(tmp_path / "picture.png", format="ICNS")
    assert "an image of the kind ICNS" in refused(path)


def test_colours_beside_texture_coordinates_that_nothing_uses(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "property float s\nproperty float t\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0 0 0 200 0 255\n1 0 0 1 0 200 0 255\n0 1 0 0 1 200 0 255\n3 0 1 2\n"
    )
    (tmp_path / "a.obj").write_text(
        "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    )
    np.testing.assert_allclose(seen(tmp_path / "a.ply", 0.2, 0.2)[0], [from_srgb(200), 0, 1], atol=FILE)
    np.testing.assert_allclose(seen(tmp_path / "a.obj", 0.2, 0.2)[0], [1, 0, 0], atol=FILE)


def test_a_base_colour_is_linear(tmp_path):
    textured(PBRMaterial(baseColorFactor=[0.5, 0.1, 0.0, 1.0])).export(tmp_path / "a.glb")
    np.testing.assert_allclose(seen(tmp_path / "a.glb")[0], [0.5, 0.1, 0], atol=LEVEL)
    textured(PBRMaterial()).export(tmp_path / "white.glb")
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 0.5 0.123456 0.0\nnewmtl n\nKa 1 1 1\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n")
    np.testing.assert_allclose(seen(tmp_path / "a.obj", 0.2, 0.2)[0], [0.5, 0.123456, 0], atol=FILE)
    (tmp_path / "b.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl n\nf 1 2 3\n")
    np.testing.assert_allclose(seen(tmp_path / "b.obj", 0.2, 0.2)[0], [0.8] * 3, atol=FILE)


def test_an_albedo_replaces_the_files_colours(tmp_path):
    textured(PBRMaterial(baseColorFactor=[0.5, 0.1, 0.0, 1.0], baseColorTexture=picture())).export(
        tmp_path / "a.glb"
    )
    assert (
        seen(tmp_path / "a.glb", albedo=(0.1, 0.2, 0.3))[0].tolist() == np.float32([0.1, 0.2, 0.3]).tolist()
    )


@pytest.mark.parametrize("extension", ["glb", "obj"])
def test_a_scene_graph_is_flattened(tmp_path, extension):
    scene = trimesh.Scene()
    for index, x in enumerate((-3.0, 0.0, 3.0)):
        part = square()
        part.visual = trimesh.visual.TextureVisuals(
            uv=np.zeros((4, 2)),
            material=PBRMaterial(name=f"m{index}", baseColorFactor=[index * 100, 50, 0, 255]),
        )
        matrix = trimesh.transformations.translation_matrix([x, 0, index])
        scene.add_geometry(part, node_name=f"n{index}", geom_name=f"g{index}", transform=matrix)
    # One geometry in two places, below another node, mirrored.
    matrix = np.diag([-1.0, 1, 1, 1])
    matrix[:3, 3] = [0, 5, 1]
    scene.graph.update(frame_from="n1", frame_to="copy", geometry="g1", matrix=matrix)
    scene.export(tmp_path / f"a.{extension}")
    for index, x in enumerate((-3.0, 0.0, 3.0)):
        albedo, distance = seen(tmp_path / f"a.{extension}", x)
        assert distance == pytest.approx(10 - index, abs=1e-5)
        np.testing.assert_allclose(albedo, np.array([index * 100, 50, 0]) / 255, atol=1e-6)
    albedo, distance = seen(tmp_path / f"a.{extension}", 0.0, 5.0)
    assert distance == pytest.approx(8, abs=1e-5)
    np.testing.assert_allclose(albedo, np.array([100, 50, 0]) / 255, atol=1e-6)


def test_thousands_of_parts(tmp_path):
    scene = trimesh.Scene()
    for index in range(3000):
        x, y = index % 60, index // 60
        part = trimesh.Trimesh([[x, y, 0], [x + 1, y, 0], [x, y + 1, 0]], [[0, 1, 2]], process=False)
        part.visual.vertex_colors = [[index % 250, 0, 0, 255]] * 3
        scene.add_geometry(part)
    scene.export(tmp_path / "a.glb")
    solid = MeshSolid(mesh=str(tmp_path / "a.glb"))
    assert len(solid.load().faces) == 3000
    places = np.array([[index % 60 + 0.3, index // 60 + 0.3, 5] for index in range(3000)])
    hits = Tracer([solid]).nearest(places, [0, 0, -1])
    np.testing.assert_allclose(hits.albedo[:, 0], np.arange(3000) % 250 / 255, atol=FILE)


def gltf(**changes):
    """A triangle; keys are replaced, with None left out."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(positions).decode()
    header = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": uri, "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    } | changes
    return json.dumps({key: value for key, value in header.items() if value is not None})


def test_a_plain_gltf(tmp_path):
    (tmp_path / "a.gltf").write_text(gltf())
    albedo, distance = seen(tmp_path / "a.gltf", 0.2, 0.2)
    assert (albedo.tolist(), distance) == ([np.float32(0.8)] * 3, 10.0)


ACCESSOR = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
PRIMITIVE = {"attributes": {"POSITION": 0}}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"accessors": [ACCESSOR | {"count": 10**12}]}, "announces"),
        ({"accessors": [ACCESSOR | {"count": -3}]}, "a count is a whole number"),
        ({"accessors": [ACCESSOR | {"count": 3.0}]}, "a count is a whole number"),
        ({"accessors": [{**ACCESSOR, "count": 10**9, "bufferView": 0, "byteStride": 0}]}, "announces"),
        (
            {"accessors": [{"componentType": 5126, "count": 10**10, "type": "VEC3"}]},
            "save the file without compression",
        ),
        ({"bufferViews": [{"buffer": 0, "byteLength": 2**30}] * 3}, "announces"),
        (
            {"meshes": [{"primitives": [PRIMITIVE] * 999}] * 20, "accessors": [ACCESSOR | {"count": 10000}]},
            "announces 66,600,000 triangles",
        ),
        ({"meshes": [{"primitives": [PRIMITIVE | {"indices": 7}]}]}, "not a readable"),
        ({"nodes": [{"mesh": 0, "matrix": [float("nan")] * 16}]}, "is not finite"),
        ({"nodes": [{"mesh": 0, "scale": [0, 0, 0]}]}, "no triangle has an area"),
        ({"nodes": [{"children": [0]}]}, "holds no triangles"),
        ({"nodes": [{"mesh": 5}]}, "holds no triangles"),
        ({"buffers": [{"uri": "/dev/zero", "byteLength": 36}]}, "escapes"),
        ({"buffers": [{"uri": "../../../../etc/passwd", "byteLength": 36}]}, "escapes"),
        (
            {"buffers": [{"uri": "missing.bin", "byteLength": 36}]},
            "it names 'missing.bin', which is not there",
        ),
        ({"buffers": [{"uri": "http://127.0.0.1:9/a.bin", "byteLength": 36}]}, "which is not there"),
        ({"buffers": [{"uri": "pipe", "byteLength": 36}]}, "which is not there"),
        ({"meshes": []}, "holds no triangles"),
        ({"scenes": None}, "holds no triangles"),
    ],
    ids=range(19),
)
def test_a_gltf_that_asks_for_too_much_or_makes_no_sense(tmp_path, changes, message):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "a.gltf").write_text(gltf(**changes))
    assert message in refused(tmp_path / "a.gltf")


def refused(path):
    with pytest.raises(SceneError) as caught:
        MeshSolid(mesh=str(path)).load()
    line = str(caught.value)
    assert line.startswith(f"{path}: ")
    assert line.isprintable()
    assert len(line) < len(str(path)) + 400
    return line


def test_instances_count(tmp_path, monkeypatch):
    nodes = [{"mesh": 0, "translation": [index, 0, 0]} for index in range(50)]
    (tmp_path / "a.gltf").write_text(gltf(nodes=nodes, scenes=[{"nodes": list(range(50))}]))
    assert len(MeshSolid(mesh=str(tmp_path / "a.gltf")).load().faces) == 50
    monkeypatch.setattr(loading, "MAX_FACES", 49)
    assert "50 triangles; the limit is 49" in refused(tmp_path / "a.gltf")


TEXTS = {
    "empty.ply": b"",
    "empty.glb": b"",
    "empty.obj": b"",
    "empty.off": b"",
    "empty.stl": b"",
    "empty.gltf": b"",
    "list.gltf": b"[]",
    "deep.gltf": b"[" * 100_000,
    "points.obj": b"v 0 0 0\nv 1 0 0\n",
    "range.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
    "huge.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999999\n",
    "nan.obj": b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "inf.off": b"OFF\n3 1 0\ninf 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    "flat.off": b"OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n",
    "short.off": b"OFF\n3 1000000000000 0\n0 0 0\n",
    "negative.off": b"OFF\n-3 -1 0\n",
    "range.off": b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
    "long.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\nproperty float x\n"
    b"property float y\nproperty float z\nend_header\n",
    "nothing.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\nend_header\n",
    "unended.ply": b"ply\nformat ascii 1.0\nelement vertex 3\n",
    "list.ply": b"ply\nformat binary_little_endian 1.0\nelement face 4000000000\n"
    b"property list uint uint vertex_indices\nend_header\n\xff\xff\xff\xff",
    "range.ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    b"0 0 0\n1 0 0\n0 1 0\n3 0 1 -2\n",
    "count.stl": b"\0" * 80 + b"\xff\xff\xff\xff",
    "text.stl": b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n",
    "chunk.glb": b"glTF\x02\0\0\0\xff\xff\xff\xff\xff\xff\xff\xffJSON{}",
    "pickle.ply": b"\x80\x04\x95cos\nsystem\n(S'false'\ntR.",
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_damaged_file_is_one_line(tmp_path, name):
    (tmp_path / name).write_bytes(TEXTS[name])
    refused(tmp_path / name)


@pytest.mark.parametrize("extension", ["glb", "ply", "stl", "obj", "off"])
def test_bytes_that_were_changed(tmp_path, rng, extension):
    """A clear error, or a mesh that can be traced."""
    mesh = trimesh.creation.icosphere(subdivisions=1)
    mesh.visual.vertex_colors = [[200, 100, 50, 255]] * len(mesh.vertices)
    path = tmp_path / f"a.{extension}"
    mesh.export(path)
    whole, read = path.read_bytes(), 0
    for trial in range(120):
        data = bytearray(whole)
        if trial % 3 == 0:
            data = data[: rng.integers(len(data))]
        else:
            # Half of them in the first part, where headers are.
            last = len(data) if trial % 2 else min(len(data), 400)
            for place in rng.integers(last, size=rng.integers(1, 6)):
                data[place] = rng.integers(256)
        path.write_bytes(bytes(data))
        with contextlib.suppress(SceneError):
            MeshSolid(mesh=str(path)).load()
            read += 1
            hits = Tracer([MeshSolid(mesh=str(path))]).nearest([0.1, 0.2, 10], [0, 0, -1])
            assert not np.isnan(hits.distance).any()
            assert np.isfinite(hits.normal).all()
            assert ((hits.albedo >= 0) & (hits.albedo <= 1)).all()
            continue
        refused(path)
    assert 0 < read < 120


def test_files_that_are_none(tmp_path, monkeypatch):
    (tmp_path / "folder.ply").mkdir()
    assert "is not a file" in refused(tmp_path / "folder.ply")
    assert "no such file" in refused(tmp_path / "no.ply")
    assert "cannot be read" in refused(tmp_path / ("a" * 300 + ".ply"))
    os.mkfifo(tmp_path / "pipe.ply")
    assert "is not a file" in refused(tmp_path / "pipe.ply")
    square().export(tmp_path / "a.ply")
    monkeypatch.setattr(loading, "MAX_BYTES", 10)
    assert "the limit for meshes is 10" in refused(tmp_path / "a.ply")


def test_a_limit_of_triangles(tmp_path, monkeypatch):
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "a.stl")
    monkeypatch.setattr(loading, "MAX_FACES", 319)
    assert "320 triangles; the limit is 319" in refused(tmp_path / "a.stl")
    monkeypatch.setattr(loading, "MAX_FACES", 320)
    monkeypatch.setattr(triangles, "MAX_FACES", 319)
    assert "320 triangles; the limit is 319" in refused(tmp_path / "a.stl")


@pytest.mark.parametrize(
    "name", ['{"a": 1}.ply', "http:..a.ply", "*.ply", "~.ply", "é ß.ply", "-.ply", "%n.ply"]
)
def test_strange_names_are_only_names(tmp_path, name, monkeypatch):
    monkeypatch.chdir(tmp_path)
    square().export(tmp_path / "plain.ply")
    (tmp_path / "plain.ply").rename(tmp_path / name)
    assert len(MeshSolid(mesh=name).load().faces) == 2


def test_nothing_is_printed(tmp_path, capfd):
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd broken.png\n")
    (tmp_path / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\nbroken")
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nvt 0 0\nf 1/1 2/1 3/1\n"
    )
    code = f"from tfm_cl.scene.solids import MeshSolid\nMeshSolid(mesh={str(tmp_path / 'a.obj')!r}).load()"
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
    assert capfd.readouterr() == ("", "")


def test_importing_solids_does_not_import_their_libraries():
    code = "import sys; from tfm_cl.render.tracing.tracer import Tracer\n"
    code += "from tfm_cl.scene.solids import SphereSolid; Tracer([SphereSolid()])\n"
    code += "print(*{name.partition('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert not {"trimesh", "embreex", "scipy", "PIL", "networkx"} & set(done.stdout.split())
