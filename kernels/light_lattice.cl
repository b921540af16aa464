/* Lattice pass: looks lights up at the voxels of all blocks with density (view/lattice.h).
   Includes expected before: a basis and a light header, and those of the phase functions. Requires: what
   reduced_intensity.h and view/lattice.h do. */
#include "core/store.h"
#include "light/reduced_intensity.h"
#include "view/lattice.h"
#include "phase/phase.h"

/* Voxels of a record that no other has: those of its block. The ones after, for cells at the block's end, are the first
   of the blocks that follow, where these have a record. */
#define OWN_VOXELS (BLOCK_EDGE * BLOCK_EDGE * BLOCK_EDGE)
#define ALL_VOXELS (RECORD_EDGE * RECORD_LAYER)
#define CHUNKS ((ALL_VOXELS + TFM_LANES - 1) / TFM_LANES)
#define BEHIND (RECORD_EDGE - BLOCK_EDGE)
#define BEHIND_X (BLOCK_EDGE * BLOCK_EDGE * BEHIND)
#define BEHIND_Y (BLOCK_EDGE * BEHIND * RECORD_EDGE)

/* A few voxels of a record, a lane each. */
typedef struct {
  Ints x, y, z; /* in the record */
  Ints at;      /* number in the lattice */
  Ints same;    /* that of the same voxel in a record whose own it is; its own number where there is none */
  Ints inside;  /* the record */
} Voxels;

/* The item-th few: first those of the block itself, row by row; then those behind it, layer by layer, of which few have
   density beyond the first. */
TFM_INLINE Voxels voxels_of(__global const int *block, int record, int item)
{
  Voxels found;
  const Ints n = item * TFM_LANES + LANE_Y * TILE_WIDTH + LANE_X;
  if ((item + 1) * TFM_LANES <= OWN_VOXELS) {
    found.x = n & (BLOCK_EDGE - 1);
    found.y = n >> BLOCK_SHIFT & (BLOCK_EDGE - 1);
    found.z = n >> 2 * BLOCK_SHIFT;
    found.inside = n >= 0;
    found.at = found.same = record * RECORD_VOXELS + found.z * RECORD_LAYER + found.y * RECORD_ROW + found.x;
    return found;
  }
  /* Behind along x, else along y, else along z. */
  const Ints nx = n - OWN_VOXELS, ny = nx - BEHIND_X, nz = ny - BEHIND_Y;
  const Ints own = nx < 0, by_x = ny < 0, by_y = nz < 0;
  found.x = own ? n % BLOCK_EDGE
          : by_x ? BLOCK_EDGE + nx / (BLOCK_EDGE * BLOCK_EDGE)
          : by_y ? ny % RECORD_EDGE : nz % RECORD_EDGE;
  found.y = own ? n / BLOCK_EDGE % BLOCK_EDGE
          : by_x ? nx % BLOCK_EDGE
          : by_y ? BLOCK_EDGE + ny / (RECORD_EDGE * BLOCK_EDGE) : nz / RECORD_EDGE % RECORD_EDGE;
  found.z = own ? n / (BLOCK_EDGE * BLOCK_EDGE)
          : by_x ? nx / BLOCK_EDGE % BLOCK_EDGE
          : by_y ? ny / RECORD_EDGE % BLOCK_EDGE : BLOCK_EDGE + nz / RECORD_LAYER;
  found.inside = n < ALL_VOXELS;
  found.at = record * RECORD_VOXELS + found.z * RECORD_LAYER + found.y * RECORD_ROW + found.x;
  const Ints after = (found.x >> BLOCK_SHIFT) + 2 * (found.y >> BLOCK_SHIFT) + 4 * (found.z >> BLOCK_SHIFT);
  const Ints other = (found.inside & (after > 0)) ? gather_ints(block + 4, after & 7) : ints(0);
  const Ints in_other = other * RECORD_VOXELS + (found.z & (BLOCK_EDGE - 1)) * RECORD_LAYER +
                        (found.y & (BLOCK_EDGE - 1)) * RECORD_ROW + (found.x & (BLOCK_EDGE - 1));
  found.same = other > 0 ? in_other : found.at;
  return found;
}

/* A light's intensity in a colour of the lattice; of one alone, in the colour of which there is most. */
TFM_INLINE float intensity_of(LIGHT light, int c)
{
#if TFM_LATTICE_COLOURS == 3
  return light->intensity[c];
#else
  (void)c;
  return fmax(fmax(light->intensity[0], light->intensity[1]), light->intensity[2]);
#endif
}

