/* Walks the rays of a tile through the bricks, from one step that has to be read to the next. Samples stay where the
   march puts them; those in bricks without density are skipped.

   Rays of a tile are close together: if at both ends of the walk they lie within one or two voxels of each other,
   they do so in between, and the tile moves as one: a box around its samples says, in a few scalar operations, in
   which window of two to four voxels along each axis all of them lie. Otherwise every lane looks for itself.
   Requires: what grid.h does. */
#ifndef TFM_WALK_H
#define TFM_WALK_H

#include "body/grid.h"
#include "core/sampling.h"
#if TFM_PRIMITIVES
#include "primitive/deposits.h"
#endif

/* Margin around a tile's box, voxels. */
#define TFM_ROUNDING 0.01f

/* A tile moves as one through one grid; through several every lane looks for itself. */
#define SHARES_WINDOWS (TFM_LANES > 1 && TFM_VOXEL_GRIDS == 1)

typedef struct {
  GridRay ray;
  Floats begin;      /* ray parameter where the walk begins */
  Floats length;
  Floats step;       /* length of a step, if all are equal */
  Warp warp;
  int warped;        /* 0: steps of equal length */
  Ints steps;        /* of each ray */
  int most;          /* steps of the longest */
  int skip;          /* 0: list the steps in empty bricks too */
#if TFM_PRIMITIVES
  int deposits;      /* 0: primitives are left out */
#endif
#if TFM_VOXEL_GRIDS
  Vec3 inverse[TFM_VOXEL_GRIDS]; /* 1 / direction */
#endif
#if TFM_VOXEL_GRIDS > 1
  Interval within[TFM_VOXEL_GRIDS]; /* each grid's bounds */
#endif
  Floats inverse_length;
#if SHARES_WINDOWS
  int together; /* the samples of every step lie in at most 3 cells along each axis */
  /* The box of the samples at a fraction f of the walk: low + f * low_change to high + f * high_change. */
  float low[3], low_change[3], high[3], high_change[3];
  float low_inverse[3], high_inverse[3]; /* 1 / change if the box moves down, or up; else 0 */
  float width; /* of a step, as a fraction of the walk */
  /* Ratios of the warp's depths. The fraction of any ray lies between those for the least and the greatest ratio. */
  float least_ratio, greatest_ratio;
#endif
} Walk;

/* Steps are found, read and used in three loops over a few of them at a time. Only the first loop branches on the
   volume's contents; the others are straight code, so that a CPU works on several steps at once. */
#if TFM_LANES == 1
#define MOST_STEPS 1
#else
#define MOST_STEPS 8
/* A number for each of as many steps as a register holds, and a list at most. */
#if TFM_LANES == 4
#define STEPS_AT_ONCE 4
#define STEP_NUMBERS ((int4)(0, 1, 2, 3))
#define TO_STEP_FLOATS convert_float4
#define TO_STEP_INTS convert_int4
typedef float4 StepFloats;
typedef int4 StepInts;
#else
#define STEPS_AT_ONCE 8
#define STEP_NUMBERS ((int8)(0, 1, 2, 3, 4, 5, 6, 7))
#define TO_STEP_FLOATS convert_float8
#define TO_STEP_INTS convert_int8
typedef float8 StepFloats;
typedef int8 StepInts;
#endif
typedef union {
  StepInts all;
  int one[STEPS_AT_ONCE];
} StepArray;
typedef union {
  StepFloats all;
  float one[STEPS_AT_ONCE];
} StepFloatArray;
#endif

typedef struct {
  int count;
  int next;                   /* where to continue the search */
  int forced;                 /* the next step is listed even if it is empty */
  int n[MOST_STEPS];          /* indices of the steps */
#if SHARES_WINDOWS
  Window window[MOST_STEPS];  /* if the tile moves as one */
#endif
#if TFM_VOXEL_GRIDS
  /* Where every lane looks for itself. */
  Vec3 point[MOST_STEPS][TFM_VOXEL_GRIDS];
  Ints records[MOST_STEPS][TFM_VOXEL_GRIDS];
#endif
#if TFM_PRIMITIVES
  Deposits deposits;
#endif
} Steps;

