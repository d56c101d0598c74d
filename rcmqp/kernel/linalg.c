#include "linalg.h"

#include <math.h>
#include <string.h>

/* x (r) <- reflector j of L, see reduce(), times x. */
static inline void reflect(const double *restrict L, int r, int j, const double *beta,
                           double *restrict x)
{
    const double *u = L + j * r;
    const double by = beta[j] * (x[j] + dot(u + j + 1, x + j + 1, r - j - 1));
    x[j] -= by;
    add_to(x + j + 1, -by, u + j + 1, r - j - 1);
}

/* L (k, r) in place, by Householder with row pivoting: L[order] is lower trapezoidal times Q1^T.
 *
 * Above its diagonal, row j keeps the reflector 1 - beta u u^T that made it: u from column j + 1
 * on, u_j = 1; beta (min(k, r)). Returns the rank: rows with less than tol left of them are
 * dependent. */
int reduce(double *L, int k, int r, double tol, double *beta, int *order)
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
        const double alpha = u[j] > 0.0 ? -norm : norm, head = u[j] - alpha, by = 1.0 / head;
        beta[j] = -head / alpha, u[j] = alpha;
        for (int p = j + 1; p < r; ++p) u[p] *= by;
        for (int i = j + 1; i < k; ++i) reflect(L, r, j, beta, L + i * r);
        ++rank;
    }
    return rank;
}

/* X (r, n) <- Q^T X, with Q (r, r) the product of the rows' reflectors: then the first `rank` rows
 * of it lie along the rows, the others are apart from them. */
void reflect_rows(const Rows *rows, int r, double *X, int n, Arena *arena)
{
    const size_t mark = arena->used;
    double *sum = take(arena, n);
    for (int j = 0; j < rows->rank; ++j) {
        const double *u = rows->L + j * r;
        memcpy(sum, X + j * n, sizeof(double) * (size_t)n);
        for (int i = j + 1; i < r; ++i) add_to(sum, u[i], X + i * n, n);
        add_to(X + j * n, -rows->beta[j], sum, n);
        for (int i = j + 1; i < r; ++i) add_to(X + i * n, -rows->beta[j] * u[i], sum, n);
    }
    arena->used = mark;
}

/* Room for the rows of a matrix (k, r). */
static void make_rows(Rows *rows, int k, int r, Arena *arena)
{
    *rows = (Rows){0, take(arena, k * r), take(arena, r), (int *)take(arena, k)};
}

