/* Lights in batches: any number of one kind, and which of them touch a block of pixels (Olsson, Assarsson, "Tiled
   Shading", JGT 2011).
   Requires: what reduced_intensity.h does. */
#ifndef TFM_LIGHT_BATCH_H
#define TFM_LIGHT_BATCH_H

#include "light/reduced_intensity.h"

/* Some of the launch's lights. */
typedef struct {
  LIGHT of;
  __global const int *numbers;
  int count;
  int many; /* the block has several, whose maps push each other out of the cache */
  const LightBuffers *buffers;
} Lights;

/* The launch's lights whose rectangles touch a block of pixels.
   starts    of the lists of the blocks that the picture is cut into, row by row, and the end of the last
   touching  the numbers of the lights in these lists
   blocks    column and row of the first block, blocks in a row, edge of a block in pixels: a multiple of a tile's */
TFM_INLINE Lights lights_of_block(LIGHT lights, __global const int *starts, __global const int *touching, int4 blocks,
                                  int4 window, const LightBuffers *buffers)
{
  const int column = (window.x / TILE_WIDTH + (int)get_global_id(0)) * TILE_WIDTH / blocks.w - blocks.x;
  const int row = (window.y / TILE_HEIGHT + (int)get_global_id(1)) * TILE_HEIGHT / blocks.w - blocks.y;
  const int first = starts[row * blocks.z + column];
  Lights found;
  found.of = lights;
  found.numbers = touching + first;
  found.count = starts[row * blocks.z + column + 1] - first;
  found.many = found.count > 1;
  found.buffers = buffers;
  return found;
}

#endif
