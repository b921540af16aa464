/* Test-only kernels around fast_math.h, sampling.h and quadrature.h. */
#include "core/quadrature.h"
#include "core/sampling.h"
#include "items.h"

/* [count] to [count, 8]. */
__kernel void call_fast_math(__global const float *xs, __global float *found, int count)
{
  GUARD;
  const Floats x = load(xs, 1, 0, count);
  store(found, 8, 0, count, transmittance_of(x));
  store(found, 8, 1, count, opacity_of(x));
  store(found, 8, 2, count, log_of(x));
  store(found, 8, 3, count, cos_pi(x));
  store(found, 8, 4, count, sin_pi(x));
  store(found, 8, 5, count, reciprocal_sqrt(x));
  store(found, 8, 6, count, arctangent_of(x));
  store(found, 8, 7, count, exp2_of(x));
}

/* [count, 3]: depths at both ends and a fraction to [count, 2]: where it is in the world, and back again. */
__kernel void call_warp(__global const float *given, __global float *found, float max_stretch, int count)
{
  GUARD;
  const Warp warp = projective_warp(load(given, 3, 0, count), load(given, 3, 1, count), max_stretch);
  const Floats warped = warp_fraction(warp, load(given, 3, 2, count));
  store(found, 2, 0, count, warped);
  store(found, 2, 1, count, unwarp_fraction(warp, warped));
}

/* [count, 2] depths to [count, steps, 2]: middle and length of every step of a segment. */
__kernel void call_warped_step(__global const float *given, __global float *found, float max_stretch, int steps,
                               int count)
{
  GUARD;
  const Warp warp = projective_warp(load(given, 2, 0, count), load(given, 2, 1, count), max_stretch);
  for (int n = 0; n < steps; ++n) {
    const WarpedStep step = warped_step(warp, n, steps);
    store(found, 2 * steps, 2 * n, count, step.middle);
    store(found, 2 * steps, 2 * n + 1, count, step.length);
  }
}

/* [count, 3]: depths, and steps of each lane's own, to [count, most, 2]. */
__kernel void call_warped_step_of_lanes(__global const float *given, __global float *found, float max_stretch, int most,
                                        int count)
{
  GUARD;
  const Warp warp = projective_warp(load(given, 3, 0, count), load(given, 3, 1, count), max_stretch);
  for (int n = 0; n < most; ++n) {
    const WarpedStep step = warped_step_of_lanes(warp, n, load(given, 3, 2, count));
    store(found, 2 * most, 2 * n, count, step.middle);
    store(found, 2 * most, 2 * n + 1, count, step.length);
  }
}

/* [count] numbers of nodes to [count, 2]: places and weights of both rules. */
__kernel void call_gauss_rules(__global const float *given, __global float *found, int count)
{
  GUARD;
  FloatArray places, weights;
  const IntArray numbers = {TO_INTS(load(given, 1, 0, count))};
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    places.lane[lane] = gauss_nodes[numbers.lane[lane]];
    weights.lane[lane] = gauss_weights[numbers.lane[lane]];
  }
  store(found, 2, 0, count, places.lanes);
  store(found, 2, 1, count, weights.lanes);
}