/* Whether a cell of a brick with density touches any voxel that is wanted: no other is ever seen. */
TFM_INLINE int any_seen(GRID grid, __global const int *bricks, __global const int *block, const Voxels *voxels, Ints wanted)
{
  __global const int *table = bricks + grid->first_brick;
  const Ints x = voxels->x + block[0] * BLOCK_EDGE, y = voxels->y + block[1] * BLOCK_EDGE,
             z = voxels->z + block[2] * BLOCK_EDGE;
  int seen = 0;
  for (int corner = 0; corner < 8 && !seen; ++corner) {
    const Ints bx = (x - (corner & 1)) >> BRICK_SHIFT, by = (y - (corner >> 1 & 1)) >> BRICK_SHIFT,
               bz = (z - (corner >> 2)) >> BRICK_SHIFT;
    const Ints inside = wanted & (bx >= 0) & (by >= 0) & (bz >= 0) & (bx < grid->brick_count[0]) &
                        (by < grid->brick_count[1]) & (bz < grid->brick_count[2]);
    const Ints brick = (bz * grid->brick_count[1] + by) * grid->brick_count[0] + bx;
    seen = any_lane(inside & (gather_ints(table, inside ? brick : ints(0)) > 0));
  }
  return seen;
}

/* A work-item takes a few voxels LATTICE_AT_ONCE times. */
#define GROUPS ((CHUNKS + LATTICE_AT_ONCE - 1) / LATTICE_AT_ONCE)

/* Finds where light is to be looked up.
   marks  out, [records, GROUPS]: a bit for each few of light_lattice, 1 where there is anything to do */
__kernel void mark_voxels(GRID grids, __global const int *bricks, __global const int *blocks, __global const int *records,
                          __global uchar *marks, int2 window)
{
  const int place = window.x + (int)get_global_id(0) / GROUPS, group = (int)get_global_id(0) % GROUPS;
  if (place >= window.y)
    return;
  const int record = records[place];
  __global const int *block = blocks + (size_t)record * BLOCK_NUMBERS;
  int marked = 0;
  for (int i = 0; i < LATTICE_AT_ONCE; ++i) {
    const Voxels voxels = voxels_of(block, record, group * LATTICE_AT_ONCE + i);
    const Ints own = voxels.inside & (voxels.same == voxels.at);
    marked |= (any_lane(own) && any_seen(grids + block[3], bricks, block, &voxels, own)) << i;
  }
  marks[(size_t)record * GROUPS + (size_t)group] = (uchar)marked;
}

/* What a few voxels know of a light before its map is read. */
typedef struct {
  LightPath path;
  Floats mu; /* between the light's way there and the camera's */
  Floats strength;
  Ints at;     /* numbers of the voxels in the lattice */
  Ints wanted; /* those that are this record's own */
} LookUp;

TFM_INLINE LookUp look_up_of(const Scene *scene, LIGHT light, const LightBuffers *buffers, __global const int *block,
                             int record, int item)
{
  const Voxels voxels = voxels_of(block, record, item);
  const Vec3 point = transform_point(scene->grids[block[3]].world_from_index,
                                     vec3(TO_FLOATS(voxels.x + block[0] * BLOCK_EDGE),
                                          TO_FLOATS(voxels.y + block[1] * BLOCK_EDGE),
                                          TO_FLOATS(voxels.z + block[2] * BLOCK_EDGE)));
  const Ray in_light = ray_in_light(light, rays_beyond(scene->view, point));
  const LightSample sample = light_at(light, in_light.origin);
  LookUp found;
  found.path = light_path(scene, light, buffers, point, sample, 0, LATTICE_AT_ONCE > 1);
  found.mu = -dot3(sample.direction, in_light.direction);
  found.strength = sample.strength;
  found.at = voxels.at;
  found.wanted = voxels.inside & (voxels.same == voxels.at);
  return found;
}

/* Asks for the numbers of some voxels before they are needed. */
TFM_INLINE void lattice_prefetch(__global const float *lattice, Ints at)
{
#ifdef PREFETCH
#define NUMBERS(p, i, s) (PREFETCH(lattice + (size_t)LANE(at, s) * LATTICE_NUMBERS), 0)
  (void)(Ints)FOR_LANES(NUMBERS, 0, 0);
#undef NUMBERS
#else
  (void)lattice;
  (void)at;
#endif
}

/* A work-item takes as many voxels of a record as there are lanes, LATTICE_AT_ONCE times: it finds where they are in the
   light's map, and asks for what is there, before it reads any.
   blocks   BLOCK_NUMBERS of each record: its block's x, y, z, in blocks, its grid, and the records of the blocks after it
   records  those with a light of their own, in an order in which the light's map stays in the cache
   marks    of mark_voxels
   lattice  adds to, or begins, the sums over the lights; where they are all in, means and logarithms; else as it was
   number   of the light among those given: one after the other, as their maps would push each other out of the cache
   count    of all lights
   part     of the light that it belongs to, of those that are known apart
   begins   1: the first light; ends: the last
   window   first of this launch, and end, among the records */