/* Where the samples of a step lie. */
typedef struct {
  Floats t;      /* ray parameter of the middle */
  Floats length; /* in units of the ray parameter */
} Place;

TFM_INLINE float part_of_fraction(float f, float ratio)
{
  return f / (f + (1.0f - f) * ratio);
}

TFM_INLINE float larger(float a, float b)
{
  return a > b ? a : b;
}

TFM_INLINE float smaller(float a, float b)
{
  return a < b ? a : b;
}

/* Walk the active rays, each from begin to begin + length in its own number of steps. */
TFM_INLINE Walk walk_from(const Grids *grid, const GridRay *ray, Floats begin, Floats length, Warp warp, int warped, Ints steps, Ints active)
{
  Walk walk;
  walk.ray = *ray;
  walk.begin = active ? begin : floats(0.0f);
  walk.length = active ? length : floats(0.0f);
  walk.warp = warp;
  walk.warped = warped;
  walk.steps = active ? steps : ints(0);
  walk.most = -least_int(-walk.steps);
  walk.skip = grid->skip;
  walk.step = active ? length / TO_FLOATS(steps) : floats(0.0f);
#if TFM_PRIMITIVES
  walk.deposits = 1;
#endif
#if TFM_VOXEL_GRIDS
  for (int i = 0; i < TFM_VOXEL_GRIDS; ++i) {
    const Vec3 direction = ray->of[i].direction;
    walk.inverse[i] = vec3(inverse_of(direction.x), inverse_of(direction.y), inverse_of(direction.z));
#if TFM_VOXEL_GRIDS > 1
    walk.within[i].begin = floats(-INFINITY);
    walk.within[i].end = floats(INFINITY);
    const Ints meets = box_clip(ray->of[i], grid->of[i].upper, &walk.within[i]);
    walk.within[i].begin = meets ? walk.within[i].begin : floats(INFINITY);
#endif
  }
#endif
  walk.inverse_length = inverse_of(length);
#if SHARES_WINDOWS
  /* A ray with fewer steps continues beyond its end; the caller ignores it there. */
  const Floats whole = warped ? walk.length : walk.step * (float)walk.most;
  const Vec3 first = ray_at(ray->of[0], walk.begin);
  const Vec3 last = ray_at(ray->of[0], walk.begin + whole);
  const Floats none = floats(INFINITY);
  const Floats firsts[3] = {first.x, first.y, first.z}, lasts[3] = {last.x, last.y, last.z};
  float spread = 0.0f, extent = 0.0f;
#pragma unroll
  for (int axis = 0; axis < 3; ++axis) {
    const float low = least_float(active ? firsts[axis] : none) - TFM_ROUNDING;
    const float high = greatest_float(active ? firsts[axis] : -none) + TFM_ROUNDING;
    const float last_low = least_float(active ? lasts[axis] : none) - TFM_ROUNDING;
    const float last_high = greatest_float(active ? lasts[axis] : -none) + TFM_ROUNDING;
    walk.low[axis] = low;
    walk.high[axis] = high;
    walk.low_change[axis] = last_low - low;
    walk.high_change[axis] = last_high - high;
    walk.low_inverse[axis] = last_low < low ? 1.0f / (last_low - low) : 0.0f;
    walk.high_inverse[axis] = last_high > high ? 1.0f / (last_high - high) : 0.0f;
    spread = larger(spread, larger(high - low, last_high - last_low));
    extent = larger(extent, larger(larger(last_high - low, high - last_low), 0.0f));
  }
  walk.least_ratio = walk.greatest_ratio = 1.0f;
  if (warped) {
    const Floats ratio = warp.begin / warp.end;
    walk.least_ratio = least_float(active ? ratio : none);
    walk.greatest_ratio = greatest_float(active ? ratio : -none);
    /* For ratios that differ by a factor q, the fractions of two rays differ by at most
     (sqrt(q) - 1) / (sqrt(q) + 1) < (q - 1) / 4. */
    spread += extent * 0.25f * (walk.greatest_ratio / walk.least_ratio - 1.0f);
  }
  walk.together = spread < (float)(MOST_SHARED - 1);
  walk.width = 1.0f / (float)walk.most;
#endif
  return walk;
}

