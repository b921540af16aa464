/* Prefiltering of a map of coefficients ("Fourier Opacity Mapping", section 6): a box blur along lines of texels by
   running sums, so that a texel costs the same at any width.
   Requires: TFM_GROUP, the neighbouring floats of a texel or a row of texels that a work-item carries along. */

/* Add x; sum and error together lose nothing (Knuth's two-sum): what enters the window leaves it again in full. */
static inline void add(float *sum, float *error, float x)
{
  const float next = *sum + x;
  const float added = next - *sum;
  *error += (*sum - (next - added)) + (x - added);
  *sum = next;
}

/* One work-item a line of elements of TFM_GROUP floats, `stride` floats from one to the next. Beyond a line's ends its
   outermost elements go on.
   from, to     in and out, `count` elements a line: .x of from, .y of to; line i begins at float
                (i / per_row) * pitch + (i % per_row) * TFM_GROUP, with pitch.x and pitch.y
   first, end   lines of this launch
   shift        element of `from` at element 0 of `to`; negative beyond its beginning
   reach        whole elements of the window on either side of its centre
   left, right  copies of the line's first and last element that the first window takes from beyond the line
   part         weight of the elements next to the window, at most 1
   scale        one over the sum of all weights */
__kernel void blur_lines(__global const float *restrict from, __global float *restrict to, int first, int end,
                         int per_row, int2 pitch, int2 count, int stride, int shift, int reach, float left, float right,
                         float part, float scale)
{
  const int line = first + (int)get_global_id(0);
  if (line >= end)
    return;
  const size_t row = (size_t)(line / per_row), column = (size_t)(line % per_row) * TFM_GROUP;
  const size_t step = (size_t)stride;
  const int last = count.x - 1;
  from += row * (size_t)pitch.x + column;
  to += row * (size_t)pitch.y + column;

  float sum[TFM_GROUP], error[TFM_GROUP], before[TFM_GROUP];
  __global const float *front = from + (size_t)clamp(shift - reach - 1, 0, last) * step;
  __global const float *back = from + (size_t)last * step;
  for (int j = 0; j < TFM_GROUP; ++j) {
    before[j] = front[j];
    const float beyond = right * back[j];
    sum[j] = left * from[j];
    error[j] = fma(left, from[j], -sum[j]) + fma(right, back[j], -beyond);
    add(&sum[j], &error[j], beyond);
  }
  for (int i = max(shift - reach, 0); i <= min(shift + reach, last); ++i)
    for (int j = 0; j < TFM_GROUP; ++j)
      add(&sum[j], &error[j], from[(size_t)i * step + (size_t)j]);

  for (int i = 0; i < count.y; ++i) {
    /* The element before the window was kept by the last turn; here are the one after it and the one that leaves. */
    __global const float *entering = from + (size_t)clamp(i + shift + reach + 1, 0, last) * step;
    __global const float *leaving = from + (size_t)clamp(i + shift - reach, 0, last) * step;
    __global float *out = to + (size_t)i * step;
    for (int j = 0; j < TFM_GROUP; ++j) {
      const float enters = entering[j], leaves = leaving[j];
      out[j] = (sum[j] + error[j] + part * (before[j] + enters)) * scale;
      add(&sum[j], &error[j], enters);
      add(&sum[j], &error[j], -leaves);
      before[j] = leaves;
    }
  }
}
