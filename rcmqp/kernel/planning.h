/* One part of the planner's way to a far view; rcmqp/references/planner.py says what it is. */
#ifndef RCMQP_PLANNING_H
#define RCMQP_PLANNING_H

/* What a planner is made for. */
typedef struct {
    const double *x_rcm;   /* (8) pose at the trocar */
    const double *pivot_0; /* (3) where the trocar was then */
    int parts;             /* N + 1 */
    double period;         /* [s] */
    double far_angle;      /* a larger turn is far [rad] */
    double far_depth;      /* a longer way along the shaft is far [m] */
} Plan;

/* Where it is, seen from the trocar at rest. */
typedef struct {
    double *x;      /* (8) the last reference */
    double *target; /* (8) what it was on the way to */
    int left;       /* how many parts were left */
} Place;

/* What it is to go to. */
typedef struct {
    const double *x_d;       /* (8) */
    const double *pivot;     /* (3) */
    const double *pivot_dot; /* (3) */
} Wanted;

int go_on(const Plan *plan, Place *place, const Wanted *wanted, double *x_d, double *x_d_dot);

#endif