TFM_INLINE Place place_of(const Walk *walk, int n)
{
  Place place;
  if (walk->warped) {
    const WarpedStep warped = warped_step(walk->warp, n, walk->most);
    place.t = walk->begin + walk->length * warped.middle;
    place.length = walk->length * warped.length;
  } else {
    place.length = walk->step;
    place.t = walk->begin + ((float)n + 0.5f) * walk->step;
  }
  return place;
}

TFM_INLINE Steps no_steps(void)
{
  Steps steps;
  steps.count = steps.next = steps.forced = 0;
#if TFM_PRIMITIVES
  steps.deposits.first = steps.deposits.end = 0;
#endif
  return steps;
}

#if TFM_PRIMITIVES
/* The step in which a ray parameter lies; as it is rounded, `margin` says which of two it is for one at their border. */
TFM_INLINE Ints step_with(const Walk *walk, Floats t, float margin)
{
  const Floats fraction = clamp_to((t - walk->begin) * walk->inverse_length, 1.0f);
  const Floats part = walk->warped ? unwarp_fraction(walk->warp, fraction) : fraction;
  return TO_INTS(greatest(part * TO_FLOATS(walk->steps) + margin, floats(0.0f)));
}
#define AT_BORDER 0.01f

/* Leaves all primitives in the steps from first on. */
TFM_INLINE void deposit_primitives(const Lists *lists, const Walk *walk, Ints active, int first, Deposits *deposits)
{
  const int end = walk->most - first < DEPOSIT_STEPS ? walk->most : first + DEPOSIT_STEPS;
  deposits->first = first;
  deposits->end = end;
  for (int i = 0; i < DEPOSIT_STEPS / 32; ++i)
    deposits->marks[i] = 0;
  for (int n = first; n <= end; ++n)
    deposits->edge[n - first] = walk->warped ? walk->begin + walk->length * warp_cut(walk->warp, floats((float)n), floats((float)(walk->most - n)))
                                             : walk->begin + (float)n * walk->step;
  for (int i = 0; i < end - first; ++i)
    for (int m = 0; m < TFM_MEDIA; ++m)
      for (int c = 0; c < TFM_AMOUNTS; ++c)
        deposits->of[i][m][c] = floats(0.0f);
#if TFM_THIN
  for (int i = 0; i < end - first; ++i)
    deposits->thin[i] = deposits->place[i] = floats(0.0f);
#endif
#if TFM_TANGENTS
  for (int i = 0; i < end - first; ++i)
    for (int k = 0; k < TANGENTS; ++k)
      deposits->tangents[i][k] = floats(0.0f);
#endif
  const Floats begins = deposits->edge[0], ends = deposits->edge[end - first];
  Near near;
  near_begin(lists, active & (walk->steps > first), &near);
  while (find_near(lists, walk->ray.world, begins, ends, &near)) {
    int low[MOST_NEAR], high[MOST_NEAR];
    for (int k = 0; k < near.count; ++k) {
      const Crossing *crossing = &near.crossing[k];
      const Floats enters = crossing->t - crossing->reach, leaves = crossing->t + crossing->reach;
      const Ints crosses = near.crosses[k] & (leaves > begins) & (enters < ends);
      near.crosses[k] = crosses;
      low[k] = least_int(crosses ? step_with(walk, enters, -AT_BORDER) : ints(end - 1));
      high[k] = -least_int(crosses ? -step_with(walk, leaves, AT_BORDER) : ints(-first));
    }
    for (int k = 0; k < near.count; ++k)
      deposit(lists->primitives + near.number[k], &near.crossing[k], near.crosses[k], low[k] > first ? low[k] : first,
              high[k] < end - 1 ? high[k] : end - 1, deposits);
  }
}

/* The density that makes up what lies in a step. */
TFM_INLINE void add_deposits(const Walk *walk, const Deposits *deposits, int n, Amounts *density)
{
  const Floats length = place_of(walk, n).length;
  const Floats inverse = length > 0.0f ? 1.0f / length : floats(0.0f);
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      density->of[m][c] += inverse * deposits->of[n - deposits->first][m][c];
}

