/* All of space. */
#ifndef TFM_BODY_EVERYWHERE_H
#define TFM_BODY_EVERYWHERE_H

#include "core/ray.h"

TFM_INLINE Ints everywhere_body_clip(BODY body, Ray ray, Interval *interval)
{
  (void)body;
  (void)ray;
  return interval->begin < interval->end;
}

#endif
