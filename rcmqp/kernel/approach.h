/* How fast an error may be reduced if the joints are still to stop it at zero. */
#ifndef RCMQP_APPROACH_H
#define RCMQP_APPROACH_H

#include "linalg.h"

/* What the joints can do: limits (n) of acceleration and jerk, the share of them that is counted
 * on, and the sampling period. */
typedef struct {
    int n;
    const double *acceleration, *jerk;
    double share, period;
} Brakes;

double stop_speed(double distance, double acceleration, double jerk, double period);

double braked_share(const Brakes *brakes, const double *strict, int strict_rows, const double *A,
                const double *e, int m, double gain, double damping, Arena *arena);

#endif
