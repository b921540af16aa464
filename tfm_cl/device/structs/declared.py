"""All structs that kernels are told: one for each owner, which the module of its name fills."""

from tfm_cl.constants import MOST_DEGREE, MOST_OCTAVES
from tfm_cl.device.structs.base import Field, Struct

VIEW = Struct(
    "View",
    "The camera, and how its rays are marched. World: from the device's origin.",
    (
        Field("float", "position", 3, "world"),
        Field("float", "right", 3, "world, times tan(fov/2) * width / height"),
        Field("float", "up", 3, "world, times tan(fov/2)"),
        Field("float", "forward", 3, "world, unit"),
        Field("int", "image_size", 2, "full frame, pixels"),
        Field("int", "crop", 4, "x0, y0, x1, y1 of the pixels that are rendered"),
        Field("int", "listed", 1, "1: rays pass where a list says, 0: through the pixels' centres"),
        Field("int", "steps", 1, "samples along the lit part of a camera ray"),
        Field("int", "light_steps", 1, "steps along the light rays of the dual march"),
        Field("int", "projective", 1, "1: uniform in projective space (section 4.2), 0: in the world"),
        Field("float", "max_stretch", 1, "longest projective step over the mean one"),
        Field(
            "int", "paper_attenuation", 1, "1: as algorithm 1 is printed, dimmed within the light's cone only"
        ),
        Field("float", "cutoff", 1, "a camera ray ends where no colour has more transmittance left"),
        Field(
            "float", "end", 1, "length of the media beyond which nothing is seen, for those in closed form"
        ),
        Field(
            "float", "rgb_from_field", 9, "3x3 row major: extinction, RGB, of a density of 1 of each field"
        ),
        Field("float", "ambient", 3, "radiance from everywhere, RGB"),
        Field("float", "haze", 1, "extinction of the air before solids, per world unit"),
    ),
)

MEDIUM = Struct(
    "Medium",
    "One of the media, at density 1.",
    (
        Field("float", "sigma_t", 3, "extinction, RGB, per world unit"),
        Field("float", "sigma_s", 3, "scattering, RGB, per world unit"),
        Field("float", "albedo", 3, "sigma_s / sigma_t, RGB; 0 where sigma_t is 0"),
        Field("int", "phase_kind", 1, "number of the kind of its phase function"),
        Field("float", "phase", 4, "parameters of that"),
        Field("float", "octave_depth", MOST_OCTAVES, "of each octave: what multiplies optical depths"),
        Field(
            "float", "octave_share", MOST_OCTAVES, "how much light there is of it, at an optical depth of 1"
        ),
        Field("float", "octave_cosine", MOST_OCTAVES, "mean cosine of its phase function"),
        Field("int", "phase_table", 1, "floats from here to its table, where it has one"),
        Field("float", "emission", 3, "radiance per world unit, RGB"),
    ),
)

BODY = Struct(
    "Body",
    "A body of constant density.",
    (
        Field("int", "kind", 1, "number of its kind"),
        Field("float", "centre", 3, "from the device's origin"),
        Field("float", "size", 3, "as its kind has it"),
        Field("float", "density", 1, "inside"),
    ),
)

GRID = Struct(
    "Grid",
    "A body whose density is a grid's.",
    (
        Field("float", "index_from_world", 12, "3x4 row major, to the padded grid: 0 is the zero border"),
        Field("float", "world_from_index", 12, "its inverse"),
        Field("int", "size", 3, "padded grid x, y, z: one zero voxel on each side"),
        Field("int", "brick_count", 3, "bricks x, y, z that cover it"),
        Field("int", "first_brick", 1, "where its bricks begin in the table"),
        Field(
            "int", "channel_records", 1, "from the record of a channel to that of the next; 0: one channel"
        ),
        Field("float", "density_scale", 3, "density = density_scale * voxel as stored, of each channel"),
        Field("int", "pool_size", 1, "records in a pool, of all grids"),
        Field("int", "skip_empty", 1, "1: jump over bricks without density, in all grids"),
    ),
)

LIGHT = Struct(
    "Light",
    "A light with one place of its own. World: from the device's origin.",
    (
        Field("float", "world_from_light", 12, "3x4 row major, rigid; the light's map looks along +z"),
        Field("float", "light_from_world", 12, "its inverse"),
        Field("float", "cone_from_light", 12, "3x4 row major, rotation to where a spot's axis is z"),
        Field("float", "shape", 4, "parameters of the light's kind"),
        Field("float", "chart", 4, "scale and offset from the plane of the light's chart to u and v"),
        Field("float", "intensity", 3, "RGB"),
        Field("int", "spread", 1, "number of its spread: media have a phase function for each"),
        Field(
            "float",
            "nearest_inverse",
            1,
            "1 / distance where inverse-square falloff ends, or of a ball 1 / radius",
        ),
        Field("int", "inside_bodies", 1, "bits of the bodies of constant density that it lies in"),
        Field("int", "first_map", 1, "number of its first field's map"),
        Field("float", "bias", 1, "world, by which what is thin is looked up nearer to the light"),
        Field("int", "first_bin", 1, "number of the first bin of its rays"),
        Field("int", "lit_pixels", 4, "x0, y0, x1, y1 of the pixels that the light may change"),
        Field("int", "first_lit", 1, "where what is known of their solids begins in its buffer"),
        Field("int", "shadow_res", 1, "texels along each side of the shadow map"),
        Field("int", "first_shadow", 1, "where it begins in its buffer"),
        Field("int", "shadow_bounds_res", 1, "entries along each side of the finest bounds of that"),
        Field("int", "first_shadow_bounds", 1, "where these begin, in the same buffer"),
        Field("int", "texture_size", 2, "columns and rows of the light's texture"),
        Field("int", "first_texel", 1, "where it begins in its buffer"),
        Field("int", "layer", 1, "number of the layer that holds what it adds"),
    ),
)

