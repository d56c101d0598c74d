#include "approach.h"

#include <string.h>

/* Below this, an error is rounding and is not braked for [unit of the rows]. */
#define NO_ERROR 1e-12

/* Damping of the joints' part in a strict task, whose own is zero [unit of the rows]. */
#define STRICT_DAMPING 1e-3

/* Weight of the strict rows against those of the task. */
#define STRICT_WEIGHT 1e3

/* Speed from which a stop with limited acceleration and jerk ends after `distance`.
 *
 * From acceleration zero a stop goes v sqrt(v / j) where the acceleration's limit A is not met,
 * up to v = A^2 / j, and v (v / A + A / j) / 2 beyond. The two are solved for v, and the way of
 * two cycles, for the command that has to come first, is taken off. */
double stop_speed(double distance, double acceleration, double jerk, double period)
{
    const double A = acceleration, ramp = A / jerk; /* zero without a limit on jerk */
    double v = INFINITY;
    if (!(A < INFINITY) && !(jerk < INFINITY)) return distance / period;
    if (ramp * ramp * A < distance) /* a stop from v = A ramp takes A ramp^2 */
        v = 2.0 * distance / (0.5 * ramp + sqrt(0.25 * ramp * ramp + 2.0 * distance / A));
    else
        v = cbrt(distance * distance * jerk);
    return v / (1.0 + 2.0 * period * v / distance);
}

/* Share of -gain e at which a task of rows A (m, n) and error e (m) may be approached.
 *
 * With n = e / |e| and w = [strict; A]^+ [0; n] the joints' part in it, damped, the task can be
 * slowed down at min_j a_j / |w_j|, and that changed at min_j j_j / |w_j|; of both, the share of
 * the brakes is counted on, for the joints have more to do. */
double braked_share(const Brakes *brakes, const double *strict, int strict_rows, const double *A,
                const double *e, int m, double gain, double damping, Arena *arena)
{
    const int n = brakes->n;
    const double size = sqrt(dot(e, e, m)), T = brakes->period;
    const double by = damping > 0.0 ? damping : STRICT_DAMPING;
    double least_a = INFINITY, least_j = INFINITY, a = INFINITY, j = INFINITY;
    if (!(size > NO_ERROR) || !(gain > 0.0) || !(brakes->share > 0.0)) return 1.0;
    for (int i = 0; i < n; ++i) { /* |w_j| is at most 1 / (2 damping) */
        least_a = smaller(least_a, brakes->acceleration[i]);
        least_j = smaller(least_j, brakes->jerk[i]);
    }
    const double least = 2.0 * by * brakes->share;
    if (stop_speed(size, least * least_a, least * least_j, T) >= gain * size) return 1.0;
    const size_t mark = arena->used;
    double *H = take(arena, n * n), *w = take(arena, n);
    for (int p = 0; p < n; ++p) {
        w[p] = 0.0;
        for (int q = 0; q <= p; ++q) H[p * n + q] = p == q ? by * by : 0.0;
    }
    for (int i = 0; i < m; ++i)
        for (int p = 0; p < n; ++p) {
            w[p] += A[i * n + p] * (e[i] / size);
            for (int q = 0; q <= p; ++q) H[p * n + q] += A[i * n + p] * A[i * n + q];
        }
    for (int i = 0; i < strict_rows; ++i)
        for (int p = 0; p < n; ++p)
            for (int q = 0; q <= p; ++q)
                H[p * n + q] += STRICT_WEIGHT * strict[i * n + p] * strict[i * n + q];
    cholesky(H, n);
    cholesky_solve(H, n, w, 1);
    for (int i = 0; i < n; ++i) {
        if (brakes->acceleration[i] < INFINITY)
            a = smaller(a, brakes->share * brakes->acceleration[i] / fabs(w[i]));
        if (brakes->jerk[i] < INFINITY) j = smaller(j, brakes->share * brakes->jerk[i] / fabs(w[i]));
    }
    arena->used = mark;
    const double share = stop_speed(size, a, j, T) / (gain * size);
    return share < 1.0 ? share : 1.0;
}
