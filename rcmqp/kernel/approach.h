/* How fast an error may be reduced if the joints are still to stop it at zero. */
#ifndef RCMQP_APPROACH_H
#define RCMQP_APPROACH_H

#include "linalg.h"

/* What joints can do. */
typedef struct {
    double acceleration, jerk;
} Ability;

/* The joints: limits (n) of acceleration and jerk, the least of them, the share of the acceleration
 * that is counted on, the sampling period, and the last command v and its change a (n). */
typedef struct {
    int n;
    const double *acceleration, *jerk, *v, *a;
    Ability least;
    double share, period;
} Brakes;

/* One task below the rows of other levels: d(error)/dt = A v - carried. */
typedef struct {
    int m, above_rows;
    const double *above;   /* (above_rows, n) */
    const double *A;       /* (m, n) */
    const double *e;       /* (m) error */
    const double *carried; /* (m) */
    double gain, damping;
    double each; /* A is so many times one, a row for each joint; 0: it is something else */
} Approached;

void approach_rate(const Brakes *brakes, const Approached *task, double *rate, Arena *arena);

#endif
