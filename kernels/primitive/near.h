/* The primitives that rays cross, a few at a time, in three loops: which of them rays come near, how they cross these,
   and what follows from that. Processors seldom guess right which are near: the first loop only counts them, so that the
   second is straight, and a CPU works on several crossings at once.
   Includes expected before: the headers of the primitives' kinds. Requires: TFM_PRIMITIVE_CROSSING(primitive, ball,
   ray, crossing), one of theirs. */
#ifndef TFM_NEAR_H
#define TFM_NEAR_H

#include "primitive/crossing.h"
#include "primitive/lists.h"

#if TFM_LANES == 1
#define MOST_NEAR 1
#else
#define MOST_NEAR 16
#endif

typedef struct {
  Ints left, here; /* lanes whose bins are still to come; those of the bin that is looked through */
  int next, end;   /* members of that, still to be looked at */
  int count;
  int number[MOST_NEAR]; /* of the primitive */
  Crossing crossing[MOST_NEAR];
  Ints crosses[MOST_NEAR]; /* the lanes whose ray does */
} Near;

/* Starts to look through the lists of some lanes. */
TFM_INLINE void near_begin(const Lists *lists, Ints active, Near *near)
{
  near->left = active & (lists->bin >= 0);
  near->here = ints(0);
  near->next = near->end = 0;
}

/* Whether the rays of some lanes, of unit directions, cross a ball between two ray parameters. */
TFM_INLINE int comes_near(float4 ball, Ray ray, Floats begin, Floats end, Ints here)
{
  const float reach = ball.w;
  const Vec3 away = vec3(ball.x - ray.origin.x, ball.y - ray.origin.y, ball.z - ray.origin.z);
  const Floats t = dot3(away, ray.direction);
  const Vec3 beside = vec3(away.x - t * ray.direction.x, away.y - t * ray.direction.y, away.z - t * ray.direction.z);
  return any_lane(here & (dot3(beside, beside) < reach * reach) & (t + reach > begin) & (t - reach < end));
}

/* Finds the next ones, of the lanes in `here`; the result is their number, 0 after the last.
   ray         of a unit direction
   begin, end  ray parameters between which they lie */
TFM_INLINE int find_near(const Lists *lists, Ray ray, Floats begin, Floats end, Near *near)
{
  int count = 0;
  while (count == 0) {
    if (near->next == near->end) {
      const int bin = next_bin(lists, &near->left, &near->here);
      if (bin < 0)
        break;
      near->next = lists->starts[bin];
      near->end = lists->starts[bin + 1];
    }
    const int until = near->next + MOST_NEAR < near->end ? near->next + MOST_NEAR : near->end;
    int found = 0;
    for (int member = near->next; member < until; ++member) {
      near->number[found] = lists->members[member];
      found += comes_near(lists->balls[near->number[found]], ray, begin, end, near->here);
    }
    for (int k = 0; k < found; ++k) {
      const int number = near->number[k];
      const Ints crosses = near->here & TFM_PRIMITIVE_CROSSING(lists->primitives + number, lists->balls[number], ray,
                                                               &near->crossing[count]);
      near->number[count] = number;
      near->crosses[count] = crosses;
      count += any_lane(crosses);
    }
    near->next = until;
  }
  near->count = count;
  return count;
}

#endif
