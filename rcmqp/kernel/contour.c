#include "contour.h"

#include "linalg.h"

#include <math.h>

/* What is nearer by less than this counts as equally near [m]. So a curve that rests, or that
 * rounding shakes, is passed at once. */
#define ALIKE 1e-12

static double length(const double *d)
{
    return sqrt(dot(d, d, 3));
}

static double from_vertex(const Curve *curve, const double *p, ptrdiff_t k)
{
    const double *a = curve->vertices + 3 * k, d[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
    return length(d);
}

/* Distance of p from the straight line between vertices k and k + 1. */
static double from_segment(const Curve *curve, const double *p, ptrdiff_t k)
{
    const double *a = curve->vertices + 3 * k, *b = a + 3;
    double ab[3], d[3];
    for (int i = 0; i < 3; ++i) ab[i] = b[i] - a[i], d[i] = p[i] - a[i];
    const double square = dot(ab, ab, 3);
    const double share = square > 0.0 ? fmin(1.0, fmax(0.0, dot(d, ab, 3) / square)) : 0.0;
    for (int i = 0; i < 3; ++i) d[i] -= share * ab[i];
    return length(d);
}

/* The first vertex in low .. high that is `along` or more from the start; high, if none is. */
static ptrdiff_t first_at(const Curve *curve, double along, ptrdiff_t low, ptrdiff_t high)
{
    while (low < high) {
        const ptrdiff_t middle = low + (high - low) / 2;
        if (curve->along[middle] >= along)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/* Distance of p (3) from the curve. The search begins at vertex k and goes both ways. From a vertex
 * at distance D, the curve needs a length of D - best before it can be nearer than `best`: so
 * much of it is passed over. */
double contour_distance(const Curve *curve, const double *p, ptrdiff_t k)
{
    const double *along = curve->along;
    const ptrdiff_t last = curve->count - 1;
    double best = from_vertex(curve, p, k);
    for (ptrdiff_t j = k; j > 0;) {
        best = fmin(best, from_segment(curve, p, --j));
        const double room = from_vertex(curve, p, j) - best + ALIKE;
        j = first_at(curve, along[j] - room, 0, j);
    }
    for (ptrdiff_t j = k; j < last;) {
        best = fmin(best, from_segment(curve, p, j++));
        const double room = from_vertex(curve, p, j) - best + ALIKE;
        if (j < last && along[j + 1] <= along[j] + room)
            j = first_at(curve, along[j] + room, j + 1, last + 1) - 1;
    }
    return best;
}

/* The vertex in since .. k that is nearest to p (3); of those that are equally near, the last. */
ptrdiff_t contour_reached(const Curve *curve, const double *p, ptrdiff_t k, ptrdiff_t since)
{
    double best = from_vertex(curve, p, k), distance = best;
    ptrdiff_t reached = k;
    if (isnan(best)) return since;
    for (ptrdiff_t j = k;;) {
        j = first_at(curve, curve->along[j] - (distance - best + ALIKE), since, j) - 1;
        if (j < since) return reached;
        distance = from_vertex(curve, p, j);
        if (distance < best - ALIKE) best = distance, reached = j;
    }
}
