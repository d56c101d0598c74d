#include "linalg.h"

#include <math.h>
#include <string.h>

/* Row space of A (k, r): A[order] = L Q[:, :rank]^T, by Householder with row pivoting.
 *
 * L (k, r) is lower trapezoidal, its first `rank` columns count; Q (r, r) is orthonormal, its
 * columns from rank on span the null space of A; order (k) says which row of A each row of L is.
 * Returns the rank: rows with less than tol left of them are dependent. */
int factor(const double *A, int k, int r, double tol, double *L, double *Q, int *order)
{
    int rank = 0;
    for (int i = 0; i < k; ++i) order[i] = i;
    memcpy(L, A, sizeof(double) * (size_t)(k * r));
    memset(Q, 0, sizeof(double) * (size_t)(r * r));
    for (int i = 0; i < r; ++i) Q[i * r + i] = 1.0;
    for (int j = 0; j < k && j < r; ++j) {
        double best = 0.0;
        int at = j;
        for (int i = j; i < k; ++i) {
            const double left = dot(L + i * r + j, L + i * r + j, r - j);
            if (left > best) best = left, at = i;
        }
        const double norm = sqrt(best);
        if (!(norm > tol)) break;
        if (at != j) {
            const int turn = order[j];
            order[j] = order[at], order[at] = turn;
            for (int p = 0; p < r; ++p) {
                const double swap = L[j * r + p];
                L[j * r + p] = L[at * r + p], L[at * r + p] = swap;
            }
        }
        double *u = L + j * r; /* the reflector 1 - beta u u^T; u[j] apart, until the end */
        const double alpha = u[j] > 0.0 ? -norm : norm;
        u[j] -= alpha;
        const double beta = -1.0 / (alpha * u[j]);
        for (int i = j + 1; i < k; ++i) {
            const double by = beta * dot(L + i * r + j, u + j, r - j);
            for (int p = j; p < r; ++p) L[i * r + p] -= by * u[p];
        }
        for (int i = 0; i < r; ++i) {
            const double by = beta * dot(Q + i * r + j, u + j, r - j);
            for (int p = j; p < r; ++p) Q[i * r + p] -= by * u[p];
        }
        u[j] = alpha;
        for (int p = j + 1; p < r; ++p) u[p] = 0.0;
        ++rank;
    }
    return rank;
}

/* Least squares of least norm: y (r) = M^+ c, refined once; rows of M (m, r)
 * with less than tol left of them are dependent.
 *
 * Q (r, r): columns from rank on span the null space of M. Where rank < m, the first *range
 * columns of U (m, m) span the range of M; otherwise *range is -1: the range is everything.
 * Returns the rank, or -1 where the numbers are no numbers. */
int pseudo_solve(const double *M, int m, int r, const double *c, double tol, double *y, double *Q,
                 double *U, int *range, Arena *arena)
{
    const size_t mark = arena->used;
    const int size = m > r ? m : r;
    double *L = take(arena, m * r), *w = take(arena, size), *e = take(arena, size);
    double *left = take(arena, size), *S = NULL;
    int *order = (int *)take(arena, m), *turn = NULL;
    memset(y, 0, sizeof(double) * (size_t)r);
    int rank = factor(M, m, r, tol, L, Q, order);
    const int tall = rank < m;
    *range = tall ? rank : -1;
    if (tall && rank > 0) { /* M = T^T Q1^T with T (rank, m) = L^T; T[turn] = S U1^T */
        double *T = take(arena, rank * m);
        S = take(arena, rank * m), turn = (int *)take(arena, rank);
        for (int i = 0; i < rank; ++i)
            for (int j = 0; j < m; ++j) T[i * m + order[j]] = L[j * r + i];
        if (factor(T, rank, m, 0.0, S, U, turn) < rank) rank = -1;
    }
    for (int refined = 0; refined < 2 && rank > 0; ++refined) {
        for (int i = 0; i < m; ++i) left[i] = c[i] - dot(M + i * r, y, r);
        if (!tall) {
            for (int i = 0; i < rank; ++i)
                w[i] = (left[order[i]] - dot(L + i * r, w, i)) / L[i * r + i];
        } else {
            for (int i = 0; i < rank; ++i) {
                e[i] = 0.0;
                for (int j = 0; j < m; ++j) e[i] += U[j * m + i] * left[j];
            }
            for (int i = rank - 1; i >= 0; --i) {
                double total = e[i];
                for (int j = i + 1; j < rank; ++j) total -= S[j * m + i] * w[turn[j]];
                w[turn[i]] = total / S[i * m + i];
            }
        }
        for (int j = 0; j < r; ++j) y[j] += dot(Q + j * r, w, rank);
    }
    arena->used = mark;
    return rank;
}

