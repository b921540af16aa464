/* Test-only kernels: one around each device function, so that it can be compared with float64 NumPy.
   Work-item i hands item i to the first lane and the following ones to the others, and writes the first lane. */
#include "map.h"
#include "walk.h"

TFM_INLINE size_t item(int lane, int count)
{
  const int i = (int)get_global_id(0) + lane;
  return (size_t)(i < count ? i : count - 1);
}

TFM_INLINE Floats load(__global const float *values, int stride, int at, int count)
{
  FloatArray lanes;
  for (int lane = 0; lane < TFM_LANES; ++lane)
    lanes.lane[lane] = values[item(lane, count) * (size_t)stride + (size_t)at];
  return lanes.lanes;
}

TFM_INLINE Vec3 load3(__global const float *values, int count)
{
  return vec3(load(values, 3, 0, count), load(values, 3, 1, count), load(values, 3, 2, count));
}

TFM_INLINE float lane0(Floats v)
{
  FloatArray lanes;
  lanes.lanes = v;
  return lanes.lane[0];
}

#define GUARD                          \
  const size_t i = get_global_id(0);   \
  if (i >= (size_t)count)              \
    return

__kernel void call_density_at(PARAMS params, GRID_ARGUMENTS, __global const float *points,
                              __global float *densities, int count)
{
  GUARD;
  PADDED_GRID(grid);
  const Ray still = {load3(points, count), vec3(floats(0.0f), floats(0.0f), floats(0.0f))};
  const GridRay ray = index_ray(params, still);
  const Ints every = floats(0.0f) == 0.0f;
  const Walk walk = walk_from(&grid, &ray, floats(0.0f), floats(1.0f), no_warp(), 0, ints(1), every);
  Ints samples = ints(0);
  Steps list = no_steps();
  list.forced = 1;
  densities[i] = 0.0f;
  if (find_steps(&grid, &walk, every, 1, &list))
    densities[i] = lane0(density_at(&grid, &walk, &list, 0, floats(0.5f), &samples));
}

__kernel void call_march_optical_depth(PARAMS params, GRID_ARGUMENTS, __global const float *origins,
                                       __global const float *directions, __global float *optical_depths, float begin,
                                       float end, int steps, int count)
{
  GUARD;
  PADDED_GRID(grid);
  const Ray ray = {load3(origins, count), load3(directions, count)};
  const GridRay ray_in_grid = index_ray(params, ray);
  Ints samples = ints(0);
  optical_depths[i] = lane0(march_optical_depth(&grid, &ray_in_grid, floats(begin), floats(end), steps,
                                                floats(0.0f) == 0.0f, &samples));
}

TFM_INLINE float2 interval_or_0(Ints hit, Interval interval)
{
  return (float2)(lane0(hit ? interval.begin : floats(0.0f)), lane0(hit ? interval.end : floats(0.0f)));
}

/* Misses are written as begin = end = 0. */
__kernel void call_medium_clip(PARAMS params, __global const float *origins,
                               __global const float *directions, __global float2 *intervals, int count)
{
  GUARD;
  const Ray ray = {load3(origins, count), load3(directions, count)};
  Interval interval = {floats(0.0f), floats(INFINITY)};
  const GridRay ray_in_grid = index_ray(params, ray);
  const Ints hit = medium_clip(params, &ray_in_grid, &interval);
  intervals[i] = interval_or_0(hit, interval);
}

__kernel void call_light_clip(PARAMS params, __global const float *origins,
                              __global const float *directions, __global float2 *intervals, int count)
{
  GUARD;
  const Ray ray = {load3(origins, count), load3(directions, count)};
  Interval interval = {floats(0.0f), floats(INFINITY)};
  const Ints hit = light_clip(params, ray, &interval);
  intervals[i] = interval_or_0(hit, interval);
}

__kernel void call_light_at(PARAMS params, __global const float *points,
                            __global float *uv_distance, __global float *radiance, int count)
{
  GUARD;
  const LightSample sample = light_at(params, point_in_light(params, load3(points, count)));
  vstore3((float3)(lane0(sample.u), lane0(sample.v), lane0(sample.distance)), i, uv_distance);
  vstore3(vload3(0, params->light_intensity) * lane0(sample.strength), i, radiance);
}

__kernel void call_light_texel_ray(PARAMS params, __global const float *uvs,
                                   __global float *directions, int count)
{
  GUARD;
  const Vec3 direction = light_texel_ray(params, load(uvs, 2, 0, count), load(uvs, 2, 1, count)).direction;
  vstore3((float3)(lane0(direction.x), lane0(direction.y), lane0(direction.z)), i, directions);
}

