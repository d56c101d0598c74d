#include "rows.h"

#include "bend.h"
#include "quaternion.h"
#include "stopping.h"

#include <math.h>
#include <string.h>

#define CONE_CENTRE 1e-6
#define SPHERE_CENTRE 1e-9

/* Sine of the lean beyond which a side has no row. */
#define SIDE_ON 0.99

/* What goes about the axis asks for so many decelerations at the most, see away(). */
#define MOST_AWAY 4.0

#define PI 3.14159265358979323846

/* A larger bend comes of absurd numbers, and is not counted [m/s^2 or rad/s^2]. */
#define MOST_BENT 1e6

/* Share of the joints' acceleration below which the way of the shaft has no bend. */
#define NOT_BENT 1e-9

/* How fast s may shrink, at a gain and with a deceleration; limits/base.py: Damper. */
double pace(double gain, double deceleration, double s)
{
    const double A = deceleration, size = fabs(s);
    if (gain * gain * size <= A) return gain * s;
    return copysign(sqrt(2.0 * A * size - A / gain * (A / gain)), s);
}

/* stopping_speed() or what is quicker. */
typedef double (*StoppingSpeed)(double, double, double, double, double, double, double);

/* d of a row C v <= d, which lets s shrink by C v - drift: at its pace, or, where jerk is limited,
 * as fast as a stop from now on lets it, if that is less. While the joints go on at v, s shrinks by
 * `bent` more a second. */
static double paced(const Cycle *cycle, const Block *block, const double *C, double s, double drift,
                    double bent, StoppingSpeed stopping)
{
    const double most = pace(block->gain, block->deceleration, s), T = block->period;
    if (!(block->jerk < INFINITY)) return most + drift;
    if (!(fabs(bent) < MOST_BENT)) bent = 0.0;
    const double now = dot(C, cycle->v, cycle->n) - drift;
    const double change = dot(C, cycle->a, cycle->n) + bent;
    return drift - T * bent +
           stopping(now, change, s, most, block->deceleration, block->jerk, T);
}

/* limits/joints.py: JointLimits. An angle that is NaN has no position limits. */
static void joint_box(const Cycle *cycle, const Block *block, double *lower, double *upper)
{
    const int n = cycle->n;
    for (int i = 0; i < n; ++i) {
        const double *limit = block->vectors + i, q = cycle->angles[i];
        const Joint joint = {block->period,         limit[SPEED * n],   limit[ACCELERATION * n],
                             limit[JERK * n],       limit[BRAKING * n], limit[EASING * n]};
        const double below = q - limit[LOWEST * n], above = limit[HIGHEST * n] - q;
        double low, up;
        joint_interval(&joint, cycle->v[i], cycle->a[i], below == below ? below : INFINITY,
                       above == above ? above : INFINITY, &low, &up);
        low = clipped(low, lower[i], upper[i]), up = clipped(up, lower[i], upper[i]);
        lower[i] = low, upper[i] = up;
    }
}

/* What going about a centre at a speed, at a distance from it, makes the distance grow faster by: near
 * the centre, where it is soon over, no more than so many times what a stop counts on. */
static double away(double speed, double distance, const Block *block)
{
    if (!(distance > 0.0)) return 0.0;
    return smaller(speed * speed / distance, MOST_AWAY * block->deceleration);
}

/* The joints' part in turning the shaft about `by` (2). */
static void turning_row(const Cycle *cycle, const double *by, double *C)
{
    const int n = cycle->n;
    for (int j = 0; j < n; ++j) C[j] = by[0] * cycle->J[3 * n + j] + by[1] * cycle->J[4 * n + j];
}

/* Some unit vector (3) that is square to an axis (3). */
static void square_to(const double *axis, double *out)
{
    double unit[3] = {0.0, 0.0, 0.0};
    int least = 0;
    for (int i = 1; i < 3; ++i) least = fabs(axis[i]) < fabs(axis[least]) ? i : least;
    unit[least] = 1.0;
    cross(axis, unit, out);
    const double size = sqrt(dot(out, out, 3));
    for (int i = 0; i < 3; ++i) out[i] /= size;
}

/* One row that keeps the shaft from leaning over to a side (3), square to the cone's axis, by its angle
 * to the plane of the sides. */
static void side_row(const Cycle *cycle, const Block *block, const double *side, double *C, double *d)
{
    double own[3];
    turned_back(cycle->R, side, own);
    if (!(fabs(own[2]) < SIDE_ON)) return;
    const double width = sqrt(1.0 - own[2] * own[2]), by[2] = {-own[1] / width, own[0] / width};
    const double *turning = cycle->twist + 3, past = by[0] * turning[1] - by[1] * turning[0];
    turning_row(cycle, by, C);
    d[0] = paced(cycle, block, C, block->half_angle - asin(own[2]), 0.0,
                 dot(by, cycle->twist_dot + 3, 2) - past * past * own[2] / width,
                 about_stopping_speed);
}

