/* Optical depth as a polyline through k nodes, (v_1, tau_1, v_2, tau_2 ...) in order of v, from (0, 0) to the last
   density: adaptive volumetric shadow maps (Salvi et al. 2010), which compress deep shadow maps (Lokovic and Veach
   2000) to a fixed size during the march. When there is one node too many, the node whose removal costs least is
   dropped. Removing a node cuts off a triangle; its area times the transmittance at the node is, to first order, the
   integral of the error of T.
   Requires: the same as projection.h; TFM_N_COEFF even; NODES_LERP_T to interpolate T instead of the optical depth, in
   which case the area of the triangle is the error itself. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#define TFM_BASIS_OWN_STATE
#include "../map/projection.h"

#define NODES (TFM_N_COEFF / 2)

typedef struct {
  Floats v[NODES + 1];
  Floats depth[NODES + 1];
  Floats light[NODES + 1]; /* transmittance at the node */
} BasisState;

TFM_INLINE void basis_begin(BasisState *state)
{
  /* Initial nodes lie at the beginning, where removing them costs nothing, so they are dropped first. */
  for (int j = 0; j <= NODES; ++j) {
    state->v[j] = state->depth[j] = floats(0.0f);
    state->light[j] = floats(1.0f);
  }
}

TFM_INLINE Floats absolute(Floats x)
{
  return greatest(x, -x);
}

/* In the lanes of the mask `some`, appends a node and removes the cheapest one. */
TFM_INLINE void add_node(MAP map, BasisState *state, Ints some, float v, Floats depth)
{
  state->v[NODES] = floats(v);
  state->depth[NODES] = depth;
  state->light[NODES] = transmittance_of(map->reference_extinction * depth);

  Ints cheapest = ints(0);
  Floats least_cost = floats(INFINITY);
  Floats v_before = floats(0.0f);
#ifdef NODES_LERP_T
  const Floats *height = state->light;
  Floats height_before = floats(1.0f);
#else
  const Floats *height = state->depth;
  Floats height_before = floats(0.0f);
#endif
#pragma unroll
  for (int j = 0; j < NODES; ++j) {
    const Floats chord = state->v[j + 1] - v_before, part = state->v[j] - v_before;
    Floats cost = absolute((height[j] - height_before) * chord - (height[j + 1] - height_before) * part);
#ifndef NODES_LERP_T
    cost *= state->light[j];
#endif
    const Ints cheaper = cost < least_cost;
    cheapest = cheaper ? ints(j) : cheapest;
    least_cost = cheaper ? cost : least_cost;
    v_before = state->v[j];
    height_before = height[j];
  }
  cheapest = some ? cheapest : ints(NODES);
#pragma unroll
  for (int j = 0; j < NODES; ++j) {
    const Ints stays = cheapest > j;
    state->v[j] = stays ? state->v[j] : state->v[j + 1];
    state->depth[j] = stays ? state->depth[j] : state->depth[j + 1];
    state->light[j] = stays ? state->light[j] : state->light[j + 1];
  }
}

TFM_INLINE void basis_steps(MAP map, __global const float *table, BasisState *state,
                            const LightSteps *steps, int most)
{
  (void)table;
  for (int k = 0; k < steps->count; ++k) {
    const float begin = (float)steps->n[k] / (float)most, end = (float)(steps->n[k] + 1) / (float)most;
    const Ints dense = steps->depth[k] > 0.0f;
    if (!any_lane(dense))
      continue;
    /* After a gap, or before the first density, the polyline is horizontal up to here. */
    const Ints gap = dense & (state->v[NODES - 1] < begin);
    if (any_lane(gap))
      add_node(map, state, gap, begin, steps->before[k]);
    add_node(map, state, dense, end, steps->before[k] + steps->depth[k]);
  }
}

TFM_INLINE void basis_finish(MAP map, __global const float *table, Ints active,
                             const BasisState *state, int most, Floats *c)
{
  (void)map;
  (void)table;
  (void)most;
  for (int j = 0; j < NODES; ++j) {
    c[2 * j] = active ? state->v[j] : floats(0.0f);
    c[2 * j + 1] = active ? state->depth[j] : floats(0.0f);
  }
}

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
  (void)modes;
  /* The last node at or before v, and the first one after it. */
  const float unit = map->number_unit;
  Floats low_v = floats(0.0f), low = floats(0.0f);
#pragma unroll
  for (int j = 0; j < NODES; ++j) {
    const Ints before = unit * c[2 * j] <= v;
    low_v = before ? unit * c[2 * j] : low_v;
    low = before ? unit * c[2 * j + 1] : low;
  }
  Floats high_v = v + 1.0f, high = low;
#pragma unroll
  for (int j = NODES - 1; j >= 0; --j) {
    const Ints beyond = unit * c[2 * j] > v;
    high_v = beyond ? unit * c[2 * j] : high_v;
    high = beyond ? unit * c[2 * j + 1] : high;
  }
  const Floats part = (v - low_v) / (high_v - low_v);
#ifdef NODES_LERP_T
  const float extinction = map->reference_extinction;
  const Floats light = lerp(transmittance_of(extinction * low), transmittance_of(extinction * high), part);
  /* Where no light is left, interpolate the optical depth instead. */
  const Floats depth = extinction * high < 80.0f ? log_of(light) * (-1.0f / extinction) : lerp(low, high, part);
#else
  const Floats depth = lerp(low, high, part);
#endif
  return least(greatest(depth, floats(0.0f)), floats(TFM_MAX_OPTICAL_DEPTH));
}

#endif
