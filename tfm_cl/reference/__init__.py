"""The renderer once more, in float64 NumPy: the truth that the kernels are tested against.

Small enough to read in one sitting, in this order: `geometry` (rays, intervals, steps), `primitives` (what
they leave along rays), `bodies` (density, lengths), `march` (a camera ray, step by step), `fitting` (lights
and their rays), `light` and `maps` (what is left of the light at a point, exactly or from a transmittance
function map), `solids`, `picture`.

Rays are arrays ``[rays, 3]`` in world space with unit directions, distances ``[rays]``; Python loops run over
steps, bodies and lights only. An interval (begin, end) is the part of a ray between two distances ≥ 0, (0, 0)
where there is none. A scene's grids and primitives are marched, but what primitives hold in a step is exact;
its homogeneous bodies are known in closed form. What light rays gather of what is marched is a few scalars,
the fields of `tfm_cl.scene.fields`: their optical depths are the densities' alone (TFM eq. 13),
``[rays, K]``, and become RGB by the fields' matrix (eq. 14).

Shared with the product, which has tests of their own: the lights' geometry (`tfm_cl.scene.lights`), the order
and the matrix of the fields, phase functions, the functions of the bases, and the solids' tracer
(`tfm_cl.render.tracing`). What is done with their answers is done here again.

Source: Delalandre, Gautron, Marvie, François, "Transmittance Function Mapping", I3D 2011 (TFM).
"""

from tfm_cl.reference.advection import moved_voxels
from tfm_cl.reference.bodies import Grids, body_interval, density, field_density, march_bounds
from tfm_cl.reference.fitting import cone_interval, map_rays, texel_rays
from tfm_cl.reference.geometry import CHUNK, Floats, Interval, Rays, edges
from tfm_cl.reference.light import light_optical_depth, light_transmittance, light_ways, unshadowed
from tfm_cl.reference.maps import (
    AUTO_RES,
    DARKEST,
    EDGE_MARGIN,
    MapModel,
    bilinear,
    build_map,
    density_weighting,
    map_model,
    map_optical_depth,
)
from tfm_cl.reference.picture import Crop, Method, camera_rays, render, render_with_aovs
from tfm_cl.reference.solids import Shadows, solid_distances, solid_visibility

__all__ = [
    "AUTO_RES",
    "CHUNK",
    "DARKEST",
    "EDGE_MARGIN",
    "Crop",
    "Floats",
    "Grids",
    "Interval",
    "MapModel",
    "Method",
    "Rays",
    "Shadows",
    "bilinear",
    "body_interval",
    "build_map",
    "camera_rays",
    "cone_interval",
    "density",
    "density_weighting",
    "edges",
    "field_density",
    "light_optical_depth",
    "light_transmittance",
    "light_ways",
    "map_model",
    "map_optical_depth",
    "map_rays",
    "march_bounds",
    "moved_voxels",
    "render",
    "render_with_aovs",
    "solid_distances",
    "solid_visibility",
    "texel_rays",
    "unshadowed",
]