/* Q (r, r), the product of the reflectors of L. */
static void expand(const double *L, int r, int rank, const double *beta, double *Q, Arena *arena)
{
    const size_t mark = arena->used;
    double *sum = take(arena, r);
    memset(Q, 0, sizeof(double) * (size_t)(r * r));
    for (int i = 0; i < r; ++i) Q[i * r + i] = 1.0;
    for (int j = rank - 1; j >= 0; --j) {
        const double *u = L + j * r;
        memcpy(sum, Q + j * r + j, sizeof(double) * (size_t)(r - j));
        for (int i = j + 1; i < r; ++i) add_to(sum, u[i], Q + i * r + j, r - j);
        add_to(Q + j * r + j, -beta[j], sum, r - j);
        for (int i = j + 1; i < r; ++i) add_to(Q + i * r + j, -beta[j] * u[i], sum, r - j);
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
    double *beta = take(arena, r);
    memcpy(L, A, sizeof(double) * (size_t)(k * r));
    const int rank = reduce(L, k, r, tol, beta, order);
    expand(L, r, rank, beta, Q, arena);
    for (int j = 0; j < rank; ++j)
        for (int p = j + 1; p < r; ++p) L[j * r + p] = 0.0;
    arena->used = mark;
    return rank;
}

/* M w = left (m, spent) in least squares, where T (r, m) is M^T after reduce(), all r rows of it
 * independent. */
static void solve_columns(const double *T, int r, int m, const double *beta, const int *turn,
                          double *restrict left, double *w)
{
    for (int j = 0; j < r; ++j) reflect(T, m, j, beta, left);
    for (int j = r - 1; j >= 0; --j) {
        const double part = w[turn[j]] = left[j] / T[j * m + j];
        add_to(left, -part, T + j * m, j);
    }
}

/* Room for the factors of a matrix (m, r) at the most. */
LeastSquares make_least_squares(int m, int r, Arena *arena)
{
    LeastSquares made = {0};
    make_rows(&made.rows, m, r, arena);
    make_rows(&made.columns, r, m, arena);
    made.w = take(arena, m > r ? m : r), made.left = take(arena, m);
    return made;
}

/* Factors of M (m, r), which has to stay; rows, and columns, with less than tol left of them are
 * dependent.
 *
 * Columns are reduced where they are independent, for then there is nothing else to find. M's rows
 * take part in their order: heavy ones come first, or they would cost the light ones their digits
 * (Cox and Higham 1998). Rows are reduced first where columns are dependent, or where `with_rows`
 * asks for M's row space.
 *
 * `rank` becomes -1 where a number is not finite. */
void factor_least_squares(LeastSquares *by, const double *M, int m, int r, double tol, int with_rows)
{
    Rows *rows = &by->rows, *columns = &by->columns;
    double *T = columns->L;
    int rank = r;
    by->M = M, by->m = m, by->r = r, by->direct = 0;
    if (!with_rows && m >= r) {
        for (int i = 0; i < m; ++i)
            for (int j = 0; j < r; ++j) T[j * m + i] = M[i * r + j];
        by->direct = reduce(T, r, m, tol, columns->beta, columns->order) == r;
    }
    if (!by->direct) {
        memcpy(rows->L, M, sizeof(double) * (size_t)(m * r));
        rank = rows->rank = reduce(rows->L, m, r, tol, rows->beta, rows->order);
    }
    if (rank < m && !by->direct) { /* M = T^T Q1^T with T (rank, m) = L^T */
        for (int i = 0; i < rank; ++i)
            for (int j = 0; j < m; ++j)
                T[i * m + rows->order[j]] = j < i ? 0.0 : rows->L[j * r + i];
        if (reduce(T, rank, m, 0.0, columns->beta, columns->order) < rank) rank = -1;
    }
    by->rank = columns->rank = rank;
}

/* Least squares of least norm: y (r) = M^+ c, refined once. */
void least_squares(LeastSquares *by, const double *c, double *y)
{
    const Rows *rows = &by->rows, *columns = &by->columns;
    const int m = by->m, r = by->r, rank = by->rank;
    double *w = by->w, *left = by->left;
    memset(y, 0, sizeof(double) * (size_t)r);
    memcpy(left, c, sizeof(double) * (size_t)m);
    for (int refined = 0; refined < 2 && rank > 0; ++refined) {
        for (int i = 0; i < m && refined; ++i) left[i] = c[i] - dot(by->M + i * r, y, r);
        if (rank < m || by->direct) {
            solve_columns(columns->L, rank, m, columns->beta, columns->order, left, w);
        } else {
            for (int i = 0; i < rank; ++i)
                w[i] = (left[rows->order[i]] - dot(rows->L + i * r, w, i)) / rows->L[i * r + i];
        }
        for (int i = rank; i < r; ++i) w[i] = 0.0;
        for (int j = rank - 1; j >= 0 && !by->direct; --j) reflect(rows->L, r, j, rows->beta, w);
        for (int j = 0; j < r; ++j) y[j] += w[j];
    }
}

/* x (m) without its part in the range of M. */
void outside_range(const LeastSquares *by, double *x)
{
    const Rows *columns = &by->columns;
    const int m = by->m, rank = by->rank;
    if (rank < 0 || rank >= m) { /* the range is everything */
        memset(x, 0, sizeof(double) * (size_t)m);
        return;
    }
    for (int j = 0; j < rank; ++j) reflect(columns->L, m, j, columns->beta, x);
    memset(x, 0, sizeof(double) * (size_t)rank);
    for (int j = rank - 1; j >= 0; --j) reflect(columns->L, m, j, columns->beta, x);
}

/* Lower factor of A = L L^T (n, n), positive definite, in place of its lower triangle; on its
 * diagonal is 1 / L_ii, for what follows multiplies by that. */
void cholesky(double *A, int n)
{
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < i; ++j)
            A[i * n + j] = (A[i * n + j] - dot(A + i * n, A + j * n, j)) * A[j * n + j];
        A[i * n + i] = 1.0 / sqrt(A[i * n + i] - dot(A + i * n, A + i * n, i));
    }
}

/* x (n) <- A^-1 x, with L what cholesky() makes of A. */
void cholesky_solve(const double *restrict L, int n, double *restrict x)
{
    for (int i = 0; i < n; ++i) x[i] = (x[i] - dot(L + i * n, x, i)) * L[i * n + i];
    for (int i = n - 1; i >= 0; --i) {
        x[i] *= L[i * n + i];
        add_to(x, -x[i], L + i * n, i);
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
