#include "approach.h"

#include "stopping.h"

#include <string.h>

/* Below this, a vector is rounding and has no direction [unit of the rows]. */
#define NO_SIZE 1e-13

/* Damping of the joints' part in a strict task, whose own is zero [unit of the rows]. */
#define STRICT_DAMPING 1e-3

/* Weight of the rows above against those of the task. */
#define ABOVE_WEIGHT 1e3

/* Share of the jerk that is counted on to stop an error. */
#define EASING 0.5

/* An error of a strict task up to this, or up to what the jerk can follow, is reduced at once
 * [unit of the rows]; one of twice as much is approached like that of a damped task. */
#define AT_ONCE 1e-4

/* Room for rounding in what the joints can do at least. */
#define LESS 0.999

/* What gives the joints' part in a direction: `least`, what they can do along any, is at hand. What
 * they can do along one is found where it decides something. With B (k, n) the rows above, heavy,
 * then the task's, and s^2 the square of the damping, K is the factor of s^2 I + B B^T (k, k) or, where
 * that is smaller, of s^2 I + B^T B (n, n). Where A is c times one, its rows are not in B, but c^2 in
 * s^2, for that is what A^T A comes to. */
typedef struct {
    const Brakes *brakes;
    const Approached *task;
    Ability least;
    int k, made;
    double square, each;
    double *K, *w, *z; /* (k, k) or (n, n); (n); (k) */
} Joints;

static double size_of_vector(const double *x, int m) { return sqrt(dot(x, x, m)); }

/* |w_j| is at most 1 / (2 damping) below, as damping^2 |w|^2 <= |A w| - |A w|^2; where A is c times
 * one, at most c / s^2. */
static Joints make_joints(const Brakes *brakes, const Approached *task, Arena *arena)
{
    const double damping = task->damping > 0.0 ? task->damping : STRICT_DAMPING;
    const double each = task->above_rows < brakes->n ? task->each : 0.0;
    const double square = damping * damping + each * each;
    const double by = LESS * (each > 0.0 ? square / each : 2.0 * damping);
    const Ability least = {by * brakes->least.acceleration, by * brakes->least.jerk};
    const int n = brakes->n, k = task->above_rows + (each > 0.0 ? 0 : task->m);
    const int size = k < n ? k : n;
    return (Joints){brakes, task, least, k, 0, square, each, take(arena, size * size),
                    take(arena, n), take(arena, k)};
}

/* Row i of B without its weight, and that. */
static const double *row_of(const Joints *joints, int i, double *weight)
{
    const Approached *task = joints->task;
    const int n = joints->brakes->n, above = task->above_rows;
    *weight = i < above ? sqrt(ABOVE_WEIGHT) : 1.0;
    return i < above ? task->above + i * n : task->A + (i - above) * n;
}

static void factor_joints(Joints *joints)
{
    const int n = joints->brakes->n, k = joints->k, size = k < n ? k : n;
    double *K = joints->K, by, other;
    memset(K, 0, sizeof(double) * (size_t)(size * size));
    for (int i = 0; i < k; ++i) {
        const double *row = row_of(joints, i, &by);
        if (k < n) {
            for (int j = 0; j <= i; ++j) {
                const double *before = row_of(joints, j, &other);
                K[i * k + j] = by * other * dot(row, before, n);
            }
        } else {
            for (int p = 0; p < n; ++p) {
                const double part = by * by * row[p];
                if (part != 0.0) add_to(K + p * n, part, row, p + 1);
            }
        }
    }
    for (int i = 0; i < size; ++i) K[i * size + i] += joints->square;
    cholesky(K, size);
    joints->made = 1;
}

/* min_j limit_j / |w_j| of acceleration and jerk, with w = [above; A]^+ [0; x / |x|], damped:
 * w = B^T (s^2 I + B B^T)^-1 [0; x / |x|] = (s^2 I + B^T B)^-1 B^T [0; x / |x|]; or, where A is c times
 * one, c (s^2 I + B^T B)^-1 x / |x| = c / s^2 (1 - B^T (s^2 I + B B^T)^-1 B) x / |x|. */
static Ability ability(Joints *joints, const double *x, double size)
{
    const Brakes *brakes = joints->brakes;
    const int n = brakes->n, k = joints->k, above = joints->task->above_rows;
    double *w = joints->w, *z = joints->z, by;
    Ability found = {INFINITY, INFINITY};
    if (!joints->made) factor_joints(joints);
    for (int i = 0; i < k; ++i) {
        const double *row = row_of(joints, i, &by);
        z[i] = (joints->each > 0.0 ? by * dot(row, x, n) : i < above ? 0.0 : x[i - above]) / size;
    }
    if (k < n) cholesky_solve(joints->K, k, z);
    memset(w, 0, sizeof(double) * (size_t)n);
    for (int i = k < n ? 0 : above; i < k; ++i) {
        const double *row = row_of(joints, i, &by);
        add_to(w, by * z[i], row, n);
    }
    if (k >= n) cholesky_solve(joints->K, n, w);
    for (int p = 0; p < n; ++p) {
        if (joints->each > 0.0) w[p] = (x[p] / size - w[p]) * joints->each / joints->square;
        const double part = fabs(w[p]);
        found.acceleration = smaller(found.acceleration, brakes->acceleration[p] / part);
        found.jerk = smaller(found.jerk, brakes->jerk[p] / part);
    }
    return found;
}

