/* Test-only kernels around a basis and storage.h. Includes expected before: a basis header. */
#include "map/storage.h"
#include "items.h"

/* Optical depths of rays at the middles of their steps, [count, steps], to coefficients; table as the basis makes it. */
__kernel void call_basis_project(MAP map, __global const float *optical_depths, __global float *found, int steps,
                                 __global const float *table, int count)
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
    basis_steps(map, table, &state, &step, steps);
  }
  Floats c[TFM_N_COEFF];
  basis_finish(map, table, every_lane(), &state, steps, c);
  for (int j = 0; j < TFM_N_COEFF; ++j)
    store(found, TFM_N_COEFF, j, count, c[j]);
}

/* [count, TFM_N_COEFF] and [count] to [count]. */
__kernel void call_basis_optical_depth(MAP map, __global const float *coefficients, __global const float *us,
                                       __global float *found, int count)
{
  GUARD;
  Floats c[TFM_N_COEFF];
  for (int j = 0; j < TFM_N_COEFF; ++j)
    c[j] = load(coefficients, TFM_N_COEFF, j, count);
  store(found, 1, 0, count, basis_optical_depth(map, 0, c, load(us, 1, 0, count)));
}

/* A map of res x res texels written number by number, and looked up at [count, 2] positions u, v. One work-item writes
   it all; a second launch reads. */
__kernel void call_map_store(__global const float *values, __global const float2 *limits, __global MapStorage *numbers,
                             int texels)
{
  if (get_global_id(0) > 0)
    return;
  for (int texel = 0; texel < texels; ++texel)
    for (int j = 0; j < TFM_N_COEFF; ++j) {
      const size_t at = (size_t)texel * TFM_N_COEFF + (size_t)j;
      map_store(numbers, limits, at, j, values[at]);
    }
}

__kernel void call_map_coefficients(__global const MapStorage *numbers, __global const float2 *limits,
                                    __global const float *positions, __global float *found, int res, int count)
{
  GUARD;
  Floats c[TFM_N_COEFF];
  map_coefficients(numbers, limits, res, map_position(res, load(positions, 2, 0, count), load(positions, 2, 1, count)), c);
  for (int j = 0; j < TFM_N_COEFF; ++j)
    store(found, TFM_N_COEFF, j, count, c[j]);
}