/* What primitives hold between two ray parameters, of the rays that are active, whose directions are of any length. */
TFM_INLINE void add_primitives(const Lists *lists, Ray ray, Floats begin, Floats end, Ints active, Amounts *amounts)
{
  const Floats square = dot3(ray.direction, ray.direction), inverse = reciprocal_sqrt(square), length = square * inverse;
  ray.direction = scale3(inverse, ray.direction);
  begin *= length;
  end *= length;
  Near near;
  near_begin(lists, active, &near);
  while (find_near(lists, ray, begin, end, &near))
    for (int k = 0; k < near.count; ++k) {
      PRIMITIVE primitive = lists->primitives + near.number[k];
      const Crossing *crossing = &near.crossing[k];
      const Floats between = TFM_PRIMITIVE_PART(primitive, crossing, end) - TFM_PRIMITIVE_PART(primitive, crossing, begin);
      const int medium = TFM_MEDIA > 1 ? PRIMITIVE_MEDIUM(primitive) : 0;
      for (int c = 0; c < TFM_AMOUNTS; ++c)
        amounts->of[medium][c] += near.crosses[k] ? primitive->amount[c] * greatest(between, floats(0.0f)) : floats(0.0f);
    }
}
#define IS_MARKED(steps, n) is_marked(&(steps)->deposits, n)
#else
#define IS_MARKED(steps, n) 0
#endif
#if TFM_THIN
/* Where light is looked up for a step of which `step` holds the amounts: what is thin counts where it is. thin: its share. */
TFM_INLINE Floats lit_place(const Walk *walk, const Steps *steps, int n, const Amounts *step, Floats *thin)
{
  const int i = n - steps->deposits.first;
  const Floats middle = place_of(walk, n).t, held = steps->deposits.thin[i];
  Floats all = floats(0.0f);
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      all += step->of[m][c];
  const Floats share = least(held / greatest(all, floats(FLT_MIN)), floats(1.0f));
  *thin = share;
  return held > 0.0f ? middle + share * (steps->deposits.place[i] / held - middle) : middle;
}
#endif
/* Sums of the tangents of the strands in a step. */
#if TFM_PRIMITIVES && TFM_TANGENTS
#define TANGENTS_OF(steps, n) (steps)->deposits.tangents[(n) - (steps)->deposits.first]
#else
#define TANGENTS_OF(steps, n) 0
#endif

/* Where the search goes on after step n, when all before `empty` have no voxel to be read. */
TFM_INLINE int next_step(const Steps *steps, int n, int empty, int until)
{
#if TFM_PRIMITIVES
  return next_marked(&steps->deposits, n + 1, empty < until ? empty : until);
#else
  (void)steps;
  (void)n;
  (void)until;
  return empty;
#endif
}

#if TFM_VOXEL_GRIDS
/* Clamp a point to the grid: rounding may have moved it outside. A NaN becomes a point of the border. */
TFM_INLINE Vec3 point_in_grid(const Extent *extent, Vec3 point)
{
  return vec3(clamp_to(point.x, extent->upper[0]), clamp_to(point.y, extent->upper[1]),
              clamp_to(point.z, extent->upper[2]));
}

/* The next step after n that may lie in a brick with density. position: in steps; before it the samples of all lanes
   are known to be empty. As positions are rounded, a step up to a thousandth before it is kept. */
TFM_INLINE int step_at(float position, int n, int most)
{
  const float bounded = smaller(larger(position - 0.501f, (float)n), (float)most);
  const int down = (int)bounded;
  const int next = (float)down < bounded ? down + 1 : down;
  return next > n ? next : n + 1;
}

#if SHARES_WINDOWS
/* Windows of STEPS_AT_ONCE, from n on: what they cost for one, they cost for all. */
typedef struct {
  StepFloatArray corner[3];
  StepArray first, sizes; /* as of Window */
  StepArray brick[3];     /* of the corner */
  StepArray number;       /* of that brick in the grid's table */
} Windows;

