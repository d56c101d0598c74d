#include "law.h"

#include "pose.h"
#include "svd.h"

#include <math.h>

/* lambda^2 of the variable damping at N's least singular value; see DualQuaternion.damping. */
static double damped(const double *numbers, double least)
{
    const double share = least / numbers[DAMPING_FROM];
    if (!(numbers[DAMPING] > 0.0) || share >= 1.0) return 0.0;
    return numbers[DAMPING] * numbers[DAMPING] * (1.0 - share * share);
}

/* Bring v (n) within the limits, in place; the share kept of it. */
static double keep_limits(const Law *law, double *v)
{
    double excess = 0.0;
    for (int j = 0; j < law->n; ++j) excess = larger(excess, fabs(v[j]) / law->limits[j]);
    if (law->limited == NONE || excess <= 1.0) return 1.0;
    for (int j = 0; j < law->n; ++j) {
        const double wished = law->limited == SCALE ? v[j] / excess : v[j], limit = law->limits[j];
        v[j] = wished < -limit ? -limit : wished > limit ? limit : wished;
    }
    return 1.0 / excess;
}

size_t memory_for_law(int n) { return (size_t)(18 * n + n * n + 8 * RANK + RANK * RANK + 8); }

/* v (n) = K N^+ e + P K_c J_c^T (c_d - c), P = I - N^+ N: equations (4) and (6).
 *
 * With N = U S V^T and V^T = W Q^T, and v_0 what is wanted in the null space,
 *
 *     v = v_0 + Q W^T (S^+ U^T wanted - W Q^T v_0),
 *
 * of which the first part has the directions that N^+ keeps, the second all that are real. */
void follow(const Law *law, const Sight *sight, double *v, Found *found, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = law->n;
    const double *numbers = law->numbers;
    double turn[8], fed[8], wanted[8], seen[RANK] = {0.0}, answer[RANK] = {0.0};
    double *N = take(arena, 8 * n);
    Svd svd;
    see_turn(sight->x, sight->x_d, sight->x_d_dot, turn, fed);
    for (int i = 0; i < 8; ++i) {
        wanted[i] = numbers[K] * ((i == 0 ? 1.0 : 0.0) - turn[i]);
        if (law->feed_forward) wanted[i] -= fed[i];
    }
    make_N(sight->J, n, turn, N);
    decompose(N, 8, n, 1, &svd, arena);
    double largest = svd.s[0], least = svd.s[0];
    for (int i = 1; i < RANK; ++i)
        largest = larger(largest, svd.s[i]), least = smaller(least, svd.s[i]);
    const double lambda_2 = damped(numbers, least);

    for (int j = 0; j < n; ++j) {
        v[j] = numbers[K_C] * (numbers[C_D] - sight->c) * sight->J_c[j];
        for (int k = 0; k < RANK; ++k) seen[k] += svd.Q[j * n + k] * v[j];
    }
    found->least = least, found->kept = 0.0;
    for (int i = 0; i < RANK; ++i) {
        const double *w = svd.W + i * RANK, s = svd.s[i];
        double along = 0.0;
        if (s > numbers[TOLERANCE] * largest) { /* a row of G is s times the left vector */
            along = dot(svd.G + i * 8, wanted, 8) / (s * s + lambda_2);
            found->kept += 1.0;
        }
        if (s > numbers[RANK_TOLERANCE] * largest) along -= dot(w, seen, RANK);
        for (int k = 0; k < RANK; ++k) answer[k] += w[k] * along;
    }
    for (int j = 0; j < n; ++j) v[j] += dot(svd.Q + j * n, answer, RANK);
    found->scale = keep_limits(law, v);
    arena->used = mark;
}
