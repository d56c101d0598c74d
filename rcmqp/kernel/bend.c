#include "bend.h"

#include "quaternion.h"

/* A twist's Lie bracket with another, nu and omega, added to `out` (6) times `by`. */
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

/* spin e_z x vector, of both halves of a twist, added to a change of it (6). */
static void add_spin(double spin, const double *twist, double *change)
{
    for (int half = 0; half < 6; half += 3) {
        change[half] -= spin * twist[half + 1];
        change[half + 1] += spin * twist[half];
    }
}

/* Fill in the cycle's twist J v and its change while v stays, without their spin about the shaft. */
void see_twist(Cycle *cycle)
{
    double *twist = cycle->twist, *change = cycle->twist_dot, nu[3], omega[3];
    for (int i = 0; i < 6; ++i) twist[i] = change[i] = 0.0;
    for (int j = 0; j < cycle->n; ++j) { /* sum over i < j of the Lie brackets [J_i, J_j] v_i v_j */
        const double v = cycle->v[j];
        column(cycle, j, nu, omega);
        add_bracket(twist, nu, omega, v, change);
        for (int i = 0; i < 3; ++i) twist[i] += v * nu[i], twist[3 + i] += v * omega[i];
    }
    cycle->spin = twist[5];
    add_spin(cycle->spin, twist, change);
    twist[5] = change[5] = 0.0;
}

/* How a point of the world, r (3), which moves on at `carried` (3), moves as seen from the shaft: its
 * rate (3), and the second derivative (3). */
void bend(const Cycle *cycle, const double *r, const double *carried, double *rate, double *out)
{
    const double *turning = cycle->twist + 3;
    double a[3], b[3], both[3];
    cross(r, turning, a);
    for (int i = 0; i < 3; ++i) {
        rate[i] = a[i] - cycle->twist[i] + carried[i];
        both[i] = rate[i] + carried[i];
    }
    cross(r, cycle->twist_dot + 3, a);
    cross(both, turning, b);
    for (int i = 0; i < 3; ++i) out[i] = a[i] - cycle->twist_dot[i] + b[i];
}

/* How the first two numbers of bend() change by v (2, n). */
void bend_by_v(const Cycle *cycle, const double *r, const double *carried, const double *rate,
               double *out)
{
    const int n = cycle->n;
    const double *turning = cycle->twist + 3;
    double twist[6], others[6], both[3]; /* others: the joints before j, less those after it */
    for (int i = 0; i < 6; ++i) twist[i] = cycle->twist[i] + (i == 5 ? cycle->spin : 0.0);
    for (int i = 0; i < 6; ++i) others[i] = -twist[i];
    for (int i = 0; i < 3; ++i) both[i] = rate[i] + carried[i];
    for (int j = 0; j < n; ++j) {
        const double v = cycle->v[j];
        double own[6], change[6] = {0}, a[3], b[3], own_rate[3];
        column(cycle, j, own, own + 3);
        for (int i = 0; i < 6; ++i) others[i] += v * own[i];
        add_bracket(others, own, own + 3, 1.0, change);
        for (int i = 0; i < 6; ++i) others[i] += v * own[i];
        add_spin(cycle->spin, own, change);
        add_spin(own[5], twist, change);
        own[5] = change[5] = 0.0;
        cross(r, own + 3, a);
        for (int i = 0; i < 3; ++i) own_rate[i] = a[i] - own[i];
        cross(own_rate, turning, b);
        for (int i = 0; i < 2; ++i) out[i * n + j] = b[i];
        cross(r, change + 3, a);
        cross(both, own + 3, b);
        for (int i = 0; i < 2; ++i) out[i * n + j] += a[i] - change[i] + b[i];
    }
}
