#include "priority.h"

#include "svd.h"

#include <math.h>
#include <string.h>

/* x (n) <- (I - rows^T rows) x, of `count` orthonormal rows. */
static void project(const double *rows, int count, int n, double *x)
{
    for (int k = 0; k < count; ++k, rows += n) add_to(x, -dot(rows, x, n), rows, n);
}

static double largest_of(const Svd *svd)
{
    double largest = 0.0;
    for (int i = 0; i < svd->r; ++i) largest = larger(largest, svd->s[i]);
    return largest;
}

/* Of A (m, n). */
static double largest_singular_value(const double *A, int m, int n, Arena *arena)
{
    const size_t mark = arena->used;
    Svd svd;
    decompose(A, m, n, 0, &svd, arena);
    arena->used = mark;
    return largest_of(&svd);
}

/* The damping of a singular value, squared; Chiaverini 1997. */
static double damping_of(const double *inverse, double s, int is_least)
{
    const double beta = inverse[BETA], most = inverse[LAMBDA_MAX], share = s / inverse[EPSILON];
    return beta * beta + (is_least && share < 1.0 ? most * most * (1.0 - share * share) : 0.0);
}

/* One level: v (n) moves in what the first *held rows (n) leave free, and the directions that it
 * takes become rows, too. Returns its least singular value; NaN where numbers overflow. */
static double take_level(const Goal *goal, int n, const double *inverse, double *rows, int *held,
                         double *v, Arena *arena)
{
    const int m = goal->m, above = *held;
    double *AP = take(arena, m * n), *left = take(arena, m), *step = take(arena, n), least = NAN;
    Svd svd;
    memcpy(AP, goal->A, sizeof(double) * (size_t)(m * n));
    memset(step, 0, sizeof(double) * (size_t)n);
    for (int i = 0; i < m; ++i) {
        project(rows, above, n, AP + i * n);
        left[i] = goal->b[i] - dot(goal->A + i * n, v, n);
    }
    decompose(AP, m, n, 1, &svd, arena);
    if (!are_finite(svd.s, svd.r)) return NAN;
    int last = 0;
    for (int i = 1; i < svd.r; ++i) last = svd.s[i] < svd.s[last] ? i : last;
    least = svd.s[last];
    const double largest = above > 0 ? largest_singular_value(goal->A, m, n, arena)
                                     : largest_of(&svd);
    for (int i = 0; i < svd.r; ++i) {
        const double s = svd.s[i];
        if (!(s > inverse[CUT_OFF] * largest)) continue;
        double *row = rows + (*held)++ * n; /* a row of G is s times the left vector */
        const double by = dot(svd.G + i * m, left, m) / (s * s + damping_of(inverse, s, i == last));
        for (int j = 0; j < n; ++j) row[j] = dot(svd.Q + j * n, svd.W + i * svd.r, svd.r);
        add_to(step, by, row, n);
    }
    project(rows, above, n, step); /* again, for where A P is small beside A */
    add_to(v, 1.0, step, n);
    return least;
}

size_t memory_for_order(int n, int count, int most_rows)
{
    return (size_t)(RANK * n * count + 4 * most_rows * n + 3 * n * n + 8 * n + 20 * most_rows +
                    2 * RANK * RANK);
}

/* v (n) that serves each level in what those above it leave free, and `rest` (n), if any, in what
 * all of them do. Returns the least singular value of the last level in what it is left; v is NaN where a
 * number is not finite, or overflows. */
double serve_levels(const Goal *goals, int count, int n, const double *inverse, const double *rest,
                    double *v, Arena *arena)
{
    double *rows = take(arena, RANK * n * count), *free = take(arena, n), least = 0.0;
    int held = 0, fine = rest == NULL || are_finite(rest, n);
    memset(v, 0, sizeof(double) * (size_t)n);
    for (int k = 0; k < count && fine; ++k) {
        const size_t mark = arena->used;
        const Goal *goal = goals + k;
        fine = are_finite(goal->A, (ptrdiff_t)goal->m * n) && are_finite(goal->b, goal->m);
        if (fine) least = take_level(goal, n, inverse, rows, &held, v, arena);
        fine = fine && are_finite(&least, 1);
        arena->used = mark;
    }
    if (rest != NULL) {
        memcpy(free, rest, sizeof(double) * (size_t)n);
        project(rows, held, n, free);
        add_to(v, 1.0, free, n);
    }
    for (int j = 0; j < n && !fine; ++j) v[j] = NAN;
    return fine ? least : NAN;
}
