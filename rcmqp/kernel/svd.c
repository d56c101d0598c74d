#include "svd.h"

#include <math.h>

/* Two rows whose cosine is below this are orthogonal: for vectors; for values alone, which err by
 * half of it at the most, and by its square where they are apart. */
#define ENOUGH 1e-15
#define ENOUGH_FOR_VALUES 1e-9

#define MOST_SWEEPS 30

#define PAIRS (RANK * (RANK - 1) / 2)

/* Every two rows once, in an order in which the next pairs need not wait for the last. */
static const int pairs[PAIRS][2] = {
    {0, 1}, {2, 3}, {4, 5}, {0, 2}, {1, 4}, {3, 5}, {0, 3}, {2, 4},
    {1, 5}, {0, 4}, {1, 3}, {2, 5}, {0, 5}, {1, 2}, {3, 4},
};

/* Two rows a, b (count) become cos a - sin b, sin a + cos b. */
static inline void rotate(double *restrict a, double *restrict b, double cosine, double sine,
                          int count)
{
    for (int k = 0; k < count; ++k) {
        const double g = a[k], h = b[k];
        a[k] = cosine * g - sine * h, b[k] = sine * g + cosine * h;
    }
}

/* Rotate the rows of G (r, m) until they are orthogonal: G <- W G, with W (r, r) orthonormal, or
 * NULL where it is not needed; s (r) their lengths. Called with constants for r and m, it is
 * unrolled. Squared lengths follow the rotations and are made anew once a sweep. */
static inline void orthogonalise(double *G, int r, int m, double *W, double *s)
{
    const double enough = W == NULL ? ENOUGH_FOR_VALUES : ENOUGH;
    double square[RANK];
    for (int i = 0; W != NULL && i < r * r; ++i) W[i] = i % (r + 1) == 0 ? 1.0 : 0.0;
    int turned = 1;
    for (int sweep = 0; sweep < MOST_SWEEPS && turned; ++sweep) {
        turned = 0;
        for (int i = 0; i < r; ++i) square[i] = dot(G + i * m, G + i * m, m);
        for (int pair = 0; pair < PAIRS; ++pair) {
            const int i = pairs[pair][0], j = pairs[pair][1];
            if (j >= r) continue;
            double *g = G + i * m, *h = G + j * m;
            const double c = dot(g, h, m);
            if (!(c * c > enough * enough * square[i] * square[j])) continue;
            const double apart = square[j] - square[i];
            const double size = sqrt(apart * apart + 4.0 * c * c), sum = fabs(apart) + size;
            const double cosine = sqrt(sum / (2.0 * size)), t = copysign(2.0, apart) * c / sum;
            rotate(g, h, cosine, cosine * t, m);
            if (W != NULL) rotate(W + i * r, W + j * r, cosine, cosine * t, r);
            square[i] -= t * c, square[j] += t * c;
            turned = 1;
        }
    }
    for (int i = 0; i < r; ++i) s[i] = sqrt(dot(G + i * m, G + i * m, m));
}

/* The svd of A (m, n) in the arena's memory, with W or without; what is beyond rank RANK is
 * dropped. */
void decompose(const double *A, int m, int n, int with_W, Svd *svd, Arena *arena)
{
    const int most = m < n ? m : n, r = most < RANK ? most : RANK;
    svd->r = r;
    svd->G = take(arena, r * m), svd->W = with_W ? take(arena, r * r) : NULL;
    svd->Q = take(arena, n * n);
    double *L = take(arena, m * n);
    int *order = (int *)take(arena, m);
    factor(A, m, n, 0.0, L, svd->Q, order, arena);
    for (int i = 0; i < r; ++i)
        for (int k = 0; k < m; ++k) svd->G[i * m + order[k]] = L[k * n + i];
    if (r == RANK && m == 8)
        orthogonalise(svd->G, RANK, 8, svd->W, svd->s);
    else if (r == RANK && m == 6)
        orthogonalise(svd->G, RANK, 6, svd->W, svd->s);
    else
        orthogonalise(svd->G, r, m, svd->W, svd->s);
}

/* Of A (m, n). */
double least_singular_value(const double *A, int m, int n, Arena *arena)
{
    const size_t mark = arena->used;
    Svd svd;
    decompose(A, m, n, 0, &svd, arena);
    double least = svd.s[0];
    for (int i = 1; i < svd.r; ++i) least = smaller(least, svd.s[i]);
    arena->used = mark;
    return least;
}