/* Lower factor of A = L L^T (n, n), positive definite, in place of its lower triangle. */
void cholesky(double *A, int n)
{
    for (int i = 0; i < n; ++i)
        for (int j = 0; j <= i; ++j) {
            const double left = A[i * n + j] - dot(A + i * n, A + j * n, j);
            A[i * n + j] = i == j ? sqrt(left) : left / A[j * n + j];
        }
}

/* B (n, columns) <- A^-1 B, with L the lower factor of A. */
void cholesky_solve(const double *L, int n, double *B, int columns)
{
    for (int c = 0; c < columns; ++c) {
        for (int i = 0; i < n; ++i) {
            double total = B[i * columns + c];
            for (int j = 0; j < i; ++j) total -= L[i * n + j] * B[j * columns + c];
            B[i * columns + c] = total / L[i * n + i];
        }
        for (int i = n - 1; i >= 0; --i) {
            double total = B[i * columns + c];
            for (int j = i + 1; j < n; ++j) total -= L[j * n + i] * B[j * columns + c];
            B[i * columns + c] = total / L[i * n + i];
        }
    }
}

/* lam (k) >= 0 that makes |B^T lam - g| least, by Lawson and Hanson's method; returns that norm.
 * B (k, r) has rows of about unit norm; rows found dependent are zeroed. */
double nnls(double *B, int k, int r, const double *g, double *lam, Arena *arena)
{
    const size_t mark = arena->used;
    double *rows = take(arena, k * r), *L = take(arena, k * r), *Q = take(arena, r * r);
    double *left = take(arena, r), *s = take(arena, k);
    int *order = (int *)take(arena, k), *index = (int *)take(arena, k);
    int *passive = (int *)take(arena, k), count = 0;
    const double size = sqrt(dot(g, g, r));
    memcpy(left, g, sizeof(double) * (size_t)r);
    for (int i = 0; i < k; ++i) lam[i] = s[i] = 0.0, passive[i] = 0;
    for (int turn = 0; turn < 10 * k + 10; ++turn) {
        double best = 1e-14 * size;
        int at = -1;
        for (int i = 0; i < k; ++i) {
            const double gain = passive[i] ? 0.0 : dot(B + i * r, left, r);
            if (gain > best) best = gain, at = i;
        }
        if (at < 0 || count == r) break;
        passive[at] = 1;
        for (;;) {
            count = 0;
            for (int i = 0; i < k; ++i) {
                if (!passive[i]) continue;
                memcpy(rows + count * r, B + i * r, sizeof(double) * (size_t)r);
                index[count++] = i;
            }
            if (factor(rows, count, r, 1e-12, L, Q, order) < count) {
                const int useless = passive[at] ? at : index[order[count - 1]];
                passive[useless] = 0;
                memset(B + useless * r, 0, sizeof(double) * (size_t)r);
                continue;
            }
            for (int i = count - 1; i >= 0; --i) {
                double total = 0.0;
                for (int j = 0; j < r; ++j) total += Q[j * r + i] * g[j];
                for (int j = i + 1; j < count; ++j) total -= L[j * r + i] * s[index[order[j]]];
                s[index[order[i]]] = total / L[i * r + i];
            }
            double share = 1.0;
            int worst = -1;
            for (int i = 0; i < k; ++i) {
                if (!passive[i] || s[i] > 0.0) continue;
                const double step = lam[i] > s[i] ? lam[i] / (lam[i] - s[i]) : 0.0;
                if (worst < 0 || step < share) share = step, worst = i;
            }
            if (worst < 0) break;
            for (int i = 0; i < k; ++i)
                if (passive[i]) lam[i] += share * (s[i] - lam[i]);
            lam[worst] = 0.0;
            passive[worst] = 0;
        }
        memcpy(left, g, sizeof(double) * (size_t)r);
        for (int i = 0; i < k; ++i) {
            lam[i] = passive[i] ? s[i] : 0.0;
            for (int j = 0; j < r; ++j) left[j] -= lam[i] * B[i * r + j];
        }
    }
    arena->used = mark;
    return sqrt(dot(left, left, r));
}
