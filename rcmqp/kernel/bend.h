/* How things move, seen from the shaft, while the joints go on as they do.
 *
 * In axes that go along with the shaft but do not spin about it: of a vector in the effector's axes,
 * d/dt changes by omega_z e_z x vector, and omega loses its z. A wrist's own motion is not seen. */
#ifndef RCMQP_BEND_H
#define RCMQP_BEND_H

#include "rows.h"

void see_twist(Cycle *cycle);

void bend(const Cycle *cycle, const double *r, const double *carried, double *rate, double *out);

void bend_by_v(const Cycle *cycle, const double *r, const double *carried, const double *rate,
               double *out);

#endif
