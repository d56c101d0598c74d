#include "rows.h"

#include "quaternion.h"
#include "stopping.h"

#include <math.h>

/* limits/trocar_cone.py, limits/spheres.py */
#define CONE_CENTRE 1e-6
#define SPHERE_CENTRE 1e-9

/* How fast s may shrink, at a gain and with a deceleration; limits/base.py: Damper. */
double pace(double gain, double deceleration, double s)
{
    const double A = deceleration, size = fabs(s);
    if (gain * gain * size <= A) return gain * s;
    return copysign(sqrt(2.0 * A * size - A / gain * (A / gain)), s);
}

/* d of a row C v <= d, which lets s shrink by C v - drift: at its pace, or, where jerk is limited,
 * as fast as a stop from now on lets it, if that is less. */
static double paced(const Cycle *cycle, const Block *block, const double *C, double s, double drift)
{
    const double most = pace(block->gain, block->deceleration, s);
    if (!(block->jerk < INFINITY)) return most + drift;
    const double now = dot(C, cycle->v, cycle->n) - drift, change = dot(C, cycle->a, cycle->n);
    return drift + stopping_speed(now, change, s, most, block->deceleration, block->jerk,
                                  block->period);
}

/* limits/joints.py: JointLimits. An angle that is NaN has no position limits. */
static void joint_box(const Cycle *cycle, const Block *block, double *lower, double *upper)
{
    const int n = cycle->n;
    for (int i = 0; i < n; ++i) {
        const double *limit = block->vectors + i, q = cycle->angles[i];
        const Joint joint = {block->period,         limit[SPEED * n],   limit[ACCELERATION * n],
                             limit[JERK * n],       limit[BRAKING * n], limit[EASING * n]};
        const double below = q - limit[LOWEST * n], above = limit[HIGHEST * n] - q;
        double low, up;
        joint_interval(&joint, cycle->v[i], cycle->a[i], below == below ? below : INFINITY,
                       above == above ? above : INFINITY, &low, &up);
        low = clipped(low, lower[i], upper[i]), up = clipped(up, lower[i], upper[i]);
        lower[i] = low, upper[i] = up;
    }
}

static void cone_row(const Cycle *cycle, const Block *block, double *C, double *d)
{
    const int n = cycle->n;
    double axis[3], by[2];
    turned_back(cycle->R, block->axis, axis);
    const double sine = hypot(axis[0], axis[1]);
    by[0] = sine > CONE_CENTRE ? axis[1] / sine : axis[2] > 0.0 ? 0.0 : 1.0;
    by[1] = sine > CONE_CENTRE ? -axis[0] / sine : 0.0;
    for (int j = 0; j < n; ++j) C[j] = by[0] * cycle->J[3 * n + j] + by[1] * cycle->J[4 * n + j];
    d[0] = paced(cycle, block, C, block->half_angle - atan2(sine, axis[2]), 0.0);
}

static void depth_rows(const Cycle *cycle, const Block *block, double *C, double *d)
{
    const int n = cycle->n;
    double r[3], drift[3], nu[3], omega[3], a[3];
    seen(cycle, cycle->pivot, r);
    turned_back(cycle->R, cycle->pivot_dot, drift);
    for (int j = 0; j < n; ++j) {
        column(cycle, j, nu, omega);
        cross(r, omega, a);
        C[j] = nu[2] - a[2], C[n + j] = a[2] - nu[2];
    }
    const double depth = block->tip_depth - r[2];
    d[0] = paced(cycle, block, C, block->deepest - depth, drift[2]);
    d[1] = paced(cycle, block, C + n, depth - block->shallowest, -drift[2]);
}

/* A sphere's centre b (3) and its velocity (3), seen from the effector; limits/spheres.py. */
static void see_sphere(const Cycle *cycle, const Block *block, double *b, double *drift)
{
    double centre[3], velocity[3];
    for (int i = 0; i < 3; ++i) {
        centre[i] = block->centre[i] + (block->on_trocar != 0.0 ? cycle->pivot[i] : 0.0);
        velocity[i] = block->velocity[i] + (block->on_trocar != 0.0 ? cycle->pivot_dot[i] : 0.0);
    }
    seen(cycle, centre, b);
    turned_back(cycle->R, velocity, drift);
}

/* One row for the point s of the axis: away from the sphere's centre (side 1), or towards it (-1).
 * At the centre the first has a way out, along x, and the second a row of zeros. */
static void sphere_row(const Cycle *cycle, const Block *block, const double *b,
                       const double *drift, double s, double side, double *C, double *d)
{
    double u[3] = {b[0], b[1], b[2] - s}, nu[3], omega[3], a[3];
    const double delta = sqrt(dot(u, u, 3));
    for (int i = 0; i < 3; ++i)
        u[i] = delta > SPHERE_CENTRE ? u[i] / delta : i == 0 && side > 0.0;
    for (int j = 0; j < cycle->n; ++j) {
        column(cycle, j, nu, omega);
        cross(b, omega, a);
        C[j] = -side * (u[0] * (a[0] - nu[0]) + u[1] * (a[1] - nu[1]) + u[2] * (a[2] - nu[2]));
    }
    d[0] = paced(cycle, block, C, side * (delta - block->reach), side * dot(u, drift, 3));
}

static void sphere_rows(const Cycle *cycle, const Block *block, double *C, double *d)
{
    const double first = block->first, last = block->last;
    double b[3], drift[3];
    see_sphere(cycle, block, b, drift);
    const double nearest = smaller(larger(b[2], first), last);
    switch (block->kind) {
    case KEEP_OUT: sphere_row(cycle, block, b, drift, nearest, 1.0, C, d); break;
    case ENTRY_SPHERE: sphere_row(cycle, block, b, drift, nearest, -1.0, C, d); break;
    default:
        sphere_row(cycle, block, b, drift, last, -1.0, C, d);
        if (first != last)
            sphere_row(cycle, block, b, drift, first, -1.0, C + cycle->n, d + 1);
    }
}

/* Narrow the box (n) by one limit, or write its rows C v <= d. */
void limit_rows(const Cycle *cycle, const Block *block, double *lower, double *upper, double *C,
                double *d)
{
    switch (block->kind) {
    case JOINTS: joint_box(cycle, block, lower, upper); break;
    case TROCAR_CONE: cone_row(cycle, block, C, d); break;
    case TROCAR_DEPTH: depth_rows(cycle, block, C, d); break;
    case KEEP_OUT: case KEEP_IN: case ENTRY_SPHERE: sphere_rows(cycle, block, C, d); break;
    default: break;
    }
}
