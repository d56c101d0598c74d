/* Rows of tasks and limits from one cycle's kinematics: the same formulas, in the same order, as
 * Task.evaluate() and Limit.evaluate() in rcmqp/tasks and rcmqp/limits, whose docstrings derive
 * them. A task or limit is one line of numbers, its program; Python writes it once.
 */
#ifndef RCMQP_ROWS_H
#define RCMQP_ROWS_H

#include "linalg.h"

/* Kinds of tasks, and what their line holds after kind and the root of the weight. */
typedef enum {
    RCM,            /* gain, period (0: no second order) */
    TIP,            /* gain, tip_depth */
    ROLL,           /* gain */
    POSE,           /* gain */
    POSTURE,        /* gain; vectors: posture, continuous */
    SRS_PRODUCT,    /* K_c, c_d; vectors: offsets, - */
    MANIPULABILITY, /* K_c, c_d */
} TaskKind;

#define TASK_NUMBERS 4

/* Kinds of limits, and what their line holds after the kind. */
typedef enum {
    JOINTS,       /* period */
    TROCAR_CONE,  /* gain, deceleration, half angle, axis (3) */
    TROCAR_DEPTH, /* gain, deceleration, tip_depth, shallowest, deepest */
    KEEP_OUT,     /* gain, deceleration, centre (3), velocity (3), on trocar, radius with that of
                     the instrument, first and last point of the axis */
} LimitKind;

#define LIMIT_NUMBERS 13

#define JOINT_NUMBERS 7

/* What a cycle knows. */
typedef struct {
    int n;
    const double *x;         /* (8) effector's pose */
    const double *J;         /* (6, n) its local Jacobian, linear then angular */
    const double *angles;    /* (n) */
    const double *v;         /* (n) joint velocity now */
    const double *a;         /* (n) joint acceleration now */
    const double *x_d;       /* (8) */
    const double *x_d_dot;   /* (8) */
    const double *pivot;     /* (3) */
    const double *pivot_dot; /* (3) */
    const double *joints;    /* (JOINT_NUMBERS, n) see limits/joints.py: JointLimits.table */
    double R[9], p[3];       /* the effector's placement, from x */
    double R_d[9], p_d[3], nu_d[3], omega_d[3]; /* the desired one's, and its twist */
} Cycle;

void see(Cycle *cycle);

int rows_of_task(const double *line, int n);

int has_error(const double *line);

void task_rows(const Cycle *cycle, const double *line, const double *vectors, double *A, double *b,
               double *e, Arena *arena);

int rows_of_limit(const double *line);

void limit_rows(const Cycle *cycle, const double *line, double *lower, double *upper, double *C,
                double *d);

double manipulability(const double *J, int n, double *gradient, Arena *arena);

double srs_product(const double *angles, const double *offsets, double *gradient);

#endif