/* Speed from which a stop with limited acceleration and jerk ends after `distance`.
 *
 * From acceleration zero a stop goes v sqrt(v / j) where the acceleration's limit A is not met,
 * up to v = A^2 / j, and v (v / A + A / j) / 2 beyond. The two are solved for v, and the way of
 * two cycles, for the command that has to come first, is taken off. */
static double stop_speed(double distance, double acceleration, double jerk, double period)
{
    const double A = acceleration, ramp = A / jerk; /* zero without a limit on jerk */
    double v;
    if (ramp * ramp * A < distance) /* a stop from v = A ramp takes A ramp^2 */
        v = 2.0 * distance / (0.5 * ramp + sqrt(0.25 * ramp * ramp + 2.0 * distance / A));
    else
        v = cbrt(distance * distance * jerk);
    return v / (1.0 + 2.0 * period * v / distance);
}

/* The speed over the distance, from which joints of some ability can stop. */
static double stop_rate(const Brakes *brakes, Ability can, double distance)
{
    const double A = brakes->share * can.acceleration, jerk = EASING * can.jerk;
    if (!(A < INFINITY || jerk < INFINITY)) return INFINITY;
    return stop_speed(distance, A, jerk, brakes->period) / distance;
}

/* The wanted rate -phi e (m) of an error e. */
static void wanted_rate(Joints *joints, const double *e, double *rate)
{
    const Approached *task = joints->task;
    const double d = size_of_vector(e, task->m);
    double phi = task->gain;
    if (d > NO_SIZE && stop_rate(joints->brakes, joints->least, d) < phi)
        phi = smaller(phi, stop_rate(joints->brakes, ability(joints, e, d), d));
    for (int i = 0; i < task->m; ++i) rate[i] = -phi * e[i];
}

/* How much of a gap may be made up for in a cycle. */
static double largest_change(double gap, double jerk, double T)
{
    return jerk < INFINITY ? T * braking_speed(gap, jerk, T) : gap;
}

/* What d(error)/dt a task may ask for, rate (m).
 *
 * It wants -phi e, with phi the gain, or less where the joints could not stop the error at zero:
 * |phi e| is at most the speed from which a stop ends after |e|, at the share of their acceleration
 * that is counted on and EASING of their jerk.
 *
 * Where jerk is limited, the rate itself has to be approached, or it would overshoot in its turn:
 * it changes by the joints' acceleration, and that by their jerk. The change of the wanted rate
 * along the error's own motion is known and added. What is then left between the wanted rate and
 * the one now, A v' - carried, is made up for no faster than at the acceleration that can be eased
 * off by the time the rate is there: braking_speed(). Where the acceleration that the joints have
 * now leads to the wanted rate, as in following a curve, nothing is left to make up for, and the
 * wanted rate is asked for as it is. A strict task may not lag: small errors of it are reduced at
 * once.
 *
 * What the joints can do along a direction n is min_j limit_j / |w_j|, w their part in it. All of it
 * is continuous in the state. Without limits the rate is -gain e. */
void approach_rate(const Brakes *brakes, const Approached *task, double *rate, Arena *arena)
{
    const int n = brakes->n, m = task->m;
    const double T = brakes->period, K = task->gain, d = size_of_vector(task->e, m);
    const int limited = brakes->least.acceleration < INFINITY || brakes->least.jerk < INFINITY;
    if (!limited || !(brakes->share > 0.0)) {
        for (int i = 0; i < m; ++i) rate[i] = -K * task->e[i];
        return;
    }
    const size_t mark = arena->used;
    double *now = take(arena, m), *next = take(arena, m), *later = take(arena, m);
    double *left = take(arena, m), *kept = take(arena, m);
    Joints joints = make_joints(brakes, task, arena);
    wanted_rate(&joints, task->e, rate);
    for (int i = 0; i < m; ++i) {
        now[i] = dot(task->A + i * n, brakes->v, n) - task->carried[i];
        next[i] = task->e[i] + T * now[i];
    }
    wanted_rate(&joints, next, later);
    for (int i = 0; i < m; ++i) {
        later[i] += now[i] - rate[i]; /* the rate now, with the change of the wanted one */
        left[i] = rate[i] - later[i];
    }
    const double gap = size_of_vector(left, m);
    if (gap > NO_SIZE && largest_change(gap, joints.least.jerk, T) < gap) {
        const double jerk = ability(&joints, left, gap).jerk, most = largest_change(gap, jerk, T);
        for (int i = 0; i < m; ++i)
            kept[i] = rate[i] - now[i] - T * dot(task->A + i * n, brakes->a, n);
        double at_once = clipped(2.0 - size_of_vector(kept, m) / (jerk * T * T), 0.0, 1.0);
        if (!(task->damping > 0.0)) {
            const double small = smaller(AT_ONCE, 0.25 * jerk / (K * K * K));
            at_once = larger(at_once, clipped(2.0 - d / small, 0.0, 1.0));
        }
        for (int i = 0; i < m && most < gap; ++i)
            rate[i] = later[i] + left[i] * (at_once + (1.0 - at_once) * (most / gap));
    }
    arena->used = mark;
}