TFM_INLINE Windows windows_from(const Walk *walk, const Extent *extent, int n)
{
  const StepFloats s = (TO_STEP_FLOATS(n + STEP_NUMBERS) + 0.5f) * walk->width;
  StepFloats f = s, g = s;
  if (walk->warped) {
    f = s * walk->least_ratio / (s * walk->least_ratio + (1.0f - s));
    g = s * walk->greatest_ratio / (s * walk->greatest_ratio + (1.0f - s));
  }
  Windows windows;
  StepInts brick[3], first = (StepInts)(0), sizes = (StepInts)(0);
#pragma unroll
  for (int axis = 2; axis >= 0; --axis) {
    const StepFloats low_f = walk->low[axis] + f * walk->low_change[axis], low_g = walk->low[axis] + g * walk->low_change[axis];
    const StepFloats high_f = walk->high[axis] + f * walk->high_change[axis], high_g = walk->high[axis] + g * walk->high_change[axis];
    StepFloats low = low_f < low_g ? low_f : low_g, high = high_f > high_g ? high_f : high_g;
    low = low > 0.0f ? low : (StepFloats)(0.0f);
    high = high > 0.0f ? high : (StepFloats)(0.0f);
    const StepInts corner = TO_STEP_INTS(low < extent->upper[axis] ? low : (StepFloats)(extent->upper[axis]));
    const StepInts last = TO_STEP_INTS(high < extent->upper[axis] ? high : (StepFloats)(extent->upper[axis]));
    windows.corner[axis].all = TO_STEP_FLOATS(corner);
    sizes = (sizes << 8) + (last - corner + 2);
    first = first * RECORD_EDGE + (corner & (BLOCK_EDGE - 1));
    windows.brick[axis].all = brick[axis] = corner >> BRICK_SHIFT;
  }
  windows.sizes.all = sizes;
  windows.first.all = first;
  windows.number.all = BRICK_AT(extent, brick[0], brick[1], brick[2]);
  return windows;
}

/* Find steps before `until` for the tile as a whole. after: also list the step after each one that is read. */
TFM_INLINE void find_steps_together(const Grids *grid, const Walk *walk, int until, int after, Steps *steps)
{
  const Extent *extent = &grid->of[0];
  int n = steps->next, count = 0, force = steps->forced;
  while (n < until && count < MOST_STEPS) {
    const Windows windows = windows_from(walk, extent, n);
    for (int i = 0; i < STEPS_AT_ONCE && n < until && count < MOST_STEPS; ++i) {
      const int record = extent->bricks[windows.number.one[i]];
      const int marked = IS_MARKED(steps, n);
      if (force | (record > 0) | marked | !walk->skip) {
        Window *window = &steps->window[count];
#pragma unroll
        for (int axis = 0; axis < 3; ++axis)
          window->corner[axis] = windows.corner[axis].one[i];
        window->first = windows.first.one[i];
        window->sizes = windows.sizes.one[i];
        window->record = record > 0 ? record : 0;
        steps->n[count] = n;
        force = after & ((record > 0) | marked);
        ++count;
        ++n;
        continue;
      }
      /* Continue until the box leaves the cube of bricks, around the brick of its corner, that are known to be empty
         together with the cells beyond that they cover. */
      float leaves[3];
#pragma unroll
      for (int axis = 0; axis < 3; ++axis) {
        const int brick = windows.brick[axis].one[i];
        const float below = (float)((brick + record + 1) * BRICK_EDGE);
        const float above = (float)((brick - record) * BRICK_EDGE + MOST_SHARED - 1);
        const float down = walk->low_inverse[axis] != 0.0f ? (below - walk->low[axis]) * walk->low_inverse[axis] : 1.0f;
        const float up = walk->high_inverse[axis] != 0.0f ? (above - walk->high[axis]) * walk->high_inverse[axis] : 1.0f;
        leaves[axis] = smaller(down, up);
      }
      const float fraction = larger(smaller(smaller(leaves[0], leaves[1]), smaller(leaves[2], 1.0f)), 0.0f);
      const float part = walk->warped ? part_of_fraction(fraction, walk->greatest_ratio) : fraction;
      n = next_step(steps, n, step_at((float)walk->most * part, n, walk->most), until);
      break;
    }
  }
  steps->next = n;
  steps->forced = force;
  steps->count = count;
}
#endif

TFM_INLINE Floats empty_until(Ints brick, Ints record, Floats origin, Floats inverse)
{
  const Ints above = (brick - record) * BRICK_EDGE + (MOST_SHARED - 1);
  const Ints below = (brick + 1 + record) * BRICK_EDGE;
  return (TO_FLOATS(inverse > 0.0f ? above : below) - origin) * inverse;
}

