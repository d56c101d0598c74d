/* Singular values of a small matrix whose rank is six at the most, exactly and fast.
 *
 * One-sided Jacobi rotations after a pivoted Householder factorisation: small singular values
 * come out as exactly as large ones do (Drmac and Veselic, SIAM J. Matrix Anal. Appl. 29, 2008).
 */
#ifndef RCMQP_SVD_H
#define RCMQP_SVD_H

#include "linalg.h"

/* Largest rank: of a Jacobian, and of N. */
#define RANK 6

/* The svd of A (m, n), of rank RANK or less: its left vectors are the rows of G over s, its right
 * ones the rows of W times the first columns of Q, in no order. */
typedef struct {
    int r;           /* smallest of RANK, m and n: how many singular values there are */
    double s[RANK];  /* (r) */
    double *G;       /* (r, m) */
    double *W;       /* (r, r) orthonormal; NULL where it was not asked for */
    double *Q;       /* (n, n) orthonormal */
} Svd;

void decompose(const double *A, int m, int n, int with_W, Svd *svd, Arena *arena);

double least_singular_value(const double *A, int m, int n, Arena *arena);

#endif
