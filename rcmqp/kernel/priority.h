/* Least squares in order of priority, by singular values; in_order() of
 * controllers/pseudoinverse.py is this for Python. */
#ifndef RCMQP_PRIORITY_H
#define RCMQP_PRIORITY_H

#include "linalg.h"

/* Rows A v = b of one level; A (m, n) has rank RANK or less. */
typedef struct {
    int m;
    const double *A; /* (m, n) */
    const double *b; /* (m) */
} Goal;

/* What stands for 1 / s, in the order in which Python hands it over; see controllers/
 * pseudoinverse.py. */
enum { CUT_OFF, BETA, LAMBDA_MAX, EPSILON, INVERSE_NUMBERS };

size_t memory_for_order(int n, int count, int most_rows);

double serve_levels(const Goal *goals, int count, int n, const double *inverse, const double *rest,
                    double *v, Arena *arena);

#endif
