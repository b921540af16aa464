/* Optical depth at planes, interpolated by cubics.
   Requires: what slices.h does. */
#define SLICES_CUBIC
#include "slices.h"
