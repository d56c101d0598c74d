/* The whole hierarchy in one call.
 *
 * Levels come stacked: rows ends[k - 1] to ends[k] of A and b are level k, the last level is the
 * rest. Results: index 0 is the hard rows, 1 the first level.
 *
 * First, all levels are tried in closed form as if there were no bounds: where the result keeps
 * them, it is the optimum. Otherwise levels go one by one.
 */
#ifndef RCMQP_HIERARCHY_H
#define RCMQP_HIERARCHY_H

#include "cascade.h"

#include <stdint.h>

/* Steps of a damped level inside bounds, see cascade.h. */
#define PROXIMAL 3

/* Active sets that are remembered for each level: that of each step, made once and once more; a
 * strict level's is the first, and that of its damped answer the second. */
#define SETS (2 * PROXIMAL)

/* Columns of `info`. */
enum { ROUTE, ROUNDS, KKT, REACHED, COLUMNS };

/* What is asked; no NaN. */
typedef struct {
    int n, m, levels;     /* unknowns, hard rows, levels with the rest */
    const double *A;      /* (rows, n) of all levels, the rest the last */
    const double *b;      /* (rows) */
    const int64_t *ends;  /* (levels) where each level's rows end */
    const double *damping; /* (levels) of each level, 0 for a strict one; see cascade.h */
    const double *lower;  /* (n) */
    const double *upper;  /* (n) */
    const double *C;      /* (m, n) hard rows C v <= d */
    const double *d;      /* (m) */
    int guarded;          /* how many of the first levels hard rows may not keep from their goal:
                             where the box alone lets these be reached, the rows come after them */
    int sluggish;         /* 1: joints cannot turn round at once; levels that bounds keep from
                             their goal are damped more */
    int max_rounds;       /* of the active set, for each level; 0: account for v as it is */
} Hierarchy;

/* What an account is made of, besides the answer. */
typedef struct Descent Descent;

/* What is answered. solve_hierarchy() fills in v, and for account() what it needs; account() the
 * rest. */
typedef struct {
    double *v;           /* (n) inside the box, finite */
    double *residual;    /* (rows) A v - b */
    double *violation;   /* (m) by how much each hard row is exceeded */
    double *touching;    /* (2, N) 1 where v is at the lower, at the upper bound */
    double *multipliers; /* (levels + 1, N) in the rows' own units, positive at upper bounds */
    double *info;        /* (levels + 1, COLUMNS) */
    Descent *descent;
} Solution;

size_t memory_for(int n, int m, int rows, int levels);

int solve_hierarchy(const Hierarchy *hierarchy, double *sets, Solution *solution,
                    Proposer propose, void *backend, Arena *arena);

void account(const Hierarchy *hierarchy, Solution *solution, Arena *arena);

#endif
