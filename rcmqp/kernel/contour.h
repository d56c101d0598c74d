/* How far points are from a curve, and how far along it. */
#ifndef RCMQP_CONTOUR_H
#define RCMQP_CONTOUR_H

#include <stddef.h>

/* Vertices (count, 3) [m], and for each the length of the curve up to it (count) [m]. */
typedef struct {
    const double *vertices, *along;
    ptrdiff_t count;
} Curve;

double contour_distance(const Curve *curve, const double *p, ptrdiff_t k);
ptrdiff_t contour_reached(const Curve *curve, const double *p, ptrdiff_t k, ptrdiff_t since);

#endif
