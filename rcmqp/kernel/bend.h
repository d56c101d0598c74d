/* How the way of the shaft bends while the joints go on as they do. */
#ifndef RCMQP_BEND_H
#define RCMQP_BEND_H

#include "rows.h"

void bend(const Cycle *cycle, const double *r, double *out, double *by_v);

#endif
