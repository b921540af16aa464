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

TFM_INLINE Floats everywhere_body_entry(BODY body, Ray ray)
{
  (void)body;
  (void)ray;
  return floats(0.0f);
}

TFM_INLINE Ints everywhere_body_is_smooth(BODY body, Ray first, Ray last, float ratio)
{
  (void)body;
  (void)first;
  (void)last;
  (void)ratio;
  return ints(-1);
}

#endif
