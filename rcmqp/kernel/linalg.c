#include "linalg.h"

#include <math.h>
#include <string.h>

/* x (r) <- reflector j of L, see reduce(), times x. */
static void reflect(const double *L, int r, int j, const double *head, double *x)
{
    const double *u = L + j * r + j + 1;
    double *tail = x + j + 1;
    const int count = r - j - 1;
    const double by = -(head[j] * x[j] + dot(u, tail, count)) / (L[j * r + j] * head[j]);
    x[j] -= by * head[j];
    for (int p = 0; p < count; ++p) tail[p] -= by * u[p];
}

/* L (k, r) in place, by Householder with row pivoting: L[order] is lower trapezoidal times Q1^T.
 *
 * Above its diagonal, row j keeps the reflector 1 - beta u u^T that made it: u from column j + 1
 * on, its first number in head (min(k, r)). Returns the rank: rows with less than tol left of them
 * are dependent. */
static int reduce(double *L, int k, int r, double tol, double *head, int *order)
{
    int rank = 0;
    for (int i = 0; i < k; ++i) order[i] = i;
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
        double *u = L + j * r;
        const double alpha = u[j] > 0.0 ? -norm : norm;
        head[j] = u[j] - alpha, u[j] = alpha;
        for (int i = j + 1; i < k; ++i) reflect(L, r, j, head, L + i * r);
        ++rank;
    }
    return rank;
}

/* Q (r, r), the product of the reflectors of L. */
static void expand(const double *L, int r, int rank, const double *head, double *Q, Arena *arena)
{
    const size_t mark = arena->used;
    double *sum = take(arena, r);
    memset(Q, 0, sizeof(double) * (size_t)(r * r));
    for (int i = 0; i < r; ++i) Q[i * r + i] = 1.0;
    for (int j = rank - 1; j >= 0; --j) {
        const double beta = -1.0 / (L[j * r + j] * head[j]);
        for (int c = j; c < r; ++c) sum[c] = 0.0;
        for (int i = j; i < r; ++i) {
            const double u = i == j ? head[j] : L[j * r + i];
            for (int c = j; c < r; ++c) sum[c] += u * Q[i * r + c];
        }
        for (int i = j; i < r; ++i) {
            const double by = beta * (i == j ? head[j] : L[j * r + i]);
            for (int c = j; c < r; ++c) Q[i * r + c] -= by * sum[c];
        }
    }
    arena->used = mark;
}

/* Row space of A (k, r): A[order] = L Q[:, :rank]^T.
 *
 * L (k, r) is lower trapezoidal, its first `rank` columns count; Q (r, r) is orthonormal, its
 * columns from rank on span the null space of A; order (k) says which row of A each row of L is.
 * Returns the rank: rows with less than tol left of them are dependent. */
int factor(const double *A, int k, int r, double tol, double *L, double *Q, int *order,
           Arena *arena)
{
    const size_t mark = arena->used;
    double *head = take(arena, r);
    memcpy(L, A, sizeof(double) * (size_t)(k * r));
    const int rank = reduce(L, k, r, tol, head, order);
    expand(L, r, rank, head, Q, arena);
    for (int j = 0; j < rank; ++j)
        for (int p = j + 1; p < r; ++p) L[j * r + p] = 0.0;
    arena->used = mark;
    return rank;
}

/* Least squares of least norm: y (r) = M^+ c, refined once; rows of M (m, r)
 * with less than tol left of them are dependent.
 *
 * Q (r, r): columns from rank on span the null space of M. Where rank < m, the first *range
 * columns of U (m, m) span the range of M; otherwise *range is -1: the range is everything. Q and
 * U are not made where they are NULL. Returns the rank, or -1 where the numbers are no numbers. */
int pseudo_solve(const double *M, int m, int r, const double *c, double tol, double *y, double *Q,
                 double *U, int *range, Arena *arena)
{
    const size_t mark = arena->used;
    double *L = take(arena, m * r), *S = NULL, *w = take(arena, m > r ? m : r);
    double *heads = take(arena, r), *tops = take(arena, r), *left = take(arena, m);
    int *order = (int *)take(arena, m), *turn = (int *)take(arena, r);
    memset(y, 0, sizeof(double) * (size_t)r);
    memcpy(L, M, sizeof(double) * (size_t)(m * r));
    int rank = reduce(L, m, r, tol, heads, order);
    const int found = rank, tall = rank < m;
    *range = tall ? rank : -1;
    if (Q != NULL) expand(L, r, rank, heads, Q, arena);
    if (tall && rank > 0) { /* M = T^T Q1^T with T (rank, m) = L^T; T[turn] = S U1^T */
        S = take(arena, rank * m);
        for (int i = 0; i < rank; ++i)
            for (int j = 0; j < m; ++j) S[i * m + order[j]] = j < i ? 0.0 : L[j * r + i];
        if (reduce(S, rank, m, 0.0, tops, turn) < rank) rank = -1;
        else if (U != NULL) expand(S, m, rank, tops, U, arena);
    }
    for (int refined = 0; refined < 2 && rank > 0; ++refined) {
        for (int i = 0; i < m; ++i) left[i] = c[i] - dot(M + i * r, y, r);
        if (!tall) {
            for (int i = 0; i < rank; ++i)
                w[i] = (left[order[i]] - dot(L + i * r, w, i)) / L[i * r + i];
        } else {
            for (int j = 0; j < rank; ++j) reflect(S, m, j, tops, left);
            for (int i = rank - 1; i >= 0; --i) {
                double total = left[i];
                for (int j = i + 1; j < rank; ++j) total -= S[j * m + i] * w[turn[j]];
                w[turn[i]] = total / S[i * m + i];
            }
        }
        for (int i = rank; i < r; ++i) w[i] = 0.0;
        for (int j = found - 1; j >= 0; --j) reflect(L, r, j, heads, w);
        for (int j = 0; j < r; ++j) y[j] += w[j];
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
    for (int i = 0; i < n; ++i) {
        double *row = B + i * columns;
        const double by = 1.0 / L[i * n + i];
        for (int j = 0; j < i; ++j)
            for (int c = 0; c < columns; ++c) row[c] -= L[i * n + j] * B[j * columns + c];
        for (int c = 0; c < columns; ++c) row[c] *= by;
    }
    for (int i = n - 1; i >= 0; --i) {
        double *row = B + i * columns;
        const double by = 1.0 / L[i * n + i];
        for (int j = i + 1; j < n; ++j)
            for (int c = 0; c < columns; ++c) row[c] -= L[j * n + i] * B[j * columns + c];
        for (int c = 0; c < columns; ++c) row[c] *= by;
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
            if (factor(rows, count, r, 1e-12, L, Q, order, arena) < count) {
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
