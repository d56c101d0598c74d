#include "rows.h"

#include "quaternion.h"
#include "svd.h"

#include <math.h>
#include <string.h>

/* c = s4^2 (1 - c2^2 s3^2) (1 - c6^2 s5^2) (1 - c2^2 c6^2), and its gradient (7). */
static double srs_product(const double *angles, const double *offsets, double *gradient)
{
    double t[7];
    for (int i = 0; i < 7; ++i) t[i] = angles[i] + offsets[i];
    const double s3 = sin(t[2]), s4 = sin(t[3]), s5 = sin(t[4]), c2 = cos(t[1]), c6 = cos(t[5]);
    const double elbow = s4 * s4, both = 1.0 - c2 * c6 * (c2 * c6);
    const double shoulder = 1.0 - c2 * s3 * (c2 * s3), wrist = 1.0 - c6 * s5 * (c6 * s5);
    gradient[0] = gradient[6] = 0.0;
    gradient[1] = elbow * wrist * sin(2.0 * t[1]) * (s3 * s3 * both + shoulder * c6 * c6);
    gradient[2] = -elbow * wrist * both * c2 * c2 * sin(2.0 * t[2]);
    gradient[3] = shoulder * wrist * both * sin(2.0 * t[3]);
    gradient[4] = -elbow * shoulder * both * c6 * c6 * sin(2.0 * t[4]);
    gradient[5] = elbow * shoulder * sin(2.0 * t[5]) * (s5 * s5 * both + wrist * c2 * c2);
    return elbow * shoulder * wrist * both;
}

/* gradient[k] += sum_i B[:, i] . dJ[:, i]/dq_k, with B (6, n) and dJ_i/dq_k = [J_i, J_k], i < k: the
 * sums over i < k go along with k, as in manipulability.c. */
static void along_brackets(const double *J, int n, const double *B, double *gradient)
{
    double by_nu[3] = {0.0}, by_omega[3] = {0.0}, nu[3], omega[3], b[3], c[3];
    for (int k = 0; k < n; ++k) {
        column_of(J, n, k, nu, omega);
        column_of(B, n, k, b, c);
        gradient[k] += dot(nu, by_nu, 3) + dot(omega, by_omega, 3);
        add_cross(b, omega, by_nu);
        add_cross(b, nu, by_omega);
        add_cross(c, omega, by_omega);
    }
}

/* Add by u v^T to B (6, n), of the singular vectors of the i-th value; none where it is zero. */
static void add_vectors(const Svd *svd, int i, int n, double by, double *B)
{
    if (!(svd->s[i] > 0.0)) return;
    for (int j = 0; j < n; ++j) {
        const double v = dot(svd->Q + j * n, svd->W + i * svd->r, svd->r);
        for (int k = 0; k < 6; ++k) B[k * n + j] += by * svd->G[i * 6 + k] / svd->s[i] * v;
    }
}

/* The same for fewer joints than six, by J's singular vectors. */
static double manipulability_of_few(const double *J, int n, double *gradient, Arena *arena)
{
    const size_t mark = arena->used;
    double *B = take(arena, 6 * n), m = 1.0;
    Svd svd;
    memset(B, 0, sizeof(double) * (size_t)(6 * n));
    decompose(J, 6, n, 1, &svd, arena);
    for (int i = 0; i < svd.r; ++i) {
        double others = 1.0;
        for (int j = 0; j < svd.r; ++j) others *= j == i ? 1.0 : svd.s[j];
        add_vectors(&svd, i, n, others, B);
        m *= svd.s[i];
    }
    along_brackets(J, n, B, gradient);
    arena->used = mark;
    return m;
}

/* J's least singular value, and its gradient u^T (dJ/dq_k) v. */
static double least_value(const double *J, int n, double *gradient, Arena *arena)
{
    const size_t mark = arena->used;
    double *B = take(arena, 6 * n);
    int least = 0;
    Svd svd;
    memset(B, 0, sizeof(double) * (size_t)(6 * n));
    decompose(J, 6, n, 1, &svd, arena);
    for (int i = 1; i < svd.r; ++i)
        if (svd.s[i] < svd.s[least]) least = i;
    add_vectors(&svd, least, n, 1.0, B);
    along_brackets(J, n, B, gradient);
    arena->used = mark;
    return svd.s[least];
}

/* 1 - mean(((q - middle) / half range)^2) over the joints that have a range. */
static double centring(const double *angles, const double *middle, const double *half, int n,
                       double *gradient)
{
    double total = 0.0;
    int count = 0;
    for (int i = 0; i < n; ++i) count += half[i] < INFINITY;
    for (int i = 0; i < n; ++i) {
        const double offset = (angles[i] - middle[i]) / half[i];
        total += offset * offset;
        gradient[i] = -2.0 * offset / (half[i] * count);
    }
    return 1.0 - total / count;
}

/* m, the product of J's singular values, and dm/dq_k = m tr((dJ/dq_k) J^+); J (6, n).
 *
 * J = L Q^T gives m = |det L| and m J^+ = Q m L^-1, whose elements stay finite as J loses rank.
 * Where it has lost it, to rounding, the gradient is zero. */
static double manipulability(const double *J, int n, double *gradient, Arena *arena)
{
    const size_t mark = arena->used;
    double *L = take(arena, 6 * n), *Q = take(arena, n * n), *inverse = take(arena, 36);
    double *B = take(arena, 6 * n), m = 1.0;
    int order[6];
    if (n < RANK) {
        arena->used = mark;
        return manipulability_of_few(J, n, gradient, arena);
    }
    if (factor(J, 6, n, 0.0, L, Q, order, arena) < 6) {
        arena->used = mark;
        return 0.0;
    }
    for (int i = 0; i < 6; ++i) m *= fabs(L[i * n + i]);
    for (int c = 0; c < 6; ++c) /* forward substitution; the part above the diagonal is unused */
        for (int i = c; i < 6; ++i) {
            double total = i == c ? 1.0 : 0.0;
            for (int p = c; p < i; ++p) total -= L[i * n + p] * inverse[p * 6 + c];
            inverse[i * 6 + c] = total / L[i * n + i];
        }
    for (int c = 0; c < 6; ++c) /* B = (m J^+)^T: row order[c] of B is column c of Q m L^-1 */
        for (int j = 0; j < n; ++j) {
            double total = 0.0;
            for (int p = c; p < 6; ++p) total += Q[j * n + p] * inverse[p * 6 + c];
            B[order[c] * n + j] = m * total;
        }
    along_brackets(J, n, B, gradient);
    arena->used = mark;
    return m;
}

size_t memory_for_objective(int n) { return (size_t)(n * n + 24 * n + 2 * RANK * RANK + 24); }

/* Value of an objective that fits an arm of n joints, and its gradient (n). */
double objective_value(const Block *block, const double *J, const double *angles, int n,
                       double *gradient, Arena *arena)
{
    memset(gradient, 0, sizeof(double) * (size_t)n);
    switch (block->kind) {
    case SINGULARITY_PRODUCT: return srs_product(angles, block->vectors, gradient);
    case MANIPULABILITY: return manipulability(J, n, gradient, arena);
    case LEAST_SINGULAR_VALUE: return least_value(J, n, gradient, arena);
    case JOINT_CENTRING:
        return centring(angles, block->vectors, block->vectors + n, n, gradient);
    default: return 0.0;
    }
}