MAP = Struct(
    "Map",
    "A transmittance function map, of one light and one field.",
    (
        Field("int", "res", 1, "texels along each side"),
        Field("int", "steps", 1, "steps along a light ray"),
        Field("float", "density_weighting", 1, "alpha of eq. 19"),
        Field("float", "inverse_weighting", 1, "1 / alpha"),
        Field("float", "reference_extinction", 1, "extinction at density 1 that visibility is meant for"),
        Field("float", "number_unit", 1, "optical depth or extinction that a stored 1 stands for"),
        Field("float", "uniform_share", 1, "of the uniform weight in the visibility-weighted fit"),
        Field("int", "range_res", 1, "entries along each side of the ranges of its rays"),
        Field("float", "longest_range_inverse", 1, "1 / longest of them, world"),
        Field("int", "first_number", 1, "where its coefficients begin, in units of NUMBERS_UNIT"),
        Field("int", "first_limit", 1, "where their limits begin, for 8 bits"),
        Field("int", "first_range", 1, "where its ranges begin"),
        Field("int", "first_mode", 1, "where what its basis evaluates begins"),
    ),
)

SOURCE = Struct(
    "Source",
    "A primitive: a small thing that holds density. World: from the device's origin.",
    (
        Field("float", "a", 3, "centre, end or corner"),
        Field("float", "b", 3, "the other end, or the next corner"),
        Field("float", "c", 3, "the last corner; of a segment the bits of its bends"),
        Field("float", "radius", 2, "world, at either end"),
        Field("float", "amount", 1, "density at its middle, or opacity"),
        Field("int", "set", 1, "number of its body among those of primitives"),
    ),
)

SET = Struct(
    "Set",
    "What the primitives of a body have in common.",
    (
        Field("int", "kind", 1, "number of their kind"),
        Field("int", "profile", 1, "as their kind has it"),
        Field("int", "medium", 1, "number of their medium; 0 where there is one field alone"),
        Field("float", "mass", 1, "held by one of radius and density 1"),
        Field("float", "extinction", 1, "at density 1, that opacities are meant for"),
        Field("float", "weights", 9, "3x3 row major: what a density of 1 of each colour adds to each amount"),
    ),
)

PRIMITIVE = Struct(
    "Primitive",
    "A primitive as it is seen from a camera or a light. World: from the device's origin.",
    (
        Field("float", "amount", 3, "optical depth that the unit of its profile stands for"),
        Field(
            "int", "traits", 1, "its kind, profile and medium, and whether it is thin, as traits.h reads them"
        ),
        Field("float", "shape", 8, "as its kind has it"),
        Field("int", "bends", 3, "of a segment: its tangents at both ends, less its direction"),
    ),
)

ORDERS = Struct(
    "Orders",
    "The lattice on which light is scattered again and again. World: from the device's origin.",
    (
        Field("float", "origin", 3, "world, of the first point"),
        Field("float", "spacing", 1, "from a point to the next, along the world's axes"),
        Field("int", "size", 3, "points along x, y, z"),
        Field("int", "samples", 1, "of the density, along each edge of the cube around a point"),
        Field("float", "albedo", 3, "of what scatters, RGB"),
        Field(
            "float",
            "bent",
            MOST_DEGREE + 1,
            "moments of its phase function, less what goes straight on",
        ),
        Field("float", "seen", MOST_DEGREE + 1, "the same with that, as far as the camera sees by them"),
        Field("float", "straight", 1, "part of what it scatters that goes straight on"),
    ),
)

SWEEP = Struct(
    "Sweep",
    "A direction in which light goes through that lattice, plane by plane.",
    (
        Field("int", "columns", 1, "points of a row"),
        Field("int", "rows", 1, "rows of a plane"),
        Field("int", "planes", 1, "planes"),
        Field("int", "row", 1, "numbers from a row to the next"),
        Field("int", "plane", 1, "numbers from a plane to the next"),
        Field("int", "backwards", 1, "1: from the last plane to the first"),
        Field("float", "slope", 2, "columns and rows that it moves by from plane to plane"),
        Field("float", "length", 1, "world, of the way from plane to plane"),
        Field("float", "harmonics", (MOST_DEGREE + 1) ** 2, "spherical, of the direction"),
        Field(
            "float", "weighted", (MOST_DEGREE + 1) ** 2, "the same, times the solid angle that it stands for"
        ),
    ),
)