/* What a grid's table says of the bricks at each lane's point. */
TFM_INLINE Ints records_at(const Extent *extent, Vec3 point)
{
  return gather_ints(extent->bricks, BRICK_AT(extent, TO_INTS(point.x) >> BRICK_SHIFT,
                                              TO_INTS(point.y) >> BRICK_SHIFT, TO_INTS(point.z) >> BRICK_SHIFT));
}

/* Every lane for itself. */
TFM_INLINE void find_steps_apart(const Grids *grid, const Walk *walk, Ints alive, int until, int after, Steps *steps)
{
  int n = steps->next, count = 0, force = steps->forced;
  while (n < until && count < MOST_STEPS) {
    const Floats t = place_of(walk, n).t;
    const Ints here = alive & (n < walk->steps);
    int read = IS_MARKED(steps, n);
    for (int i = 0; i < TFM_VOXEL_GRIDS; ++i) {
      const Vec3 point = point_in_grid(&grid->of[i], ray_at(walk->ray.of[i], t));
      Ints records = records_at(&grid->of[i], point);
#if TFM_VOXEL_GRIDS > 1
      const Ints within = (t >= walk->within[i].begin) & (t <= walk->within[i].end);
      records = within ? records : ints(0);
#endif
      read |= any_lane(here & (records > 0));
      steps->point[count][i] = point;
      steps->records[count][i] = records;
    }
    if (force | read | !walk->skip) {
      steps->n[count] = n;
      force = after & read;
      ++count;
      ++n;
      continue;
    }
    Floats nearest = floats(INFINITY);
    for (int i = 0; i < TFM_VOXEL_GRIDS; ++i) {
      const Vec3 point = steps->point[count][i], origin = walk->ray.of[i].origin, inverse = walk->inverse[i];
      const Ints records = steps->records[count][i];
      const Floats x = empty_until(TO_INTS(point.x) >> BRICK_SHIFT, records, origin.x, inverse.x);
      const Floats y = empty_until(TO_INTS(point.y) >> BRICK_SHIFT, records, origin.y, inverse.y);
      const Floats z = empty_until(TO_INTS(point.z) >> BRICK_SHIFT, records, origin.z, inverse.z);
      Floats leaves = least(least(x, y), z);
#if TFM_VOXEL_GRIDS > 1
      leaves = t < walk->within[i].begin ? walk->within[i].begin : t > walk->within[i].end ? floats(INFINITY) : leaves;
#endif
      nearest = least(nearest, leaves);
    }
    const Floats fraction = clamp_to((nearest - walk->begin) * walk->inverse_length, 1.0f);
    const Floats part = walk->warped ? unwarp_fraction(walk->warp, fraction) : fraction;
    n = next_step(steps, n, step_at(least_float(here ? part * TO_FLOATS(walk->steps) : floats(1e30f)), n, walk->most),
                  until);
  }
  steps->next = n;
  steps->forced = force;
  steps->count = count;
}
#endif

/* List the next steps before `until` in which any lane that is alive may find anything. */
TFM_INLINE void find_steps_before(const Grids *grid, const Walk *walk, Ints alive, int until, int after, Steps *steps)
{
#if TFM_VOXEL_GRIDS == 0
  /* Only primitives. */
  (void)grid;
  (void)alive;
  int n = steps->next, count = 0, force = steps->forced;
  while (n < until && count < MOST_STEPS) {
    const int marked = IS_MARKED(steps, n);
    if (force | marked | !walk->skip) {
      steps->n[count] = n;
      force = after & marked;
      ++count;
      ++n;
    } else
      n = next_step(steps, n, until, until);
  }
  steps->next = n;
  steps->forced = force;
  steps->count = count;
#else
#if SHARES_WINDOWS
  if (walk->together)
    find_steps_together(grid, walk, until, after, steps);
  else
#endif
    find_steps_apart(grid, walk, alive, until, after, steps);
#endif
}

/* List the next steps in which any lane that is alive may find density; the result is their number, 0 at the end of the
   walk. Start with no_steps(). after: also list the step after each of them. */
