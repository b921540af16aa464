/* Nodes with lines of the transmittance between them.
   Requires: what nodes.h does. */
#define NODES_LERP_T
#include "nodes.h"
