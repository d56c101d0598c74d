/* How far the RCM and the tip are from a singularity, and which motion leads away from it. */
#ifndef RCMQP_MANIPULABILITY_H
#define RCMQP_MANIPULABILITY_H

#include "rows.h"

/* Rows of RcmTask, and of the tip. */
#define SHAFT_ROWS 5

size_t memory_for_manipulability(int n);

double shaft_manipulability(const Cycle *cycle, double *g, Arena *arena);

#endif
