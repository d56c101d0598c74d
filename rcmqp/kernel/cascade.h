/* The lexicographic descent: a point, the directions still free, and one level after the other.
 *
 * For convex least squares A_k v is the same at every optimum of level k. So later levels may
 * move in the null space of A_k and nowhere else, which keeps A_k v exactly: v <- v + Z y with Z
 * an orthonormal basis of what is free. y = 0 is always feasible. A bound with a positive
 * multiplier is active at every optimum of its level (complementary slackness), so it leaves Z
 * too; every other bound stays an inequality. This is the null-space form of Escande, Mansard and
 * Wieber (2014), with the bounds above all levels.
 */
#ifndef RCMQP_CASCADE_H
#define RCMQP_CASCADE_H

#include "level.h"

/* A bound leaves Z if its multiplier is above this, relative to the level's size. A smaller one
 * stays an inequality, which is never wrong, only more degenerate. */
#define STRONG 1e-7

/* Larger numbers overflow when squared: the level is left alone. */
#define LARGEST 1e150

/* How a level was answered; Route in qp/levels.py, in this order. */
typedef enum { CLOSED_FORM, POLISHED, ACTIVE_SET, UNVERIFIED, KEPT, BLOCKED } Route;

/* A feasible point and the directions in which it may still move. */
typedef struct {
    int n, N;      /* unknowns; bounds: the box, then the hard rows */
    int free;      /* columns of Z that count */
    double *v;     /* (n) the point */
    double *Z;     /* (n, n) orthonormal basis of the free directions, n apart */
    double *G;     /* (N, n) the identity, then the hard rows scaled to unit norm */
    double *norms; /* (N) what the rows were divided by: 1 for the box, 0 for zero rows */
    double *lower; /* (N) bounds on G v */
    double *upper; /* (N); after satisfy_rows() with the excess carried */
} State;

double norm_of(const double *x, int count);

void make_problem(const State *state, const double *A, const double *b, int m, Problem *problem,
                  int *rows, Arena *arena);

void narrow(State *state, const double *rows, int count, Arena *arena);

Route satisfy_rows(State *state, int max_rounds, double *multipliers, int *rounds, Arena *arena);

Route descend(State *state, const double *A, const double *b, int m, int max_rounds,
              const double *proposed, int ask, double *multipliers, int *rounds, Arena *arena);

double kkt_residual(const State *state, const double *A, const double *b, int m,
                    const double *residual, const double *multipliers, const double *Z, int free,
                    double small, Arena *arena);

#endif