TFM_INLINE int find_steps(const Grids *grid, const Walk *walk, Ints alive, int after, Steps *steps)
{
#if TFM_PRIMITIVES
  do {
    int until = walk->most;
    if (walk->deposits) {
      if (steps->next >= steps->deposits.end && steps->next < walk->most)
        deposit_primitives(&grid->lists, walk, alive, steps->next, &steps->deposits);
      until = steps->deposits.end < until ? steps->deposits.end : until;
    }
    find_steps_before(grid, walk, alive, until, after, steps);
  } while (steps->count == 0 && steps->next < walk->most);
#else
  find_steps_before(grid, walk, alive, walk->most, after, steps);
#endif
  return steps->count;
}

/* Density D, of each medium, at the k-th of the steps, whose middle is at t; any number in lanes that are not alive, and
   those whose ray has no such step. samples: counts the densities read. */
TFM_INLINE Amounts densities_at(const Grids *grid, const Walk *walk, const Steps *steps, int k, Floats t, Ints *samples)
{
  const Ints here = steps->n[k] < walk->steps;
  Amounts density = no_amounts();
#if TFM_PRIMITIVES
  if (walk->deposits)
    add_deposits(walk, &steps->deposits, steps->n[k], &density);
#endif
#if TFM_VOXEL_GRIDS == 0
  (void)grid;
  (void)t;
  *samples += here ? ints(1) : ints(0);
  return density;
#else
#if SHARES_WINDOWS
  if (walk->together) {
    /* Lanes of a true mask are -1. */
    if (steps->window[k].record == 0) {
      *samples -= walk->skip ? ints(0) : here;
      return density;
    }
    *samples -= here;
    const Vec3 point = ray_at(walk->ray.of[0], t);
    for (int c = 0; c < TFM_VOXEL_CHANNELS; ++c)
      if (COUNTS_CHANNEL(grid->of[0], c))
        density.of[TFM_MEDIUM_OF_GRID(0)][AMOUNT_OF(c)] += density_together(grid, &steps->window[k], point, c);
    return density;
  }
#endif
  for (int i = 0; i < TFM_VOXEL_GRIDS; ++i) {
    const Ints records = steps->records[k][i];
    /* Lanes of a true mask are -1. */
    *samples += (here & ((records > 0) | (walk->skip ? 0 : -1))) ? ints(1) : ints(0);
    for (int c = 0; c < TFM_VOXEL_CHANNELS; ++c)
      if (COUNTS_CHANNEL(grid->of[i], c))
        density.of[TFM_MEDIUM_OF_GRID(i)][AMOUNT_OF(c)] += density_apart(grid, i, records, steps->point[k][i], c);
  }
  return density;
#endif
}

/* Optical depth of the grids' density (sigma_t = 1), of each medium, from begin to end, by the midpoint rule in `steps`
   steps, of the rays that are active; 0 in the others. scale: length of one unit of the ray's parameter. samples: counts the
   densities read. */
TFM_INLINE Amounts march_amounts(const Grids *grid, const GridRay *ray, Floats begin, Floats end, int steps, Floats scale,
                                 Ints active, Ints *samples)
{
#if TFM_PRIMITIVES
  Walk walk = walk_from(grid, ray, begin, end - begin, no_warp(), 0, ints(steps), active);
  walk.deposits = 0; /* they are known in closed form */
#else
  const Walk walk = walk_from(grid, ray, begin, end - begin, no_warp(), 0, ints(steps), active);
#endif
  Amounts sum = no_amounts();
  Ints read = ints(0);
  Steps list = no_steps();
  while (find_steps(grid, &walk, active, 0, &list))
    for (int k = 0; k < list.count; ++k) {
      const Amounts density = densities_at(grid, &walk, &list, k, place_of(&walk, list.n[k]).t, &read);
      for (int m = 0; m < TFM_MEDIA; ++m)
        for (int c = 0; c < TFM_AMOUNTS; ++c)
          sum.of[m][c] += density.of[m][c];
    }
  *samples += active ? read : ints(0);
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      sum.of[m][c] = active ? scale * least(sum.of[m][c] * walk.step, floats(TFM_MAX_OPTICAL_DEPTH)) : floats(0.0f);
  return sum;
}

#endif