__kernel void light_lattice(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, LIGHT lights, LIGHT_ARGUMENTS,
                            __global const int *blocks, __global const int *records, __global const uchar *marks,
                            __global float *lattice, int number, int count, int part, int begins, int ends, int2 window)
{
  const int place = window.x + (int)get_global_id(0) / GROUPS;
  if (place >= window.y)
    return;
  const int record = records[place], group = (int)get_global_id(0) % GROUPS;
  const int marked = marks[(size_t)record * GROUPS + (size_t)group];
  if (!marked)
    return;
  __global const int *block = blocks + (size_t)record * BLOCK_NUMBERS;
  SCENE(scene, ints(-1), ints(-1));
  LIGHT_BUFFERS(buffers);
  LIGHT light = lights + number;
#if TFM_TANGENTS
  const FibreAngles fibres = no_strands(); /* voxels have none */
#endif

  LookUp look_ups[LATTICE_AT_ONCE];
  int found = 0;
  for (int i = 0; i < LATTICE_AT_ONCE; ++i)
    if (marked >> i & 1) {
      look_ups[found] = look_up_of(&scene, light, &buffers, block, record, group * LATTICE_AT_ONCE + i);
      lattice_prefetch(lattice, look_ups[found].at);
      ++found;
    }

  for (int i = 0; i < found; ++i) {
    const LookUp *look_up = look_ups + i;
    const Floats mu = look_up->mu;
    Floats depth[TFM_CHANNELS];
    Ints samples = ints(0);
    light_optical_depths(&scene, light, &buffers, &look_up->path, look_up->wanted, &samples, depth);
    const Floats phase = PHASE_OF(media + TFM_MEDIA * light->spread, mu, &fibres);
    LatticeValue sum;
    for (int c = 0; c < TFM_CHANNELS; ++c)
      sum.of[LATTICE_RADIANCES + c] = transmittance_of(depth[c]);
    for (int c = 0; c < TFM_LATTICE_COLOURS; ++c) {
      const Floats arrives = intensity_of(light, c) * look_up->strength, way = depth[TFM_CHANNELS == 3 ? c : 0];
      for (int k = 0; k < TFM_LATTICE_APART; ++k) {
        const int is_of_part = TFM_LATTICE_APART == 1 || k == part, n = k * TFM_LATTICE_COLOURS + c;
        sum.of[n] = is_of_part ? arrives * (phase * transmittance_of(way)) : floats(0.0f);
#if HAS_OCTAVES
        sum.of[LATTICE_FIRST + n] =
            is_of_part ? arrives * later_octaves(media + TFM_MEDIA * light->spread, mu, way) : floats(0.0f);
#endif
      }
    }

    const Ints wanted = look_up->wanted, at = look_up->at * LATTICE_NUMBERS;
    for (int n = 0; n < LATTICE_NUMBERS; ++n) {
      Floats value = sum.of[n];
      if (!begins)
        value += gather_floats(lattice + n, wanted ? at : ints(0));
      if (ends)
        value = n < LATTICE_RADIANCES ? TFM_LOG2_E * log_of(greatest(value, floats(FLT_MIN))) : value / (float)count;
      store_floats(lattice + n, at, wanted, value);
    }
  }
}

/* Copies to every record the voxels that are another's own. */
__kernel void share_lattice(__global const int *blocks, __global const int *records, __global float *lattice,
                            int2 window)
{
  const int place = window.x + (int)get_global_id(0) / GROUPS, group = (int)get_global_id(0) % GROUPS;
  if (place >= window.y || (group + 1) * LATTICE_AT_ONCE * TFM_LANES <= OWN_VOXELS)
    return;
  const int record = records[place];
  __global const int *block = blocks + (size_t)record * BLOCK_NUMBERS;
  for (int i = 0; i < LATTICE_AT_ONCE; ++i) {
    const Voxels voxels = voxels_of(block, record, group * LATTICE_AT_ONCE + i);
    const Ints wanted = voxels.inside & (voxels.same != voxels.at);
    for (int n = 0; n < LATTICE_NUMBERS; ++n)
      store_floats(lattice + n, voxels.at * LATTICE_NUMBERS, wanted,
                   gather_floats(lattice + n, wanted ? voxels.same * LATTICE_NUMBERS : ints(0)));
  }
}
