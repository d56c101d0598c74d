#include "rows.h"

#include "dualquaternion.h"
#include "pose.h"
#include "quaternion.h"
#include "stopping.h"

#include <math.h>
#include <string.h>

/* tasks/roll.py, limits/trocar_cone.py, limits/spheres.py */
#define OPPOSITE 1e-12
#define CONE_CENTRE 1e-6
#define SPHERE_CENTRE 1e-9

#define PI 3.14159265358979323846

/* R a and R^T a of a rotation (3, 3) */
static void turned(const double *R, const double *a, double *out)
{
    for (int i = 0; i < 3; ++i, R += 3) out[i] = R[0] * a[0] + R[1] * a[1] + R[2] * a[2];
}

static void turned_back(const double *R, const double *a, double *out)
{
    for (int i = 0; i < 3; ++i) out[i] = R[i] * a[0] + R[3 + i] * a[1] + R[6 + i] * a[2];
}

/* Rotation (3, 3) and translation (3) of a unit dual quaternion. */
static void placement(const double *x, double *R, double *p)
{
    const double w = x[0], i = x[1], j = x[2], k = x[3];
    R[0] = w * w + i * i - j * j - k * k;
    R[4] = w * w - i * i + j * j - k * k;
    R[8] = w * w - i * i - j * j + k * k;
    R[1] = 2.0 * (i * j - w * k), R[2] = 2.0 * (i * k + w * j), R[5] = 2.0 * (j * k - w * i);
    R[3] = 2.0 * (i * j + w * k), R[6] = 2.0 * (i * k - w * j), R[7] = 2.0 * (j * k + w * i);
    dq_translation(x, p);
}

/* Fill in the placements, and the desired twist omega + eps nu = 2 x_d* x_d_dot. */
void see(Cycle *cycle)
{
    double primal[4], dual[4], a[4], b[4];
    placement(cycle->x, cycle->R, cycle->p);
    placement(cycle->x_d, cycle->R_d, cycle->p_d);
    q_conj(cycle->x_d, primal);
    q_conj(cycle->x_d + 4, dual);
    q_mul(primal, cycle->x_d_dot, a);
    for (int i = 0; i < 3; ++i) cycle->omega_d[i] = 2.0 * a[i + 1];
    q_mul(primal, cycle->x_d_dot + 4, a);
    q_mul(dual, cycle->x_d_dot, b);
    for (int i = 0; i < 3; ++i) cycle->nu_d[i] = 2.0 * (a[i + 1] + b[i + 1]);
}

/* Column j of the Jacobian: linear and angular part. */
static void column(const Cycle *cycle, int j, double *nu, double *omega)
{
    for (int i = 0; i < 3; ++i) {
        nu[i] = cycle->J[i * cycle->n + j];
        omega[i] = cycle->J[(3 + i) * cycle->n + j];
    }
}

/* A point of the world, seen from the effector. */
static void seen(const Cycle *cycle, const double *point, double *out)
{
    double apart[3];
    for (int i = 0; i < 3; ++i) apart[i] = point[i] - cycle->p[i];
    turned_back(cycle->R, apart, out);
}

/* Second derivative (2) of the trocar seen from the shaft, r, while the joints go on at v.
 *
 * In axes that go along with the shaft but do not spin about it: of a vector in the effector's
 * axes, d/dt changes by omega_z e_z x vector, and omega loses its z. */
static void bend(const Cycle *cycle, const double *r, double *out)
{
    double twist[6] = {0}, change[6] = {0}, nu[3], omega[3], a[3], b[3], carried[3], r_dot[3];
    for (int j = 0; j < cycle->n; ++j) { /* sum over i < j of the Lie brackets [J_i, J_j] v_i v_j */
        column(cycle, j, nu, omega);
        for (int i = 0; i < 3; ++i) nu[i] *= cycle->v[j], omega[i] *= cycle->v[j];
        cross(twist + 3, nu, a);
        cross(omega, twist, b);
        for (int i = 0; i < 3; ++i) change[i] += a[i] - b[i];
        cross(twist + 3, omega, a);
        for (int i = 0; i < 3; ++i)
            change[3 + i] += a[i], twist[i] += nu[i], twist[3 + i] += omega[i];
    }
    const double spin[3] = {0.0, 0.0, twist[5]};
    cross(spin, twist, a);
    cross(spin, twist + 3, b);
    for (int i = 0; i < 3; ++i) change[i] += a[i], change[3 + i] += b[i];
    twist[5] = change[5] = 0.0;
    turned_back(cycle->R, cycle->pivot_dot, carried);
    cross(r, twist + 3, a);
    for (int i = 0; i < 3; ++i) r_dot[i] = a[i] - twist[i] + carried[i];
    cross(r, change + 3, a);
    for (int i = 0; i < 3; ++i) r_dot[i] += carried[i];
    cross(r_dot, twist + 3, b);
    for (int i = 0; i < 2; ++i) out[i] = a[i] - change[i] + b[i];
}

