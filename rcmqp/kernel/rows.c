#include "rows.h"

#include "bend.h"
#include "dualquaternion.h"
#include "pose.h"
#include "quaternion.h"

#include <math.h>
#include <string.h>

/* tasks/roll.py: below this w^2 + z^2 the shafts point apart. */
#define OPPOSITE 1e-12

#define PI 3.14159265358979323846

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

/* Fill in the placements, the desired twist omega + eps nu = 2 x_d* x_d_dot, and the twist now. */
void see(Cycle *cycle)
{
    double primal[4], dual[4], a[4], b[4];
    placement(cycle->x, cycle->R, cycle->p);
    placement(cycle->x_d, cycle->R_d, cycle->p_d);
    if (cycle->x_t != NULL) placement(cycle->x_t, cycle->R_t, cycle->p_t);
    q_conj(cycle->x_d, primal);
    q_conj(cycle->x_d + 4, dual);
    q_mul(primal, cycle->x_d_dot, a);
    for (int i = 0; i < 3; ++i) cycle->omega_d[i] = 2.0 * a[i + 1];
    q_mul(primal, cycle->x_d_dot + 4, a);
    q_mul(dual, cycle->x_d_dot, b);
    for (int i = 0; i < 3; ++i) cycle->nu_d[i] = 2.0 * (a[i + 1] + b[i + 1]);
    see_twist(cycle);
}

static void rcm_rows(const Cycle *cycle, double period, double *A, double *b, double *e)
{
    const int n = cycle->n;
    double r[3], drift[3], nu[3], omega[3], rate[3], second[3] = {0.0, 0.0, 0.0};
    seen(cycle, cycle->pivot, r);
    turned_back(cycle->R, cycle->pivot_dot, drift);
    if (period > 0.0) bend(cycle, r, drift, rate, second);
    for (int i = 0; i < 2; ++i) e[i] = r[i], b[i] = -drift[i] - 0.5 * period * second[i];
    for (int j = 0; j < n; ++j) {
        column(cycle, j, nu, omega);
        A[j] = -r[2] * omega[1] - nu[0], A[n + j] = r[2] * omega[0] - nu[1];
    }
}

/* controllers/vfi_qp.py: the squared distance D of the shaft's line from the trocar, as the error
 * (D - reach^2) / (2 reach). */
static void entry_rows(const Cycle *cycle, double reach, double *A, double *b, double *e,
                       Arena *arena)
{
    const size_t mark = arena->used;
    const int n = cycle->n;
    double *rows = take(arena, 2 * n), rate[2], r[2];
    rcm_rows(cycle, 0.0, rows, rate, r);
    e[0] = 0.5 * (dot(r, r, 2) / reach - reach), b[0] = dot(r, rate, 2) / reach;
    for (int j = 0; j < n; ++j) A[j] = (r[0] * rows[j] + r[1] * rows[n + j]) / reach;
    arena->used = mark;
}

/* A point of the shaft, a (3) in the effector's axes: R a, and its Jacobian A (3, n). */
static void shaft_point(const Cycle *cycle, const double *a, double *own, double *A)
{
    const int n = cycle->n;
    double nu[3], omega[3], part[3], speed[3];
    turned(cycle->R, a, own);
    for (int j = 0; j < n; ++j) {
        column(cycle, j, nu, omega);
        cross(omega, a, part);
        for (int i = 0; i < 3; ++i) part[i] += nu[i];
        turned(cycle->R, part, speed);
        for (int i = 0; i < 3; ++i) A[i * n + j] = speed[i];
    }
}

/* controllers/aghakhani.py: the point of the shaft where the tip is said to be, at the trocar. */
static void at_trocar_rows(const Cycle *cycle, double *A, double *b, double *e)
{
    const double a[3] = {0.0, 0.0, cycle->tip};
    double own[3];
    shaft_point(cycle, a, own, A);
    for (int i = 0; i < 3; ++i)
        e[i] = cycle->p[i] + own[i] - cycle->pivot[i], b[i] = cycle->pivot_dot[i];
}

