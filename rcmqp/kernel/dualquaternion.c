#include "dualquaternion.h"

#include "quaternion.h"

#include <math.h>

/* Add the product of two quaternions (4) to out (4). */
static void add_product(const double *x, const double *y, double *out)
{
    double product[4];
    q_mul(x, y, product);
    for (int i = 0; i < 4; ++i) out[i] += product[i];
}

/* Product of two dual quaternions (8); out (8) is neither of them. */
void dq_mul(const double *x, const double *y, double *out)
{
    for (int i = 0; i < 8; ++i) out[i] = 0.0;
    add_product(x, y, out);
    add_product(x, y + 4, out + 4);
    add_product(x + 4, y, out + 4);
}

/* Conjugate (8) of both halves of x (8). */
void dq_conj(const double *x, double *out)
{
    q_conj(x, out);
    q_conj(x + 4, out + 4);
}

/* Translation t (3) of a pose x (8): 2 D(x) P(x)*. */
void dq_translation(const double *x, double *t)
{
    double turn[3];
    cross(x + 1, x + 5, turn);
    for (int i = 0; i < 3; ++i) t[i] = 2.0 * (x[5 + i] * x[0] - x[4] * x[1 + i]) + 2.0 * turn[i];
}

/* Unit dual quaternion x (8), w >= 0, of a placement (7): x, y, z [m], then a quaternion, w last,
 * as Pinocchio has them; see dualquaternion.from_se3(). */
void dq_of_xyzquat(const double *placement, double *x)
{
    const double *r = placement + 3;
    const double squared = r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3];
    const double size = copysign(sqrt(squared), r[3]);
    const double half[4] = {0.0, 0.5 * placement[0], 0.5 * placement[1], 0.5 * placement[2]};
    x[0] = r[3] / size;
    for (int i = 0; i < 3; ++i) x[1 + i] = r[i] / size;
    for (int i = 4; i < 8; ++i) x[i] = 0.0;
    add_product(half, x, x + 4);
}

/* Add to out (8) what moving the pose x (8) by `share` of offset (3), in the world, changes:
 * eps (1/2) share offset P(x). */
void dq_carry(const double *x, const double *offset, double share, double *out)
{
    double half[4] = {0.0};
    for (int i = 0; i < 3; ++i) half[1 + i] = 0.5 * share * offset[i];
    add_product(half, x, out + 4);
}

/* Derivative x_dot (8) of a pose x (8) that turns and moves, and is carried along on top:
 * x (omega + eps nu) / 2 + eps drift P(x) / 2. twist (8): 0, angular velocity in the pose's own
 * axes [rad/s], 0, linear velocity in them [m/s]; drift (3): in the world's axes [m/s]. */
void dq_rate(const double *x, const double *twist, const double *drift, double *x_dot)
{
    dq_mul(x, twist, x_dot);
    for (int i = 0; i < 8; ++i) x_dot[i] *= 0.5;
    dq_carry(x, drift, 1.0, x_dot);
}