static void rcm_rows(const Cycle *cycle, double period, double *A, double *b, double *e)
{
    const int n = cycle->n;
    double r[3], drift[3], nu[3], omega[3], second[2] = {0.0, 0.0};
    seen(cycle, cycle->pivot, r);
    turned_back(cycle->R, cycle->pivot_dot, drift);
    if (period > 0.0) bend(cycle, r, second);
    for (int i = 0; i < 2; ++i) e[i] = r[i], b[i] = -drift[i] - 0.5 * period * second[i];
    for (int j = 0; j < n; ++j) {
        column(cycle, j, nu, omega);
        A[j] = -r[2] * omega[1] - nu[0], A[n + j] = r[2] * omega[0] - nu[1];
    }
}

static void tip_rows(const Cycle *cycle, double depth, double *A, double *b, double *e)
{
    const int n = cycle->n;
    const double a[3] = {0.0, 0.0, depth};
    double own[3], other[3], speed[3], nu[3], omega[3], part[3];
    turned(cycle->R, a, own);
    turned(cycle->R_d, a, other);
    cross(cycle->omega_d, a, part);
    for (int i = 0; i < 3; ++i) part[i] += cycle->nu_d[i];
    turned(cycle->R_d, part, speed);
    for (int i = 0; i < 3; ++i)
        e[i] = cycle->p[i] - cycle->p_d[i] + own[i] - other[i], b[i] = speed[i];
    for (int j = 0; j < n; ++j) {
        column(cycle, j, nu, omega);
        cross(omega, a, part);
        for (int i = 0; i < 3; ++i) part[i] += nu[i];
        turned(cycle->R, part, speed);
        for (int i = 0; i < 3; ++i) A[i * n + j] = speed[i];
    }
}

static void roll_rows(const Cycle *cycle, double *A, double *b, double *e)
{
    double conj[4], s[4];
    q_conj(cycle->x_d, conj);
    q_mul(conj, cycle->x, s);
    if (s[0] < 0.0)
        for (int i = 0; i < 4; ++i) s[i] = -s[i];
    const double w = s[0], x = s[1], y = s[2], z = s[3], size = w * w + z * z;
    memset(A, 0, sizeof(double) * (size_t)cycle->n);
    b[0] = e[0] = 0.0;
    if (size < OPPOSITE) return;
    const double own[3] = {(x * z - w * y) / size, (w * x + y * z) / size, 1.0};
    const double other[3] = {(x * z + w * y) / size, (y * z - w * x) / size, 1.0};
    e[0] = 2.0 * atan2(z, w), b[0] = dot(other, cycle->omega_d, 3);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < cycle->n; ++j) A[j] += own[i] * cycle->J[(3 + i) * cycle->n + j];
}

static void pose_rows(const Cycle *cycle, double *A, double *b, double *e)
{
    double turn[8], turn_dot[8];
    see_turn(cycle->x, cycle->x_d, cycle->x_d_dot, turn, turn_dot);
    make_N(cycle->J, cycle->n, turn, A);
    for (int i = 0; i < 8 * cycle->n; ++i) A[i] = -A[i];
    for (int i = 0; i < 8; ++i) e[i] = (i == 0 ? 1.0 : 0.0) - turn[i], b[i] = turn_dot[i];
}

/* c = s4^2 (1 - c2^2 s3^2) (1 - c6^2 s5^2) (1 - c2^2 c6^2), and its gradient (7). */
double srs_product(const double *angles, const double *offsets, double *gradient)
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