static void tip_rows(const Cycle *cycle, double *A, double *b, double *e)
{
    const int n = cycle->n;
    const double a[3] = {0.0, 0.0, cycle->tip};
    double own[3], other[3], speed[3], nu[3], omega[3], part[3];
    shaft_point(cycle, a, own, A);
    turned(cycle->R_d, a, other);
    cross(cycle->omega_d, a, part);
    for (int i = 0; i < 3; ++i) part[i] += cycle->nu_d[i];
    turned(cycle->R_d, part, speed);
    for (int i = 0; i < 3; ++i)
        e[i] = cycle->p[i] - cycle->p_d[i] + own[i] - other[i], b[i] = speed[i];
    for (int i = 0; cycle->x_t != NULL && i < 3; ++i)
        e[i] = cycle->p_t[i] - cycle->p_d[i] - other[i];
    for (int j = 0; cycle->x_t != NULL && j < n; ++j) {
        column_of(cycle->J_t, n, j, nu, omega);
        turned(cycle->R_t, nu, speed);
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

static void rotation_rows(const Cycle *cycle, double *A, double *b, double *e, Arena *arena)
{
    const size_t mark = arena->used;
    double *rows = take(arena, 8 * cycle->n), own[8], error[8];
    pose_rows(cycle, rows, own, error);
    memcpy(A, rows, sizeof(double) * (size_t)(4 * cycle->n));
    memcpy(b, own, 4 * sizeof(double));
    memcpy(e, error, 4 * sizeof(double));
    arena->used = mark;
}

/* tasks/orientation.py: with s = r_t r_h* = (w, u), of the signs the one with w >= 0, e = 2 u and
 * e' = (w I - [u]x) omega_t. */
static void orientation_rows(const Cycle *cycle, const double *held, double *A, double *b,
                             double *e)
{
    const int n = cycle->n, wrist = cycle->x_t != NULL;
    const double *R = wrist ? cycle->R_t : cycle->R, *J = wrist ? cycle->J_t : cycle->J;
    double conj[4], s[4], nu[3], omega[3], turning[3], part[3];
    q_conj(held, conj);
    q_mul(wrist ? cycle->x_t : cycle->x, conj, s);
    if (s[0] < 0.0)
        for (int i = 0; i < 4; ++i) s[i] = -s[i];
    for (int i = 0; i < 3; ++i) e[i] = 2.0 * s[i + 1], b[i] = 0.0;
    for (int j = 0; j < n; ++j) {
        column_of(J, n, j, nu, omega);
        turned(R, omega, turning);
        cross(turning, s + 1, part);
        for (int i = 0; i < 3; ++i) A[i * n + j] = s[0] * turning[i] + part[i];
    }
}

/* The insertion depth: minus the third row of the trocar as the effector sees it. */
static void depth_rows(const Cycle *cycle, double *A, double *b, double *e)
{
    double r[3], apart[3], r_d[3], carried[3], carried_d[3], nu[3], omega[3], part[3];
    seen(cycle, cycle->pivot, r);
    for (int i = 0; i < 3; ++i) apart[i] = cycle->pivot[i] - cycle->p_d[i];
    turned_back(cycle->R_d, apart, r_d);
    turned_back(cycle->R, cycle->pivot_dot, carried);
    turned_back(cycle->R_d, cycle->pivot_dot, carried_d);
    cross(r_d, cycle->omega_d, part);
    e[0] = r_d[2] - r[2], b[0] = carried[2] - carried_d[2] + cycle->nu_d[2] - part[2];
    for (int j = 0; j < cycle->n; ++j) {
        column(cycle, j, nu, omega);
        cross(r, omega, part);
        A[j] = nu[2] - part[2];
    }
}

/* The desired shaft seen from the effector, u = R^T z_d, of which x and y are to vanish. */
static void direction_rows(const Cycle *cycle, double *A, double *b, double *e)
{
    const int n = cycle->n;
    const double turn[3] = {cycle->omega_d[1], -cycle->omega_d[0], 0.0}; /* omega_d x e_z */
    const double z_d[3] = {cycle->R_d[2], cycle->R_d[5], cycle->R_d[8]};
    double u[3], apart[3], drift[3], nu[3], omega[3];
    turned_back(cycle->R, z_d, u);
    turned(cycle->R_d, turn, apart);
    turned_back(cycle->R, apart, drift);
    for (int i = 0; i < 2; ++i) e[i] = u[i], b[i] = -drift[i];
    for (int j = 0; j < n; ++j) {
        column(cycle, j, nu, omega);
        A[j] = u[1] * omega[2] - u[2] * omega[1], A[n + j] = u[2] * omega[0] - u[0] * omega[2];
    }
}

/* The joint velocity itself, which is to be zero. */
static void still_rows(int n, double *A, double *b, double *e)
{
    memset(A, 0, sizeof(double) * (size_t)(n * n));
    for (int i = 0; i < n; ++i) A[i * n + i] = 1.0, b[i] = e[i] = 0.0;
}

static void posture_rows(const Cycle *cycle, const Block *block, double *A, double *b, double *e)
{
    const int n = cycle->n;
    still_rows(n, A, b, e);
    for (int i = 0; i < n; ++i) {
        double error = cycle->angles[i] - block->vectors[i];
        if (block->vectors[n + i] != 0.0)
            error -= 2.0 * PI * floor((error + PI) / (2.0 * PI));
        e[i] = error;
    }
}

/* The joint velocity K_c (c_d - c) J_c is wanted, whatever the error. */
static void objective_rows(const Cycle *cycle, const Block *block, double *A, double *b, double *e,
                           Arena *arena)
{
    const int n = cycle->n;
    const double c = objective_value(block->objective, cycle->J, cycle->angles, n, b, arena);
    memset(A, 0, sizeof(double) * (size_t)(n * n));
    for (int i = 0; i < n; ++i)
        A[i * n + i] = 1.0, e[i] = 0.0, b[i] = block->K_c * (block->c_d - c) * b[i];
}

/* How many rows a block has for an arm of n joints; -1 where it is for another. */
int rows_of(const Block *block, int n)
{
    if ((block->n != 0 && block->n != n) || block->bends > n) return -1;
    const int tip_only = block->first == block->last;
    switch (block->kind) {
    case RCM: case DIRECTION: return 2;
    case TROCAR_DEPTH: return 2 + pieces_of(block);
    case TIP: case AT_TROCAR: case ORIENTATION: return 3;
    case ROTATION: return 4;
    case POSE: return 8;
    case STILL: case POSTURE: case OBJECTIVE: return n;
    case KEEP_OUT: return tip_only ? 1 : 1 + pieces_of(block);
    case KEEP_IN: return tip_only ? 1 : 2 + pieces_of(block);
    case TROCAR_CONE: return block->deceleration < INFINITY ? 1 + CONE_SIDES : 1;
    case ENTRY: case DEPTH: case ROLL: case TROCAR_SPEED: case ENTRY_SPHERE: return 1;
    default: return 0;
    }
}

/* Rows A v = b - gain e of one task; e is its error, -b what it changes by while joints rest. */
void task_rows(const Cycle *cycle, const Block *block, double *A, double *b, double *e,
               Arena *arena)
{
    switch (block->kind) {
    case RCM: rcm_rows(cycle, block->period, A, b, e); break;
    case TIP: tip_rows(cycle, A, b, e); break;
    case AT_TROCAR: at_trocar_rows(cycle, A, b, e); break;
    case DEPTH: depth_rows(cycle, A, b, e); break;
    case ROLL: roll_rows(cycle, A, b, e); break;
    case DIRECTION: direction_rows(cycle, A, b, e); break;
    case POSE: pose_rows(cycle, A, b, e); break;
    case ENTRY: entry_rows(cycle, block->reach, A, b, e, arena); break;
    case ROTATION: rotation_rows(cycle, A, b, e, arena); break;
    case ORIENTATION: orientation_rows(cycle, block->orientation, A, b, e); break;
    case STILL: still_rows(cycle->n, A, b, e); break;
    case POSTURE: posture_rows(cycle, block, A, b, e); break;
    case OBJECTIVE: objective_rows(cycle, block, A, b, e, arena); break;
    default: break;
    }
}
