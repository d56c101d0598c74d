#include "reference.h"

#include "dualquaternion.h"

#include <math.h>

/* Twist (8) of a view in the effector's own axes: 0, omega, 0, nu. alpha is about y, seen after
 * beta and gamma; beta about x, seen after gamma; gamma about z. */
static void twist_of_view(const double *view, double *twist)
{
    const double u = view[BETA_DOT], n = view[ALPHA_DOT] * cos(view[BETA]);
    const double s = sin(view[GAMMA]), c = cos(view[GAMMA]);
    twist[0] = twist[4] = 0.0;
    twist[1] = u * c + n * s;
    twist[2] = n * c - u * s;
    twist[3] = view[GAMMA_DOT] - sin(view[BETA]) * view[ALPHA_DOT];
    twist[5] = twist[2] * view[T_Z], twist[6] = -twist[1] * view[T_Z], twist[7] = view[T_Z_DOT];
}

/* Equation (5): x_d (8) = x_d(0) r_alpha r_beta r_gamma (1 + eps k t_z / 2), its derivative
 * x_d_dot (8), and the trocar, pivot (3) = 2 D(x_rcm) P(x_rcm)*; see reference.view_pose().
 * x_rcm (8) is x_d(0), view (VIEW_NUMBERS), pivot_dot (3) the velocity of the trocar [m/s]. */
void pose_of_view(const double *x_rcm, const double *view, const double *pivot_dot, double *x_d,
                  double *x_d_dot, double *pivot)
{
    const double sa = sin(view[ALPHA] / 2.0), ca = cos(view[ALPHA] / 2.0);
    const double sb = sin(view[BETA] / 2.0), cb = cos(view[BETA] / 2.0);
    const double sg = sin(view[GAMMA] / 2.0), cg = cos(view[GAMMA] / 2.0), h = view[T_Z] / 2.0;
    const double w = ca * cb, x = ca * sb, y = sa * cb, z = -sa * sb; /* r_alpha r_beta */
    const double r[4] = {w * cg - z * sg, x * cg + y * sg, y * cg - x * sg, z * cg + w * sg};
    const double local[8] = {r[0], r[1], r[2], r[3], -h * r[3], h * r[2], -h * r[1], h * r[0]};
    double twist[8];
    dq_mul(x_rcm, local, x_d);
    twist_of_view(view, twist);
    dq_rate(x_d, twist, pivot_dot, x_d_dot);
    dq_translation(x_rcm, pivot);
}