/* The row of the angle from the cone's axis; and where a stop takes time those of its sides, for the
 * shaft may come over the axis, too fast to be stopped on the other side. */
static void cone_rows(const Cycle *cycle, const Block *block, double *C, double *d)
{
    const int n = cycle->n, count = rows_of(block, n);
    const double *turning = cycle->twist + 3;
    double axis[3], by[2], side[3], next[3];
    turned_back(cycle->R, block->axis, axis);
    const double sine = hypot(axis[0], axis[1]), lean = atan2(sine, axis[2]);
    by[0] = sine > CONE_CENTRE ? axis[1] / sine : axis[2] > 0.0 ? 0.0 : 1.0;
    by[1] = sine > CONE_CENTRE ? -axis[0] / sine : 0.0;
    turning_row(cycle, by, C);
    const double more = away(by[0] * turning[1] - by[1] * turning[0], tan(lean), block);
    d[0] = paced(cycle, block, C, block->half_angle - lean, 0.0,
                 dot(by, cycle->twist_dot + 3, 2) + more, stopping_speed);
    for (int k = 1; k < count; ++k) d[k] = 1.0;
    memset(C + n, 0, sizeof(double) * (size_t)((count - 1) * n));
    const int over_axis = axis[2] > 0.0 && block->half_angle < 0.5 * PI;
    square_to(block->axis, side);
    for (int k = 1; k < count && over_axis; ++k) {
        side_row(cycle, block, side, C + k * n, d + k);
        cross(block->axis, side, next); /* turned on by 60 degrees */
        for (int i = 0; i < 3; ++i) side[i] = 0.5 * side[i] + 0.5 * sqrt(3.0) * next[i];
    }
    for (int i = 0; i < count * n; ++i) C[i] *= block->lever;
    for (int k = 0; k < count; ++k) d[k] *= block->lever;
}

/* limits/instrument.py: TrocarSpeed. The row is in m/s: what a cycle of it may cost the RCM. */
static void speed_row(const Cycle *cycle, const Block *block, double *C, double *d, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = cycle->n;
    double *rows = take(arena, 2 * n), *by_v = take(arena, 2 * n), r[3], carried[3], rate[3];
    double bent[3], nu[3], omega[3], S[3] = {0.0, 0.0, 0.0}, det = 0.0;
    seen(cycle, cycle->pivot, r);
    turned_back(cycle->R, cycle->pivot_dot, carried);
    bend(cycle, r, carried, rate, bent);
    bend_by_v(cycle, r, carried, rate, by_v);
    for (int j = 0; j < n; ++j) {
        column(cycle, j, nu, omega);
        rows[j] = block->vectors[j] * (-r[2] * omega[1] - nu[0]);
        rows[n + j] = block->vectors[j] * (r[2] * omega[0] - nu[1]);
    }
    for (int i = 0; i < 2; ++i)
        for (int j = i; j < 2; ++j) S[i + j] = dot(rows + i * n, rows + j * n, n);
    for (int i = 0; i < n; ++i) /* S[0] S[2] - S[1]^2 without cancellation (Cauchy and Binet) */
        for (int j = 0; j < i; ++j) {
            const double minor = rows[i] * rows[n + j] - rows[j] * rows[n + i];
            det += minor * minor;
        }
    const double z[2] = {(S[2] * bent[0] - S[1] * bent[1]) / det,
                         (S[0] * bent[1] - S[1] * bent[0]) / det};
    const double needed = sqrt(larger(dot(z, bent, 2), 0.0)), size = hypot(bent[0], bent[1]);
    const double by = block->period * size / needed;
    for (int j = 0; j < n; ++j) C[j] = by * (z[0] * by_v[j] + z[1] * by_v[n + j]) / needed;
    d[0] = dot(C, cycle->v, n) + by * block->gain * block->period * (block->share - needed);
    if (!(needed > NOT_BENT && are_finite(C, n) && are_finite(d, 1))) {
        memset(C, 0, sizeof(double) * (size_t)n);
        d[0] = 1.0;
    }
    arena->used = mark;
}

/* Places of an instrument, seen from the effector: the end of the shaft, the joints of a wrist after
 * the first, which is there, and the tip. Place k is moved by the first k joints of the wrist. */
typedef struct {
    int bends;
    double place[MOST_BENDS + 1][3], axis[MOST_BENDS][3];
} Chain;

