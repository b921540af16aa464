/* Which primitives the rays of a camera or a light may meet: lists for the bins of its pixels or texels (count, sum, fill).
   Includes expected before: the headers of the primitives' kinds. Requires: TFM_PRIMITIVE_SEEN(source, set, eye, seen,
   ball), one of theirs; TFM_FROM_LIGHT, 1 with a light header included before, 0 for the camera. */
#if TFM_FROM_LIGHT
#include "light/sample.h"
#define ORIGIN LIGHT light
#else
#include "view/camera.h"
#define ORIGIN VIEW view
#endif
#include "core/store.h"

#define TEXEL_MARGIN 1e-3f

/* Primitives as they are seen from somewhere.
   sets       of which body a primitive is
   colours    extinction relative to the density, RGB: of the first, and the stride to the next; 0: one for all
   footprint  width of a texel: at the origin, and what it gains per unit of distance
   seen, balls  out */
__kernel void see_primitives(SOURCE sources, SET sets, __global const float *colours, int colour_stride, float4 origin,
                             float2 footprint, __global Primitive *seen, __global float4 *balls, int count)
{
  const int i = (int)get_global_id(0);
  if (i >= count)
    return;
  SOURCE source = sources + i;
  SET set = sets + source->set;
  __global Primitive *found = seen + i;
  const Eye eye = {{origin.x, origin.y, origin.z}, footprint.x, footprint.y};
  float4 ball;
  const float amount = TFM_PRIMITIVE_SEEN(source, set, &eye, found, &ball);
  balls[i] = ball;
  __global const float *colour = colours + (size_t)i * (size_t)colour_stride;
  for (int k = 0; k < 3; ++k) {
    __global const float *row = set->weights + 3 * k;
    found->amount[k] = amount * (row[0] * colour[0] + row[1] * colour[1] + row[2] * colour[2]);
  }
  found->traits |= BODY_TRAITS(set->kind, set->medium);
}

/* Parts of the map or the image that the rays which meet a ball may belong to, in texels: low and high x and y of each;
   empty where low > high. */
#ifdef CHART_IMAGES
#define IMAGES CHART_IMAGES
#else
#define IMAGES 1
#endif
#if TFM_FROM_LIGHT
#define TEXELS_OF(centre, reach, low, high) texels_of(light, size, centre, reach, low, high)
TFM_INLINE void texels_of(LIGHT light, int4 size, Vec3 centre, Floats reach, Floats *low, Floats *high)
{
  light_bounds(light, point_in_light(light, centre), reach, low, high);
  for (int i = 0; i < 2 * IMAGES; ++i) {
    low[i] *= (float)size.x;
    high[i] *= (float)size.x;
  }
}
#else
#define TEXELS_OF(centre, reach, low, high) image_bounds(view, centre, reach, low, high)
#endif

/* Lists the primitives of each bin, or only counts them. A work-item sees to a run of them, so that lists come in order,
   whatever runs first.
   balls        around the primitives as they are seen from the origin of the rays
   size         texels along x and y
   bins         columns, rows, texels along a side of a bin, primitives of a run
   places       [runs, bins]: how many of a run each bin has, out where nothing is written; else where the next one goes
   bin_members  out, where writes is not 0 */
__kernel void list_primitives(ORIGIN, __global const float4 *balls, int4 size, int4 bins, __global int *places,
                              __global int *bin_members, int count, int writes)
{
  const int run = (int)get_global_id(0), first = run * bins.w;
  if (first >= count)
    return;
  const int end = first + bins.w < count ? first + bins.w : count;
  __global int *of_run = places + (size_t)run * (size_t)(bins.x * bins.y);
  if (!writes)
    for (int bin = 0; bin < bins.x * bins.y; ++bin)
      of_run[bin] = 0;
  const float scale = 1.0f / (float)bins.z;
  for (int start = first; start < end; start += TFM_LANES) {
    FloatArray place[3], reach;
    for (int lane = 0; lane < TFM_LANES; ++lane) {
      const float4 ball = balls[start + lane < end ? start + lane : end - 1];
      place[0].lane[lane] = ball.x;
      place[1].lane[lane] = ball.y;
      place[2].lane[lane] = ball.z;
      reach.lane[lane] = ball.w;
    }
    Floats low[2 * IMAGES], high[2 * IMAGES];
    TEXELS_OF(vec3(place[0].lanes, place[1].lanes, place[2].lanes), reach.lanes, low, high);
    IntArray from[2 * IMAGES], to[2 * IMAGES];
    for (int i = 0; i < 2 * IMAGES; ++i) {
      /* Rounded outwards: a thousandth of a texel is more than float32 errs by. */
      const float most = (float)((i % 2 == 0 ? bins.x : bins.y) - 1);
      const Ints is_beside = (low[i] > (most + 1.0f) * (float)bins.z) | !(high[i] >= 0.0f) | !(low[i] <= high[i]);
      from[i].lanes = is_beside ? ints(1) : TO_INTS(clamp_to((low[i] - TEXEL_MARGIN) * scale, most));
      to[i].lanes = is_beside ? ints(0) : TO_INTS(clamp_to((high[i] + TEXEL_MARGIN) * scale, most));
    }
    for (int lane = 0; lane < TFM_LANES && start + lane < end; ++lane)
      for (int image = 0; image < IMAGES; ++image)
        for (int y = from[2 * image + 1].lane[lane]; y <= to[2 * image + 1].lane[lane]; ++y)
          for (int x = from[2 * image].lane[lane]; x <= to[2 * image].lane[lane]; ++x) {
            /* In each bin once. */
            int is_listed = 0;
            for (int other = 0; other < image; ++other)
              is_listed |= x >= from[2 * other].lane[lane] && x <= to[2 * other].lane[lane] &&
                           y >= from[2 * other + 1].lane[lane] && y <= to[2 * other + 1].lane[lane];
            if (is_listed)
              continue;
            __global int *next = of_run + y * bins.x + x;
            if (writes)
              bin_members[*next] = start + lane;
            ++*next;
          }
  }
}
