#include "manipulability.h"

#include "quaternion.h"
#include "svd.h"

#include <math.h>
#include <string.h>

#define RCM_ROWS 2

/* Below this share of the largest, a singular value is taken for this when J^+ shows the way. */
#define SINGULAR 1e-12

/* Where one singular value is zero, its row of G has no direction: make it a unit vector that is
 * orthogonal to the other rows, and its value 1. Returns its index, or -1; -2 where more are zero. */
static int complete(Svd *svd, int m, Arena *arena)
{
    const size_t mark = arena->used;
    double *L = take(arena, svd->r * m), *Q = take(arena, m * m);
    int *order = (int *)take(arena, svd->r), lost = -1;
    for (int i = 0; i < svd->r; ++i)
        if (svd->s[i] == 0.0) lost = lost == -1 ? i : -2;
    if (lost >= 0) {
        const int rank = factor(svd->G, svd->r, m, 0.0, L, Q, order, arena);
        for (int k = 0; k < m; ++k) svd->G[lost * m + k] = Q[k * m + rank];
    }
    arena->used = mark;
    return lost;
}

/* The gradient (n) of m = prod s by the joints, where W (SHAFT_ROWS, n) is its gradient by J:
 *
 *     dm/dq_k = sum_i W_i . dJ_i/dq_k.
 *
 * With w_r (z zero) and w_t the parts of W_i for the RCM and for the tip in the effector's axes,
 * r the trocar and a the tip in them, and S = diag(1, 1, 0), which takes the spin out,
 *
 *     W_i . dJ_i/dq_k = w_r . (r_k' x S omega_i) + (w_t - w_r) . nu_ik
 *                       + (S (w_r x r) + a x w_t) . omega_ik,   r_k' = r x omega_k - nu_k,
 *
 * and (nu_ik, omega_ik) = [J_i, J_k] = (omega_i x nu_k - omega_k x nu_i, omega_i x omega_k) for
 * i < k, else zero. Sums over i < k go along with k. */
static void slope(const Cycle *cycle, const double *W, double *gradient)
{
    const int n = cycle->n;
    const double a[3] = {0.0, 0.0, cycle->tip};
    double r[3], turning[3] = {0.0}, by_nu[3] = {0.0}, by_omega[3] = {0.0};
    double nu[3], omega[3], part[3];
    seen(cycle, cycle->pivot, r);
    for (int i = 0; i < n; ++i) {
        const double w_r[3] = {W[i], W[n + i], 0.0};
        column(cycle, i, nu, omega);
        omega[2] = 0.0;
        add_cross(omega, w_r, turning);
    }
    for (int k = 0; k < n; ++k) {
        const double w_r[3] = {W[k], W[n + k], 0.0};
        const double w_world[3] = {W[2 * n + k], W[3 * n + k], W[4 * n + k]};
        double w_t[3], on_nu[3], on_omega[3], r_dot[3];
        column(cycle, k, nu, omega);
        cross(r, omega, r_dot);
        for (int p = 0; p < 3; ++p) r_dot[p] -= nu[p];
        gradient[k] = dot(r_dot, turning, 3) + dot(nu, by_nu, 3) + dot(omega, by_omega, 3);

        turned_back(cycle->R, w_world, w_t);
        cross(w_r, r, on_omega);
        cross(a, w_t, part);
        for (int p = 0; p < 3; ++p) {
            on_nu[p] = w_t[p] - w_r[p];
            on_omega[p] = part[p] + (p < 2 ? on_omega[p] : 0.0);
        }
        add_cross(on_nu, omega, by_nu);
        add_cross(on_omega, omega, by_omega);
        add_cross(on_nu, nu, by_omega);
    }
}

size_t memory_for_manipulability(int n)
{
    return (size_t)(n * n + 25 * n + 8 * RANK * RANK) + memory_for_objective(n);
}

/* m = sqrt(det J J^T), J (SHAFT_ROWS, n) the rows of RcmTask and of TipTask, and
 * g (SHAFT_ROWS) = J^(+T) grad m, so that m' = g . J v; see controllers/task_priority.py.
 *
 * The gradient is built without dividing by m, so it is right at a singularity, too, where J^+ is
 * not: there the direction that J has lost is what g points along. */
double shaft_manipulability(const Cycle *cycle, double *g, Arena *arena)
{
    const int n = cycle->n, m = SHAFT_ROWS;
    const Block rcm = {.kind = RCM}, tip = {.kind = TIP};
    double *J = take(arena, m * n), *W = take(arena, m * n), *V = take(arena, RANK * n);
    double *gradient = take(arena, n), b[3], e[3], measure = 1.0, largest = 0.0;
    double others[RANK];
    Svd svd;
    task_rows(cycle, &rcm, J, b, e, arena);
    task_rows(cycle, &tip, J + RCM_ROWS * n, b, e, arena);
    decompose(J, m, n, 1, &svd, arena);
    for (int i = 0; i < svd.r; ++i) {
        others[i] = 1.0, measure *= svd.s[i], largest = larger(largest, svd.s[i]);
        for (int j = 0; j < svd.r; ++j) others[i] *= j == i ? 1.0 : svd.s[j];
    }
    memset(W, 0, sizeof(double) * (size_t)(m * n));
    memset(g, 0, sizeof(double) * (size_t)m);
    const int lost = complete(&svd, m, arena);
    if (lost == -2) return measure;
    for (int i = 0; i < svd.r; ++i) { /* a row of G is s times the left vector */
        const double size = i == lost ? 1.0 : svd.s[i];
        for (int j = 0; j < n; ++j) V[i * n + j] = dot(svd.Q + j * n, svd.W + i * svd.r, svd.r);
        for (int p = 0; p < m; ++p) {
            svd.G[i * m + p] /= size;
            add_to(W + p * n, others[i] * svd.G[i * m + p], V + i * n, n);
        }
    }
    slope(cycle, W, gradient);
    for (int i = 0; i < svd.r; ++i)
        add_to(g, dot(V + i * n, gradient, n) / larger(svd.s[i], SINGULAR * largest),
               svd.G + i * m, m);
    return measure;
}