__kernel void call_phase_eval(PARAMS params, __global const float *mus, __global float *values,
                              int count)
{
  GUARD;
  values[i] = lane0(phase_eval(params, load(mus, 1, 0, count)));
}

__kernel void call_warp_fraction(__global const float *depths, __global const float *fractions,
                                 __global float *warped, float max_stretch, int count)
{
  GUARD;
  const Warp warp = projective_warp(load(depths, 2, 0, count), load(depths, 2, 1, count), max_stretch);
  warped[i] = lane0(warp_fraction(warp, load(fractions, 1, 0, count)));
}

/* Every step of a segment: its middle and its length. One work-item a segment. */
__kernel void call_warped_step(__global const float *depths, __global float2 *placed, float max_stretch, int steps,
                               int count)
{
  GUARD;
  const Warp warp = projective_warp(load(depths, 2, 0, count), load(depths, 2, 1, count), max_stretch);
  for (int n = 0; n < steps; ++n) {
    const WarpedStep step = warped_step(warp, n, steps);
    placed[i * (size_t)steps + (size_t)n] = (float2)(lane0(step.middle), lane0(step.length));
  }
}

__kernel void call_unwarp_fraction(__global const float *depths, __global const float *fractions,
                                   __global float *unwarped, float max_stretch, int count)
{
  GUARD;
  const Warp warp = projective_warp(load(depths, 2, 0, count), load(depths, 2, 1, count), max_stretch);
  unwarped[i] = lane0(unwarp_fraction(warp, warp_fraction(warp, load(fractions, 1, 0, count))));
}

/* Optical depths of one ray at the middles of its steps, [steps], to coefficients; table as the basis makes it. */
__kernel void call_basis_project(PARAMS params, __global const float *optical_depths,
                                 __global float *coefficients, int steps, __global const float *table, int count)
{
  GUARD;
  BasisState state;
  basis_begin(&state);
  for (int n = 0; n < steps; ++n) {
    LightSteps step;
    step.count = 1;
    step.n[0] = n;
    step.before[0] = load(optical_depths, steps, n, count);
    step.depth[0] = floats(0.0f);
    basis_steps(params, table, &state, &step, steps);
  }
  Floats c[TFM_N_COEFF];
  basis_finish(params, table, floats(0.0f) == 0.0f, &state, steps, c);
  for (int j = 0; j < TFM_N_COEFF; ++j)
    coefficients[i * (size_t)TFM_N_COEFF + (size_t)j] = lane0(c[j]);
}

__kernel void call_basis_optical_depth(PARAMS params, __global const float *coefficients,
                                       __global const float *us, __global float *optical_depths, int count)
{
  GUARD;
  Floats c[TFM_N_COEFF];
  for (int j = 0; j < TFM_N_COEFF; ++j)
    c[j] = load(coefficients, TFM_N_COEFF, j, count);
  optical_depths[i] = lane0(basis_optical_depth(params, 0, c, load(us, 1, 0, count)));
}

/* A map of `count` texels in one row, looked up in each one's middle. */
__kernel void call_map_storage(__global const float *values, __global const float2 *ranges,
                               __global MapStorage *map, __global float *loaded, int count)
{
  if (get_global_id(0) > 0)
    return;
  for (int texel = 0; texel < count; ++texel)
    for (int j = 0; j < TFM_N_COEFF; ++j) {
      const size_t at = (size_t)texel * TFM_N_COEFF + (size_t)j;
      map_store(map, ranges, at, j, values[at]);
    }
  for (int texel = 0; texel < count; ++texel) {
    MapPosition at;
    at.texel = ints(texel);
    at.fx = at.fy = floats(0.0f);
    Floats c[TFM_N_COEFF];
    /* One texel: no neighbour is read. */
    map_coefficients(map, ranges, 1, at, c);
    for (int j = 0; j < TFM_N_COEFF; ++j)
      loaded[(size_t)texel * TFM_N_COEFF + (size_t)j] = lane0(c[j]);
  }
}

__kernel void call_opacity_of(__global const float *optical_depths, __global float *opacities, int count)
{
  GUARD;
  opacities[i] = lane0(opacity_of(load(optical_depths, 1, 0, count)));
}

/* transmittance_of, log_of, cos_pi and reciprocal_sqrt of a number. */
__kernel void call_fast_math(__global const float *xs, __global float4 *values, int count)
{
  GUARD;
  const Floats x = load(xs, 1, 0, count);
  values[i] = (float4)(lane0(transmittance_of(x)), lane0(log_of(x)), lane0(cos_pi(x)), lane0(reciprocal_sqrt(x)));
}

__kernel void call_arctangent_of(__global const float *xs, __global float *angles, int count)
{
  GUARD;
  angles[i] = lane0(arctangent_of(load(xs, 1, 0, count)));
}