/* m, the product of J's singular values, and dm/dq_k = m tr((dJ/dq_k) J^+); J (6, n), n >= 6.
 *
 * J = L Q^T gives m = |det L| and m J^+ = Q m L^-1, whose elements stay finite as J loses rank.
 * Where it has lost it, to rounding, the gradient is zero. */
double manipulability(const double *J, int n, double *gradient, Arena *arena)
{
    const size_t mark = arena->used;
    double *L = take(arena, 6 * n), *Q = take(arena, n * n), *inverse = take(arena, 36);
    double *B = take(arena, 6 * n), m = 1.0;
    int order[6];
    memset(gradient, 0, sizeof(double) * (size_t)n);
    if (factor(J, 6, n, 0.0, L, Q, order) < 6) {
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
    for (int k = 1; k < n; ++k)
        for (int i = 0; i < k; ++i) { /* dJ_i/dq_k = [J_i, J_k] for i < k */
            const double ni[3] = {J[i], J[n + i], J[2 * n + i]};
            const double wi[3] = {J[3 * n + i], J[4 * n + i], J[5 * n + i]};
            const double nk[3] = {J[k], J[n + k], J[2 * n + k]};
            const double wk[3] = {J[3 * n + k], J[4 * n + k], J[5 * n + k]};
            double a[3], b[3], c[3];
            cross(wi, nk, a);
            cross(wk, ni, b);
            cross(wi, wk, c);
            for (int r = 0; r < 3; ++r)
                gradient[k] += (a[r] - b[r]) * B[r * n + i] + c[r] * B[(3 + r) * n + i];
        }
    arena->used = mark;
    return m;
}

static void wanted_rows(int n, const double *wanted, double by, double *A, double *b)
{
    memset(A, 0, sizeof(double) * (size_t)(n * n));
    for (int i = 0; i < n; ++i) A[i * n + i] = 1.0, b[i] = by * wanted[i];
}

static void posture_rows(const Cycle *cycle, const double *vectors, double *A, double *b,
                         double *e)
{
    const int n = cycle->n;
    memset(A, 0, sizeof(double) * (size_t)(n * n));
    for (int i = 0; i < n; ++i) {
        double error = cycle->angles[i] - vectors[i];
        if (vectors[n + i] != 0.0)
            error -= 2.0 * PI * floor((error + PI) / (2.0 * PI));
        A[i * n + i] = 1.0, b[i] = 0.0, e[i] = error;
    }
}

int rows_of_task(const double *line, int n)
{
    switch ((TaskKind)line[0]) {
    case RCM: return 2;
    case TIP: return 3;
    case ROLL: return 1;
    case POSE: return 8;
    case SRS_PRODUCT: return n == 7 ? n : -1;
    case POSTURE: return n;
    case MANIPULABILITY: return n >= 6 ? n : -1;
    }
    return -1;
}

/* Whether the task reduces an error, at its gain. */
int has_error(const double *line)
{
    return line[0] != SRS_PRODUCT && line[0] != MANIPULABILITY;
}

/* Rows A v = b - gain e of one task, multiplied by the root of its weight; e is its error. */
void task_rows(const Cycle *cycle, const double *line, const double *vectors, double *A, double *b,
               double *e, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = cycle->n, rows = rows_of_task(line, n);
    const double root = line[1], first = line[2], second = line[3];
    double *gradient = take(arena, n), c;
    memset(e, 0, sizeof(double) * (size_t)rows);
    switch ((TaskKind)line[0]) {
    case RCM: rcm_rows(cycle, second, A, b, e); break;
    case TIP: tip_rows(cycle, second, A, b, e); break;
    case ROLL: roll_rows(cycle, A, b, e); break;
    case POSE: pose_rows(cycle, A, b, e); break;
    case POSTURE: posture_rows(cycle, vectors, A, b, e); break;
    case SRS_PRODUCT:
        c = srs_product(cycle->angles, vectors, gradient);
        wanted_rows(n, gradient, first * (second - c), A, b);
        break;
    case MANIPULABILITY:
        c = manipulability(cycle->J, n, gradient, arena);
        wanted_rows(n, gradient, first * (second - c), A, b);
        break;
    }
    if (root != 1.0) {
        for (int i = 0; i < rows * n; ++i) A[i] *= root;
        for (int i = 0; i < rows; ++i) b[i] *= root, e[i] *= root;
    }
    arena->used = mark;
}

/* limits/base.py: Damper.pace() */
static double pace(double gain, double A, double s)
{
    const double size = fabs(s);
    if (gain * gain * size <= A) return gain * s;
    return copysign(sqrt(2.0 * A * size - A / gain * (A / gain)), s);
}

/* limits/joints.py: JointLimits; line: kind, period */
static void joint_box(const Cycle *cycle, const double *line, double *lower, double *upper)
{
    const int n = cycle->n;
    for (int i = 0; i < n; ++i) {
        const double *limit = cycle->joints + i, q = cycle->angles[i];
        const Joint joint = {line[1],      limit[2 * n], limit[3 * n],
                             limit[4 * n], limit[5 * n], limit[6 * n]};
        const double below = q - limit[0], above = limit[n] - q;
        double low, up;
        joint_interval(&joint, cycle->v[i], cycle->a[i], below == below ? below : INFINITY,
                       above == above ? above : INFINITY, &low, &up);
        low = clipped(low, lower[i], upper[i]), up = clipped(up, lower[i], upper[i]);
        lower[i] = low, upper[i] = up;
    }
}

static void cone_row(const Cycle *cycle, const double *line, double *C, double *d)
{
    const int n = cycle->n;
    double axis[3], by[2];
    turned_back(cycle->R, line + 4, axis);
    const double sine = hypot(axis[0], axis[1]);
    by[0] = sine > CONE_CENTRE ? axis[1] / sine : axis[2] > 0.0 ? 0.0 : 1.0;
    by[1] = sine > CONE_CENTRE ? -axis[0] / sine : 0.0;
    for (int j = 0; j < n; ++j) C[j] = by[0] * cycle->J[3 * n + j] + by[1] * cycle->J[4 * n + j];
    d[0] = pace(line[1], line[2], line[3] - atan2(sine, axis[2]));
}

static void depth_row(const Cycle *cycle, const double *line, double *C, double *d)
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
    const double depth = line[3] - r[2];
    d[0] = pace(line[1], line[2], line[5] - depth) + drift[2];
    d[1] = pace(line[1], line[2], depth - line[4]) - drift[2];
}

