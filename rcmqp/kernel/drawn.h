/* Views of paths that the tool tip draws, and what a record says of poses; many at a time. */
#ifndef RCMQP_DRAWN_H
#define RCMQP_DRAWN_H

/* A path drawn from rest to rest: a conical helix (r_0, r_1, pitch, turns), a circle (radius,
 * turns) or a Lissajous figure (a, b, c, turns); see rcmqp/references/paths. */
typedef enum { HELIX, CIRCLE, LISSAJOUS } Figure;

typedef struct {
    Figure figure;
    const double *numbers; /* (4) */
    double duration, ramp; /* [s] */
} Drawing;

void view_at(const Drawing *drawing, double t, double tip_depth, double *view);

/* Errors of an effector, (OBSERVED): distances [m], angle [rad], depth [m], tilt [rad]. */
enum { TIP_ERROR, EFFECTOR_ERROR, ORIENTATION_ERROR, RCM_ERROR, DEPTH, TILT, OBSERVED };

void observe(const double *x, const double *x_d, const double *pivot, const double *axis,
             double tip_depth, double *tip, double *tip_d, double *seen);

#endif
