/* Bounded linear least squares, exactly: min |M y - c|^2 subject to lower <= R y <= upper.
 *
 * A primal active-set method (Nocedal and Wright 2006, algorithm 16.3) on orthogonal factors: y
 * stays feasible, the working set stays independent, each round is an equality-constrained least
 * squares in closed form, and the multipliers' signs are checked here. M may be rank deficient.
 * Where more bounds meet than the working set can hold, rounds can go round in circles without
 * moving; then the gradient is projected onto the cone of feasible directions (a nonnegative
 * least squares), which either proves the point optimal or gives a direction that no bound there
 * blocks.
 */
#ifndef RCMQP_LEVEL_H
#define RCMQP_LEVEL_H

#include "linalg.h"

#define EPS 2.220446049250313e-16

/* One level, in the coordinates y that the earlier levels left free; y = 0 is feasible. */
typedef struct {
    int m, r, k;
    double *M;     /* (m, r) level's matrix times the free basis, divided by the level's norm */
    double *c;     /* (m) what is missing at y = 0, divided likewise */
    double *noise; /* (m) rounding error of c */
    double *R;     /* (k, r) rows of the inequalities, of at most unit norm */
    double *lower; /* (k) at most zero, -inf for none */
    double *upper; /* (k) at least zero, inf for none */
    double weight; /* the level's norm; 0 where there is nothing to do */
    double scale;  /* size of the numbers that c is a difference of */
    double tol;    /* rows with less than this left of them are dependent */
} Problem;

/* The factors of a working set, which stay as long as M and the set are the same. */
typedef struct {
    int count;        /* rows held; -1: of none yet */
    int *rows;        /* (r) which */
    int *order;       /* (r) in which order they were factored */
    double *L, *Q;    /* (r, r) the rows held are L Q[:, :count]^T, see factor() */
    double *MN;       /* (m, r - count) M along what they leave free, Q[:, count:] */
    LeastSquares by;  /* of MN */
} Face;

Face make_face(const Problem *problem, Arena *arena);

int feasible(const Problem *problem, const double *y, Arena *arena);

int solve_level(const Problem *problem, int max_rounds, double *set, Face *face, double *y,
                double *multipliers, Arena *arena);

#endif
