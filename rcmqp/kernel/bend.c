#include "bend.h"

#include "quaternion.h"

/* Linear and angular part of one twist's Lie bracket with another, added to `out` times `by`. */
static void add_bracket(const double *first, const double *nu, const double *omega, double by,
                        double *out)
{
    double a[3], b[3];
    cross(first + 3, nu, a);
    cross(omega, first, b);
    for (int i = 0; i < 3; ++i) out[i] += by * (a[i] - b[i]);
    cross(first + 3, omega, a);
    for (int i = 0; i < 3; ++i) out[3 + i] += by * a[i];
}

/* What the axes of the effector turn with about the shaft, spin (3), is taken off a change (6). */
static void without_spin(const double *spin, const double *twist, double *change)
{
    double a[3];
    for (int half = 0; half < 6; half += 3) {
        cross(spin, twist + half, a);
        for (int i = 0; i < 3; ++i) change[half + i] += a[i];
    }
}

/* Second derivative (2) of the trocar seen from the shaft, r, while the joints go on at v; and how it
 * changes by v, by_v (2, n), unless that is NULL.
 *
 * In axes that go along with the shaft but do not spin about it: of a vector in the effector's
 * axes, d/dt changes by omega_z e_z x vector, and omega loses its z. */
void bend(const Cycle *cycle, const double *r, double *out, double *by_v)
{
    const int n = cycle->n;
    double twist[6] = {0}, change[6] = {0}, nu[3], omega[3], a[3], b[3], carried[3], r_dot[3];
    for (int j = 0; j < n; ++j) { /* sum over i < j of the Lie brackets [J_i, J_j] v_i v_j */
        column(cycle, j, nu, omega);
        add_bracket(twist, nu, omega, cycle->v[j], change);
        for (int i = 0; i < 3; ++i)
            twist[i] += cycle->v[j] * nu[i], twist[3 + i] += cycle->v[j] * omega[i];
    }
    const double spin[3] = {0.0, 0.0, twist[5]}, turning[3] = {twist[3], twist[4], 0.0};
    without_spin(spin, twist, change);
    change[5] = 0.0;
    turned_back(cycle->R, cycle->pivot_dot, carried);
    cross(r, turning, a);
    for (int i = 0; i < 3; ++i) r_dot[i] = a[i] - twist[i] + 2.0 * carried[i];
    cross(r, change + 3, a);
    cross(r_dot, turning, b);
    for (int i = 0; i < 2; ++i) out[i] = a[i] - change[i] + b[i];
    double others[6]; /* those before joint j, less those after it */
    for (int i = 0; i < 6; ++i) others[i] = -twist[i];
    for (int j = 0; j < n && by_v != NULL; ++j) {
        double own[6] = {0}, part[3];
        column(cycle, j, nu, omega);
        for (int i = 0; i < 3; ++i)
            others[i] += cycle->v[j] * nu[i], others[3 + i] += cycle->v[j] * omega[i];
        add_bracket(others, nu, omega, 1.0, own);
        for (int i = 0; i < 3; ++i)
            others[i] += cycle->v[j] * nu[i], others[3 + i] += cycle->v[j] * omega[i];
        const double own_twist[6] = {nu[0], nu[1], nu[2], omega[0], omega[1], omega[2]};
        const double own_spin[3] = {0.0, 0.0, omega[2]}, own_turning[3] = {omega[0], omega[1], 0.0};
        without_spin(spin, own_twist, own);
        without_spin(own_spin, twist, own);
        own[5] = 0.0;
        cross(r, own + 3, a);
        cross(r_dot, own_turning, b);
        for (int i = 0; i < 2; ++i) by_v[i * n + j] = a[i] - own[i] + b[i];
        cross(r, own_turning, part);
        for (int i = 0; i < 3; ++i) part[i] -= nu[i];
        cross(part, turning, a);
        for (int i = 0; i < 2; ++i) by_v[i * n + j] += a[i];
    }
}
