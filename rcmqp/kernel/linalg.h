/* Small dense factorisations: pivoted Householder, least squares, nonnegative least squares.
 *
 * Sizes are those of an arm, so loops are plain and every answer is refined once. Matrices are
 * row-major and packed: A (k, r) has its element (i, j) at A[i * r + j].
 */
#ifndef RCMQP_LINALG_H
#define RCMQP_LINALG_H

#include <math.h>
#include <stddef.h>

/* Scratch memory: take() from it, and put `used` back where it was when done. */
typedef struct {
    double *memory;
    size_t used;
} Arena;

static inline double *take(Arena *arena, int count)
{
    double *found = arena->memory + arena->used;
    arena->used += (size_t)(count > 0 ? count : 0);
    return found;
}

/* Two sums, so that one addition need not wait for the other. */
static inline double dot(const double *a, const double *b, int n)
{
    double even = 0.0, odd = 0.0;
    int i = 0;
    for (; i + 1 < n; i += 2) even += a[i] * b[i], odd += a[i + 1] * b[i + 1];
    if (i < n) even += a[i] * b[i];
    return even + odd;
}

/* y (n) += by x, two numbers at a time: sizes are too small for what compilers make of a loop. */
static inline void add_to(double *restrict y, double by, const double *restrict x, int n)
{
    int i = 0;
    for (; i + 1 < n; i += 2) {
        const double first = y[i] + by * x[i], second = y[i + 1] + by * x[i + 1];
        y[i] = first, y[i + 1] = second;
    }
    if (i < n) y[i] += by * x[i];
}

/* Whether all numbers are finite. */
static inline int are_finite(const double *numbers, ptrdiff_t count)
{
    for (ptrdiff_t i = 0; i < count; ++i)
        if (!(fabs(numbers[i]) < INFINITY)) return 0;
    return 1;
}

static inline double larger(double a, double b) { return a > b ? a : b; }

static inline double smaller(double a, double b) { return a < b ? a : b; }

static inline double clipped(double value, double low, double up)
{
    return value < low ? low : value > up ? up : value;
}

/* What reduce() makes of the rows of a matrix (k, r). */
typedef struct {
    int rank;
    double *L;    /* (k, r) lower trapezoidal, and above its diagonal the reflectors */
    double *beta; /* (min(k, r)) */
    int *order;   /* (k) which row each one was */
} Rows;

/* The factors of a matrix M (m, r), to solve with. */
typedef struct {
    const double *M;
    int m, r, rank, direct; /* direct: M's columns were reduced, and not its rows */
    Rows rows;              /* M's, where not direct */
    Rows columns;           /* M's, or those of L of its rows where these are dependent */
    double *w, *left;       /* scratch */
} LeastSquares;

int factor(const double *A, int k, int r, double tol, double *L, double *Q, int *order,
           Arena *arena);

int reduce(double *L, int k, int r, double tol, double *beta, int *order);

void reflect_rows(const Rows *rows, int r, double *X, int n, Arena *arena);

LeastSquares make_least_squares(int m, int r, Arena *arena);

void factor_least_squares(LeastSquares *by, const double *M, int m, int r, double tol, int with_rows);

void least_squares(LeastSquares *by, const double *c, double *y);

void outside_range(const LeastSquares *by, double *x);

void cholesky(double *A, int n);

void cholesky_solve(const double *L, int n, double *x);

double nnls(double *B, int k, int r, const double *g, double *lam, Arena *arena);

#endif
