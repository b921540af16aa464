"""Small volumes and scenes for the tests."""

import numpy as np

import tfm_cl as tfm


def blobs(shape=(14, 12, 16), seed=7):
    """A small lumpy density [z, y, x] in [0, 1] with empty corners: smooth, asymmetric, non-cubic."""
    rng = np.random.default_rng(seed)
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    density = np.zeros(shape)
    for _ in range(9):
        centre, width = rng.uniform(-0.5, 0.5, 3), rng.uniform(0.25, 0.55)
        square = (z - centre[0]) ** 2 + (y - centre[1]) ** 2 + (x - centre[2]) ** 2
        density += rng.uniform(0.3, 1.0) * np.exp(-square / width**2)
    return np.clip(density - 0.15, 0, 1).astype(np.float32)


def turned(degrees, axis, scale=(1.0, 1.0, 1.0), offset=(0.0, 0.0, 0.0)):
    """World-from-index matrix: anisotropic voxels, turned about an axis, moved."""
    angle, axis = np.radians(degrees), np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.cross(np.eye(3), axis)
    matrix = np.eye(4)
    matrix[:3, :3] = (
        np.cos(angle) * np.eye(3) - np.sin(angle) * cross + (1 - np.cos(angle)) * np.outer(axis, axis)
    ) @ np.diag(scale)
    matrix[:3, 3] = offset
    return matrix


def make_scene(**changes):
    """A scene that a float64 reference renders in a second: coloured, HG, turned anisotropic voxels."""
    volume = tfm.Volume(
        blobs(),
        world_from_index=turned(25, (1, 2, 0.5), (0.15, 0.2, 0.14), (-1.1, -1.0, -0.9)),
        density_scale=4.0,
    )
    scene = tfm.Scene(
        volume,
        medium=tfm.Medium(sigma_s=(1.0, 0.8, 0.5), sigma_a=(0.1, 0.3, 0.2), phase=tfm.HenyeyGreenstein(0.4)),
        camera=tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0.05, 0.1, 0), fov=38, res=(24, 18)),
        lights=[tfm.SpotLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), cone=24, intensity=(3, 2.5, 2))],
        map=tfm.MapSettings(basis="dct", coeffs=8, density_weighting=10.0, res=24, steps=24),
        march=tfm.MarchSettings(steps=30),
    )
    return scene.replace(**changes)
