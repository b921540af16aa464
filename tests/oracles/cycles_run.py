"""Run by the Python of an environment with ``bpy``: what Cycles makes of a description on standard input.

``python cycles_run.py osl OUT.npy``: a JSON object with ``shader``, a file of Open Shading Language whose
output ``depth`` becomes exp(-sigma_t depth), on a plane that is seen from above: ``corner``, ``right`` and
``up`` in world space, ``pixels`` along both. Writes float32 [row from the corner on, column, RGBA].

``python cycles_run.py box OUT.npy``: ``scatter``, ``absorption`` and ``emission`` of RGB per world unit in
the box from ``low`` to ``high``, seen from ``matrix`` (world from camera) with ``fov`` and ``res``;
``orders`` of scattering and ``samples`` of a pixel. Writes float32 [row from the top, column, RGBA].
"""

import hashlib
import json
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

import _cycles  # isort: skip - after bpy, which brings it


def _empty_scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 1
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type = "GAUSSIAN"
    scene.cycles.filter_width = 0.01
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    return scene


def _picture(scene):
    """Render, and return float32 [row from the bottom, column, RGBA]."""
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "picture.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)


def _seen_from_above(scene, corner, right, up):
    """Put an orthographic camera in front of a plane that fills its picture; returns the plane."""
    mesh = bpy.data.meshes.new("plane")
    mesh.from_pydata([corner, corner + right, corner + right + up, corner + up], [], [(0, 1, 2, 3)])
    plane = bpy.data.objects.new("plane", mesh)
    scene.collection.objects.link(plane)
    size = np.linalg.norm(right)
    axes = np.stack([right / size, up / np.linalg.norm(up)])
    normal = np.cross(*axes)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([*axes, normal], axis=1)
    matrix[:3, 3] = corner + (right + up) / 2 + normal
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", size
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.camera.matrix_world = matrix.T.tolist()
    scene.collection.objects.link(scene.camera)
    return plane


def _compiled(source):
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "shader.oso"
        if not _cycles.osl_compile(source, str(target)):
            sys.exit(f"{source}: is not compiled")
        return target.read_text()


def osl(asked):
    """Return the transmittance that a shader says on a plane."""
    scene = _empty_scene()
    scene.cycles.shading_system = True
    scene.render.resolution_x = scene.render.resolution_y = asked["pixels"]
    plane = _seen_from_above(scene, *(np.array(asked[name], float) for name in ("corner", "right", "up")))
    material = bpy.data.materials.new("shader")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    script = nodes.new("ShaderNodeScript")  # whose file is compiled here: the package cannot ask for sockets
    script.mode, script.bytecode = "INTERNAL", _compiled(asked["shader"])
    script.bytecode_hash = hashlib.md5(script.bytecode.encode(), usedforsecurity=False).hexdigest()
    script.outputs.new("NodeSocketFloat", "depth")
    scaled, transmittance = nodes.new("ShaderNodeMath"), nodes.new("ShaderNodeMath")
    scaled.operation, transmittance.operation = "MULTIPLY", "EXPONENT"
    scaled.inputs[1].default_value = -asked["sigma_t"]
    emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    links.new(script.outputs["depth"], scaled.inputs[0])
    links.new(scaled.outputs[0], transmittance.inputs[0])
    links.new(transmittance.outputs[0], emission.inputs["Strength"])
    links.new(emission.outputs[0], output.inputs["Surface"])
    plane.data.materials.append(material)
    return _picture(scene)


def box(asked):
    """Return the picture of a homogeneous box that glows."""
    scene = _empty_scene()
    scene.render.resolution_x, scene.render.resolution_y = asked["res"]
    scene.cycles.samples = asked["samples"]
    scene.cycles.max_bounces = scene.cycles.volume_bounces = asked["orders"]
    scene.cycles.sample_clamp_direct = scene.cycles.sample_clamp_indirect = 0.0
    low, high = np.array(asked["low"], float), np.array(asked["high"], float)
    bpy.ops.mesh.primitive_cube_add(size=1, location=(low + high) / 2, scale=high - low)
    cube = bpy.context.object
    material = bpy.data.materials.new("medium")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    medium, output = nodes.new("ShaderNodeVolumeCoefficients"), nodes.new("ShaderNodeOutputMaterial")
    for name in ("scatter", "absorption", "emission"):
        medium.inputs[f"{name.capitalize()} Coefficients"].default_value = asked[name]
    material.node_tree.links.new(medium.outputs[0], output.inputs["Volume"])
    cube.data.materials.append(material)
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.angle_y = "VERTICAL", np.radians(asked["fov"])
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.camera.matrix_world = np.array(asked["matrix"]).T.tolist()
    scene.collection.objects.link(scene.camera)
    return _picture(scene)[::-1]


if __name__ == "__main__":
    what, out = sys.argv[1:]
    np.save(out, {"osl": osl, "box": box}[what](json.load(sys.stdin)))
