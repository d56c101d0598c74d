#include "planning.h"

#include "dualquaternion.h"
#include "linalg.h"

#include <math.h>
#include <string.h>

/* Rotation r (4) and the depth [m], returned, of the pose x (8) on the shaft: equations (7) and
 * (8); see planner.constrain(). */
static double constrain(const double *x_rcm, const double *x, double *r)
{
    double back[8], y[8];
    dq_conj(x_rcm, back);
    dq_mul(back, x, y);
    memcpy(r, y, 4 * sizeof(double));
    return 2.0 * (y[0] * y[7] - y[3] * y[4] - y[1] * y[6] + y[2] * y[5]); /* k of 2 P* D */
}

/* log(r_l* r_d) (3) of equation (9), and the half angle of that turn, taken the short way. */
static double half_turn(const double *r_l, const double *r_d, double *log)
{
    const double w = dot(r_l, r_d, 4);
    double size = 0.0;
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        log[i] = r_l[0] * r_d[1 + i] - r_d[0] * r_l[1 + i];
        log[i] += r_l[1 + k] * r_d[1 + j] - r_l[1 + j] * r_d[1 + k];
        size = hypot(size, log[i]);
    }
    const double half = atan2(size, w);
    for (int i = 0; i < 3; ++i) log[i] *= size > 0.0 ? half / size : 1.0;
    return atan2(size, fabs(w));
}

/* Whether x (8) is a unit dual quaternion, as usable() asks of references. */
static int is_pose(const double *x)
{
    return fabs(sqrt(dot(x, x, 4)) - 1.0) <= 1e-6 && fabs(dot(x, x + 4, 4)) <= 1e-6;
}

/* One part of the way, equations (9) to (11); see Planner.step().
 *
 * Moves place on, writes the reference on the way, x_d (8) and x_d_dot (8), and returns 1; or 0
 * where what is wanted is to be followed as it is: it is near; or it is not a pose, and place
 * stays what it was. */
int go_on(const Plan *plan, Place *place, const Wanted *wanted, double *x_d, double *x_d_dot)
{
    double offset[3], log[3], target[8], r_l[8] = {0.0}, r_d[4], r_t[4];
    if (!(are_finite(wanted->x_d, 8) && is_pose(wanted->x_d) && are_finite(wanted->pivot, 3) &&
          are_finite(wanted->pivot_dot, 3)))
        return 0;
    for (int i = 0; i < 3; ++i) offset[i] = wanted->pivot[i] - plan->pivot_0[i];
    memcpy(target, wanted->x_d, sizeof target);
    dq_carry(wanted->x_d, offset, -1.0, target);
    const double t_l = constrain(plan->x_rcm, place->x, r_l);
    const double t_d = constrain(plan->x_rcm, target, r_d);
    const double t_t = constrain(plan->x_rcm, place->target, r_t);
    memcpy(place->target, target, sizeof target);
    if (place->left == 0 && !(2.0 * half_turn(r_l, r_d, log) > plan->far_angle ||
                              fabs(t_d - t_l) > plan->far_depth)) {
        memcpy(place->x, target, sizeof target);
        return 0;
    }
    if (place->left == 0 || 2.0 * half_turn(r_t, r_d, log) > plan->far_angle ||
        fabs(t_d - t_t) > plan->far_depth)
        place->left = plan->parts;
    if (dot(r_l, r_d, 4) < 0.0)
        for (int i = 0; i < 4; ++i) r_d[i] = -r_d[i];
    half_turn(r_l, r_d, log);

    const double left = place->left, half = sqrt(dot(log, log, 3)) / left;
    const double sinc = half > 0.0 ? sin(half) / half : 1.0, t = t_l + (t_d - t_l) / left;
    double step[8] = {cos(half)}, r[8];
    for (int i = 0; i < 3; ++i) step[1 + i] = sinc * log[i] / left;
    dq_mul(r_l, step, r);
    r[4] = -0.5 * t * r[3], r[5] = 0.5 * t * r[2], r[6] = -0.5 * t * r[1], r[7] = 0.5 * t * r[0];
    dq_mul(plan->x_rcm, r, place->x);

    const double onwards = left > 1.0 ? 1.0 / (left * plan->period) : 0.0;
    double twist[8] = {0.0};
    for (int i = 0; i < 3; ++i) twist[1 + i] = 2.0 * log[i] * onwards;
    twist[5] = twist[2] * t, twist[6] = -twist[1] * t, twist[7] = (t_d - t_l) * onwards;
    memcpy(x_d, place->x, 8 * sizeof(double));
    dq_carry(place->x, offset, 1.0, x_d);
    dq_rate(x_d, twist, wanted->pivot_dot, x_d_dot);
    --place->left;
    return 1;
}