/* Rotate R (3, 3) by an angle about a unit vector of its own axes. */
static void turn_by(double *R, const double *axis, double angle)
{
    const double c = cos(angle), s = sin(angle);
    for (int i = 0; i < 3; ++i, R += 3) {
        double aside[3];
        cross(R, axis, aside);
        const double along = dot(R, axis, 3);
        for (int j = 0; j < 3; ++j) R[j] = c * R[j] + s * aside[j] + (1.0 - c) * along * axis[j];
    }
}

static void see_chain(const Cycle *cycle, const Block *block, Chain *chain)
{
    double R[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
    const int m = chain->bends = (int)block->bends;
    chain->place[0][0] = chain->place[0][1] = 0.0, chain->place[0][2] = cycle->tip + block->last;
    for (int k = 0; k < m; ++k) {
        const double *joint = block->wrist + BEND_NUMBERS * k;
        turned(R, joint, chain->axis[k]);
        turn_by(R, joint, cycle->angles[cycle->n - m + k]);
        for (int i = 0; i < 3; ++i)
            chain->place[k + 1][i] = chain->place[k][i] + joint[3] * R[3 * i + 2];
    }
}

/* How far the place k + 1 is from the place k. */
static double length_of(const Block *block, int k) { return block->wrist[BEND_NUMBERS * k + 3]; }

/* Rigid pieces beyond the shaft. */
int pieces_of(const Block *block)
{
    int count = 0;
    for (int k = 0; k < (int)block->bends; ++k) count += length_of(block, k) > 0.0;
    return count;
}

/* Add to a row, per joint velocity, how its first `moved` joints move a point (3) along u. */
static void add_wrist(const Cycle *cycle, const Chain *chain, const double *point, int moved,
                      const double *u, double *C)
{
    for (int k = 0; k < moved; ++k) {
        double lever[3], speed[3];
        for (int i = 0; i < 3; ++i) lever[i] = point[i] - chain->place[k][i];
        cross(chain->axis[k], lever, speed);
        C[cycle->n - chain->bends + k] += dot(u, speed, 3);
    }
}

/* One row that keeps place k from being too deep; or, with the side -1, too shallow. */
static void depth_row(const Cycle *cycle, const Block *block, const Chain *chain, int k,
                      double side, double *C, double *d)
{
    const double way[3] = {0.0, 0.0, side};
    double r[3], drift[3], rate[3], bent[3], nu[3], omega[3], a[3];
    seen(cycle, cycle->pivot, r);
    turned_back(cycle->R, cycle->pivot_dot, drift);
    bend(cycle, r, drift, rate, bent);
    for (int j = 0; j < cycle->n; ++j) {
        column(cycle, j, nu, omega);
        cross(r, omega, a);
        C[j] = side * (nu[2] - a[2]);
    }
    add_wrist(cycle, chain, chain->place[k], k, way, C);
    const double depth = chain->place[k][2] - r[2];
    const double room = side > 0.0 ? block->deepest - depth : depth - block->shallowest;
    d[0] = paced(cycle, block, C, room, side * drift[2], -side * bent[2],
                 stopping_speed);
}

/* The tip's two; then where each piece of a wrist begins, which a bent one has deeper. */
static void depth_rows(const Cycle *cycle, const Block *block, double *C, double *d)
{
    Chain chain;
    see_chain(cycle, block, &chain);
    depth_row(cycle, block, &chain, chain.bends, 1.0, C, d);
    depth_row(cycle, block, &chain, chain.bends, -1.0, C += cycle->n, ++d);
    for (int k = 0; k < chain.bends; ++k)
        if (length_of(block, k) > 0.0)
            depth_row(cycle, block, &chain, k, 1.0, C += cycle->n, ++d);
}

/* A sphere's centre b (3) and its velocity (3), seen from the effector; limits/instrument.py. */
static void see_sphere(const Cycle *cycle, const Block *block, double *b, double *drift)
{
    double centre[3], velocity[3];
    for (int i = 0; i < 3; ++i) {
        centre[i] = block->centre[i] + (block->on_trocar != 0.0 ? cycle->pivot[i] : 0.0);
        velocity[i] = block->velocity[i] + (block->on_trocar != 0.0 ? cycle->pivot_dot[i] : 0.0);
    }
    seen(cycle, centre, b);
    turned_back(cycle->R, velocity, drift);
}

/* A sphere and an instrument, seen from the effector: the centre b and its velocity. */
typedef struct {
    const Cycle *cycle;
    const Block *block;
    Chain chain;
    double b[3], drift[3], side; /* 1: away from the centre; -1: towards it */
    double rate[3], bent[3];     /* of b */
} Sight;

/* One row for a point that the first `moved` joints of the wrist move; `slides` where it is the one
 * of the shaft that is nearest.
 * At the centre the side 1 has a way out, along x, and the side -1 a row of zeros. */
static void sphere_row(const Sight *sight, const double *point, int moved, int slides, double *C,
                       double *d)
{
    const Cycle *cycle = sight->cycle;
    const double *b = sight->b, side = sight->side;
    double u[3] = {b[0] - point[0], b[1] - point[1], b[2] - point[2]}, nu[3], omega[3], a[3];
    const double delta = sqrt(dot(u, u, 3));
    for (int i = 0; i < 3; ++i)
        u[i] = delta > SPHERE_CENTRE ? u[i] / delta : i == 0 && side > 0.0;
    for (int j = 0; j < cycle->n; ++j) {
        column(cycle, j, nu, omega);
        cross(b, omega, a);
        C[j] = -side * (u[0] * (a[0] - nu[0]) + u[1] * (a[1] - nu[1]) + u[2] * (a[2] - nu[2]));
    }
    const double way[3] = {side * u[0], side * u[1], side * u[2]};
    add_wrist(cycle, &sight->chain, point, moved, way, C);
    const double *rate = sight->rate, *bent = sight->bent, nearing = dot(u, rate, 3);
    const int seen_in = slides ? 2 : 3; /* along the shaft the point slides and comes no nearer */
    const double about = sqrt(larger(0.0, dot(rate, rate, seen_in) - nearing * nearing));
    /* to go about the centre leads away from it, which ends when the shaft slows down */
    const double more = side > 0.0 ? 0.0 : away(about, delta, sight->block);
    d[0] = paced(cycle, sight->block, C, side * (delta - sight->block->reach),
                 side * dot(u, sight->drift, 3), -side * (dot(u, bent, 3) + more), stopping_speed);
}

/* The row of the nearest point of the shaft. */
static void shaft_row(const Sight *sight, double *C, double *d)
{
    const double first = sight->cycle->tip + sight->block->first, *last = sight->chain.place[0];
    const double nearest[3] = {0.0, 0.0, smaller(larger(sight->b[2], first), last[2])};
    sphere_row(sight, nearest, 0, nearest[2] == sight->b[2], C, d);
}

/* And of the nearest point of the piece from place k to the next. */
static void piece_row(const Sight *sight, int k, double *C, double *d)
{
    const double *from = sight->chain.place[k], *to = sight->chain.place[k + 1];
    double way[3], apart[3], nearest[3];
    for (int i = 0; i < 3; ++i) way[i] = to[i] - from[i], apart[i] = sight->b[i] - from[i];
    const double share = clipped(dot(apart, way, 3) / dot(way, way, 3), 0.0, 1.0);
    for (int i = 0; i < 3; ++i) nearest[i] = from[i] + share * way[i];
    sphere_row(sight, nearest, k + 1, 0, C, d);
}

static void sphere_rows(const Cycle *cycle, const Block *block, double *C, double *d)
{
    Sight sight = {.cycle = cycle, .block = block, .side = block->kind == KEEP_OUT ? 1.0 : -1.0};
    see_sphere(cycle, block, sight.b, sight.drift);
    bend(cycle, sight.b, sight.drift, sight.rate, sight.bent);
    see_chain(cycle, block, &sight.chain);
    const int m = sight.chain.bends, n = cycle->n, tip_only = block->first == block->last;
    const double mount[3] = {0.0, 0.0, cycle->tip + block->first};
    if (block->kind == ENTRY_SPHERE) {
        shaft_row(&sight, C, d);
        return;
    }
    if (tip_only || block->kind == KEEP_IN) sphere_row(&sight, sight.chain.place[m], m, 0, C, d);
    else shaft_row(&sight, C, d);
    for (int k = 0; k < m && !tip_only; ++k) {
        if (!(length_of(block, k) > 0.0)) continue;
        C += n, ++d;
        if (block->kind == KEEP_IN) sphere_row(&sight, sight.chain.place[k], k, 0, C, d);
        else piece_row(&sight, k, C, d);
    }
    if (block->kind == KEEP_IN && !tip_only) sphere_row(&sight, mount, 0, 0, C + n, d + 1);
}

/* Narrow the box (n) by one limit, or write its rows C v <= d. */
void limit_rows(const Cycle *cycle, const Block *block, double *lower, double *upper, double *C,
                double *d, Arena *arena)
{
    switch (block->kind) {
    case JOINTS: joint_box(cycle, block, lower, upper); break;
    case TROCAR_CONE: cone_rows(cycle, block, C, d); break;
    case TROCAR_SPEED: speed_row(cycle, block, C, d, arena); break;
    case TROCAR_DEPTH: depth_rows(cycle, block, C, d); break;
    case KEEP_OUT: case KEEP_IN: case ENTRY_SPHERE: sphere_rows(cycle, block, C, d); break;
    default: break;
    }
}
