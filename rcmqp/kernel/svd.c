#include "svd.h"

#include <math.h>

/* Two rows whose cosine is below this are orthogonal. */
#define ENOUGH 1e-15

#define MOST_SWEEPS 30

/* Two rows a, b (count) become cos a - sin b, sin a + cos b. */
static void rotate(double *a, double *b, double cosine, double sine, int count)
{
    for (int k = 0; k < count; ++k) {
        const double g = a[k], h = b[k];
        a[k] = cosine * g - sine * h, b[k] = sine * g + cosine * h;
    }
}

/* Rotate the rows of G (r, m) until they are orthogonal: G <- W G, with W (r, r) orthonormal, or
 * NULL where it is not needed; s (r) their lengths. */
static void orthogonalise(double *G, int r, int m, double *W, double *s)
{
    for (int i = 0; W != NULL && i < r * r; ++i) W[i] = i % (r + 1) == 0 ? 1.0 : 0.0;
    int turned = 1;
    for (int sweep = 0; sweep < MOST_SWEEPS && turned; ++sweep) {
        turned = 0;
        for (int i = 0; i < r - 1; ++i)
            for (int j = i + 1; j < r; ++j) {
                double *g = G + i * m, *h = G + j * m;
                const double a = dot(g, g, m), b = dot(h, h, m), c = dot(g, h, m);
                if (!(c * c > ENOUGH * ENOUGH * a * b)) continue;
                const double zeta = (b - a) / (2.0 * c);
                const double t = copysign(1.0, zeta) / (fabs(zeta) + sqrt(1.0 + zeta * zeta));
                const double cosine = 1.0 / sqrt(1.0 + t * t);
                rotate(g, h, cosine, cosine * t, m);
                if (W != NULL) rotate(W + i * r, W + j * r, cosine, cosine * t, r);
                turned = 1;
            }
    }
    for (int i = 0; i < r; ++i) s[i] = sqrt(dot(G + i * m, G + i * m, m));
}

/* The svd of A (m, n), m >= 6, in the arena's memory, with W or without; what is beyond rank RANK
 * is dropped. */
void decompose(const double *A, int m, int n, int with_W, Svd *svd, Arena *arena)
{
    const int r = n < RANK ? n : RANK;
    svd->r = r;
    svd->G = take(arena, r * m), svd->W = with_W ? take(arena, r * r) : NULL;
    svd->Q = take(arena, n * n);
    double *L = take(arena, m * n);
    int *order = (int *)take(arena, m);
    factor(A, m, n, 0.0, L, svd->Q, order);
    for (int i = 0; i < r; ++i)
        for (int k = 0; k < m; ++k) svd->G[i * m + order[k]] = L[k * n + i];
    orthogonalise(svd->G, r, m, svd->W, svd->s);
}

/* Of A (m, n), m >= 6. */
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
