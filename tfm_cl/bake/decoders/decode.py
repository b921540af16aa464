"""Transmittance function maps of `tfm bake`, decoded by NumPy."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
EDGE = 0.501  # half a map, and what rays may pass it by
OCTAHEDRON = 3


def texture(layers: Array, u: Array, v: Array) -> Array:
    """Sample layers [n, height, width, 4] bilinearly, clamped to the edge: [n, points, 4]."""
    height, width = layers.shape[1:3]
    x, y = np.clip(u * width - 0.5, 0, width - 1), np.clip(v * height - 0.5, 0, height - 1)
    x0, y0 = x.astype(int), y.astype(int)
    x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    low, high = ((1 - fx) * layers[:, row, x0] + fx * layers[:, row, x1] for row in (y0, y1))
    return (1 - fy) * low + fy * high  # type: ignore[no-any-return]


def optical_depth(
    entry: dict[str, Any], coefficients: Array, ranges: Array, functions: Array, points: Array
) -> Array:
    """Of density 1, [n], between a light and world points [n, 3]; T = exp(-extinction * it); dark: infinite.

    ``entry`` is one of maps.json, the next three are its textures, float [layers, height, width, 4].
    """
    matrix, kind, box = np.array(entry["light_from_world"]), entry["projection"], entry["box"]
    p = points @ matrix[:3, :3].T + matrix[:3, 3]
    z, length = p[:, 2], np.linalg.norm(p, axis=1)
    way = z if kind == 0 else length
    with np.errstate(divide="ignore", invalid="ignore"):
        n = p / np.abs(p).sum(axis=1)[:, None]
        place = (p, p / z[:, None], n[:, :1] + n[:, 1:2] * [1, -1], n)[kind][:, :2]
        folded = (1 - np.abs(n[:, 1::-1])) * np.where(n[:, :2] < 0, -1, 1)
        place = np.where((kind == OCTAHEDRON) & (n[:, 2:] < 0), folded, place)
        uv = place * entry["chart"][:2] + entry["chart"][2:]
        met = (np.abs(uv - 0.5) <= EDGE).all(axis=1) & ((z > 0) | (kind in (0, OCTAHEDRON)))
        u, v = np.where(met[:, None], uv, 0.5).T
        begin, end, slope, last = texture(ranges, u, v)[0].T
        if box:
            unit = np.array(entry["unit_from_light"])
            a, b = (q @ unit[:3, :3].T + unit[:3, 3] for q in (p * [1, 1, 0] * (kind == 0), p))
            low, high = np.sort([-a / (b - a), (1 - a) / (b - a)], axis=0)
            begin, end = way * np.maximum(low.max(axis=1), 0), way * high.min(axis=1)
        at = np.clip(np.nan_to_num((way - begin) / (end - begin)), 0, 1) * (functions.shape[2] - 1) + 0.5
    terms = texture(coefficients, u, v) * texture(functions, at / functions.shape[2], 0 * at)
    offset, scale, weighting, most = entry["series"]
    f = offset + scale * terms.sum(axis=(0, 2))
    depth = -weighting * np.log(np.clip(f, 1e-37, 1)) if weighting > 0 else np.clip(f, 0, most)
    depth = depth + (0 if box else np.maximum(np.minimum(way, last) - end, 0) * slope)
    dark = (p @ entry["cone"][:3] < entry["cone"][3] * length) | (way >= entry["reach"])
    return np.where(dark, np.inf, np.where(met & (begin < (end if box else way)), depth, 0))
