/* The paper's law, equation (6), in one call; tests/oracles/law.py says the same in numpy. */
#ifndef RCMQP_LAW_H
#define RCMQP_LAW_H

#include "linalg.h"

/* How to keep the joints' speed limits; VELOCITY_LIMITS in controllers/dual_quaternion.py. */
typedef enum { NONE, SCALE, CLIP } Limited;

/* The law's numbers, in the order in which Python hands them over. */
enum { K, K_C, C_D, TOLERANCE, DAMPING, DAMPING_FROM, RANK_TOLERANCE, LAW_NUMBERS };

/* What the law is made for. */
typedef struct {
    int n;                 /* joints, six or more */
    const double *numbers; /* (LAW_NUMBERS) */
    const double *limits;  /* (n) of the joints' speed [rad/s] */
    int feed_forward;      /* whether to add -vec(x* x_d') */
    Limited limited;
} Law;

/* What a cycle knows. */
typedef struct {
    const double *x;       /* (8) x_eff */
    const double *J;       /* (6, n) the effector's twist in its own axes, linear then angular */
    const double *x_d;     /* (8) */
    const double *x_d_dot; /* (8) */
    double c;              /* value of the objective */
    const double *J_c;     /* (n) its gradient */
} Sight;

/* What is known of an answer. */
typedef struct {
    double least; /* singular value of N */
    double kept;  /* how many N^+ keeps */
    double scale; /* share of the wished speed that the limits left */
} Found;

size_t memory_for_law(int n);

void follow(const Law *law, const Sight *sight, double *v, Found *found, Arena *arena);

#endif