static void keep_out_row(const Cycle *cycle, const double *line, double *C, double *d)
{
    double centre[3], velocity[3], b[3], u[3], drift[3], nu[3], omega[3], a[3];
    for (int i = 0; i < 3; ++i) {
        centre[i] = line[3 + i] + (line[9] != 0.0 ? cycle->pivot[i] : 0.0);
        velocity[i] = line[6 + i] + (line[9] != 0.0 ? cycle->pivot_dot[i] : 0.0);
    }
    seen(cycle, centre, b);
    turned_back(cycle->R, velocity, drift);
    const double s = smaller(larger(b[2], line[11]), line[12]);
    u[0] = b[0], u[1] = b[1], u[2] = b[2] - s;
    const double delta = sqrt(dot(u, u, 3));
    for (int i = 0; i < 3; ++i) u[i] = delta > SPHERE_CENTRE ? u[i] / delta : i == 0;
    for (int j = 0; j < cycle->n; ++j) {
        column(cycle, j, nu, omega);
        cross(b, omega, a);
        C[j] = -(u[0] * (a[0] - nu[0]) + u[1] * (a[1] - nu[1]) + u[2] * (a[2] - nu[2]));
    }
    d[0] = pace(line[1], line[2], delta - line[10]) + dot(u, drift, 3);
}

int rows_of_limit(const double *line)
{
    switch ((LimitKind)line[0]) {
    case JOINTS: return 0;
    case TROCAR_CONE: return 1;
    case TROCAR_DEPTH: return 2;
    case KEEP_OUT: return 1;
    }
    return -1;
}

/* Narrow the box (n) by one limit, or write its rows C v <= d. */
void limit_rows(const Cycle *cycle, const double *line, double *lower, double *upper, double *C,
                double *d)
{
    switch ((LimitKind)line[0]) {
    case JOINTS: joint_box(cycle, line, lower, upper); break;
    case TROCAR_CONE: cone_row(cycle, line, C, d); break;
    case TROCAR_DEPTH: depth_row(cycle, line, C, d); break;
    case KEEP_OUT: keep_out_row(cycle, line, C, d); break;
    }
}
