/* Sums of a smooth function over equal steps from a few of its values: Gauss's rule for the sum over n points, whose m
   nodes are the roots of the Gram (discrete Chebyshev) polynomial of degree m. It is exact for polynomials up to degree
   2 m - 1. Gautschi, "Orthogonal Polynomials: Computation and Approximation", 2004. Where singularities are no nearer than
   some multiple of half of the n points' extent, it errs by no more than float rounds. */
#ifndef TFM_QUADRATURE_H
#define TFM_QUADRATURE_H

#include "ray.h"

/* Points, nodes, and that multiple, of a rule for many points and one for few. */
#define LONG_POINTS 32
#define LONG_NODES 6
#define LONG_CLEARANCE 4.0f
#define SHORT_POINTS 8
#define SHORT_NODES 4
#define SHORT_CLEARANCE 8.0f

/* Places among points 0 to n - 1, and weights, whose sum is n: of the long rule, then of the short one. */
__constant const float gauss_nodes[LONG_NODES + SHORT_NODES] = {
    0.644995455f, 4.98756685f, 11.7071421f, 19.2928579f, 26.0124332f, 30.3550045f,
    0.165964468f, 2.20774563f, 4.79225437f, 6.83403553f};
__constant const float gauss_weights[LONG_NODES + SHORT_NODES] = {
    2.8212033f, 5.74098195f, 7.43781475f, 7.43781475f, 5.74098195f, 2.8212033f,
    1.51603952f, 2.48396048f, 2.48396048f, 1.51603952f};

/* By how much a linear function changes over the points, at most, whose zero is so far away. */
TFM_INLINE float clear_ratio(float clearance)
{
  return (clearance + 1.0f) / (clearance - 1.0f);
}

#endif
