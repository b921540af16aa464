/* A medium's phase function. fibres: how strands lie, looked at with TFM_TANGENTS only.
   Includes expected before: the headers of those that there are. Requires: TFM_PHASE(medium, mu, fibres), one of them;
   TFM_TANGENTS. */
#ifndef TFM_PHASE_PHASE_H
#define TFM_PHASE_PHASE_H

#if TFM_TANGENTS
#include "phase/fibres.h"
#define PHASE_OF(medium, mu, fibres) TFM_PHASE(medium, mu, fibres)
#else
#define PHASE_OF(medium, mu, fibres) TFM_PHASE(medium, mu, 0)
#endif

#endif
