#include "drawn.h"

#include "dualquaternion.h"
#include "linalg.h"
#include "quaternion.h"
#include "reference.h"

#include <math.h>

#define TAU 6.283185307179586

/* How far a drawing has come at t [s]: s in [0, 1] and s' [1/s]. */
static void progress(double t, double duration, double ramp, double *s, double *s_dot)
{
    if (t > duration / 2.0) {
        progress(duration - fmin(t, duration), duration, ramp, s, s_dot);
        *s = 1.0 - *s;
        return;
    }
    const double cruise = 1.0 / (duration - ramp);
    *s = cruise * (t - ramp / 2.0), *s_dot = cruise;
    if (t >= ramp) return;
    const double u = fmax(t, 0.0) / ramp, u3 = u * u * u;
    *s = cruise * ramp * u3 * u * (2.5 - 3.0 * u + u * u);
    *s_dot = cruise * (u3 * (10.0 - 15.0 * u + 6.0 * u * u));
}

/* Tip p (3) [m] and its derivative by s, dp (3), seen from the trocar in the axes of x_d(0). */
static void draw(const Drawing *drawing, double s, double tip_depth, double *p, double *dp)
{
    const double *a = drawing->numbers;
    const double turns = a[drawing->figure == CIRCLE ? 1 : 3], turn = TAU * turns * s;
    const double c = cos(turn), d = sin(turn), by_s = TAU * turns;
    if (drawing->figure == CIRCLE) {
        p[0] = a[0] * (c - 1.0), p[1] = a[0] * d, p[2] = tip_depth;
        dp[0] = -a[0] * by_s * d, dp[1] = a[0] * by_s * c, dp[2] = 0.0;
    } else if (drawing->figure == LISSAJOUS) {
        const double c_2 = cos(2.0 * turn), d_2 = sin(2.0 * turn);
        p[0] = a[0] * d, p[1] = -a[1] * d_2, p[2] = tip_depth + a[2] * (c_2 - 1.0);
        dp[0] = by_s * a[0] * c, dp[1] = by_s * -2.0 * a[1] * c_2;
        dp[2] = by_s * -2.0 * a[2] * d_2;
    } else { /* on a cone, whose axis is tilted by asin(r_0 / tip_depth) about -y */
        const double r = a[0] + (a[1] - a[0]) * s, r_s = a[1] - a[0], swing = by_s * r;
        const double L = sqrt(tip_depth * tip_depth - a[0] * a[0]), w = turns * a[2];
        const double x = r * c, z = L + w * s, u = r_s * c - swing * d;
        const double e = L / tip_depth, f = -a[0] / tip_depth;
        p[0] = e * x + f * z, p[1] = r * d, p[2] = e * z - f * x;
        dp[0] = e * u + f * w, dp[1] = r_s * d + swing * c, dp[2] = e * w - f * u;
    }
}

/* The view (VIEW_NUMBERS), without roll, whose tip is where the drawing is at t [s]; the tip is
 * tip_depth [m] inside at the start. As reference.view_of_tip() has it. */
void view_at(const Drawing *drawing, double t, double tip_depth, double *view)
{
    double s, s_dot, p[3], q[3];
    progress(t, drawing->duration, drawing->ramp, &s, &s_dot);
    draw(drawing, s, tip_depth, p, q);
    for (int i = 0; i < 3; ++i) q[i] *= s_dot;
    const double h = sqrt(p[0] * p[0] + p[2] * p[2]), d = sqrt(h * h + p[1] * p[1]);
    const double h_dot = (p[0] * q[0] + p[2] * q[2]) / h;
    view[ALPHA] = atan2(p[0], p[2]), view[BETA] = -atan2(p[1], h);
    view[GAMMA] = view[GAMMA_DOT] = 0.0, view[T_Z] = d - tip_depth;
    view[ALPHA_DOT] = (p[2] * q[0] - p[0] * q[2]) / (h * h);
    view[BETA_DOT] = (p[1] * h_dot - h * q[1]) / (d * d);
    view[T_Z_DOT] = (h * h_dot + p[1] * q[1]) / d;
}

/* Origin t (3) and shaft z (3), the third axis, of a pose x (8). */
static void place(const double *x, double *t, double *z)
{
    dq_translation(x, t);
    z[0] = 2.0 * (x[1] * x[3] + x[0] * x[2]);
    z[1] = 2.0 * (x[2] * x[3] - x[0] * x[1]);
    z[2] = x[0] * x[0] - x[1] * x[1] - x[2] * x[2] + x[3] * x[3];
}

/* |a x b| */
static double across(const double *a, const double *b)
{
    double c[3];
    cross(a, b, c);
    return sqrt(dot(c, c, 3));
}

/* What a record says of an effector x (8) that should be at x_d (8), the trocar being at pivot (3)
 * with its axis (3): tip and desired tip (3) [m], and seen (OBSERVED). As dq.translation(),
 * insertion.rcm_error() and their neighbours have it. */
void observe(const double *x, const double *x_d, const double *pivot, const double *axis,
             double tip_depth, double *tip, double *tip_d, double *seen)
{
    double t[3], z[3], t_d[3], z_d[3], way[3], tip_way[3], out[3], turn[3];
    place(x, t, z);
    place(x_d, t_d, z_d);
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        tip[i] = t[i] + tip_depth * z[i], tip_d[i] = t_d[i] + tip_depth * z_d[i];
        way[i] = t[i] - t_d[i], tip_way[i] = tip[i] - tip_d[i], out[i] = pivot[i] - t[i];
        turn[i] = x[0] * x_d[1 + i] - x_d[0] * x[1 + i]; /* vector part of P(x)* P(x_d) */
        turn[i] -= x[1 + j] * x_d[1 + k] - x[1 + k] * x_d[1 + j];
    }
    const double w = x[0] * x_d[0] + dot(x + 1, x_d + 1, 3);
    seen[TIP_ERROR] = sqrt(dot(tip_way, tip_way, 3));
    seen[EFFECTOR_ERROR] = sqrt(dot(way, way, 3));
    seen[ORIENTATION_ERROR] = 2.0 * atan2(sqrt(dot(turn, turn, 3)), fabs(w));
    seen[RCM_ERROR] = across(z, out);
    seen[DEPTH] = tip_depth - dot(z, out, 3);
    seen[TILT] = atan2(across(z, axis), dot(z, axis, 3));
}
