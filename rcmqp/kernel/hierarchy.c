#include "hierarchy.h"

#include <math.h>
#include <string.h>

/* A level is reached if its residual is below this, relative to the level's numbers; a damped one,
 * if it is below this share of its damping [rad/s]. */
#define REACHED_TOL 1e-9
#define REACHED_SPEED 0.01

/* Damping of hard rows and guarded levels that cannot be reached: it grows with what is left, half
 * of the first at the second [unit of the rows per unit of v, unit of the rows per second]. */
#define UNREACHED_DAMPING 0.01
#define UNREACHED 1e-3

/* A bound this near counts as active, relative to its size where that is above one. */
#define TOUCHING_TOL 1e-9

/* Closed forms may exceed a bound by this, relative to its size, before v is clipped into it. */
#define CLIPPED 1e-12

/* A damped level starts from half of the closed form's v where that is so far out of the box
 * [rad/s]. */
#define FAR_OUT 0.01

/* A strict level below damped ones asks for half as much when so much is missing of these, over
 * their damping [rad/s]. */
#define GIVES_WAY 0.003

/* Where bounds keep a damped level from its aim by more than the first of these, over its damping,
 * speed costs it more, twice as much by the second more; and the damped levels below it that are
 * kept from theirs, too, aim at less, see cascade.h [rad/s]. */
#define KEPT_FROM 5e-5
#define HELD_BACK 0.006

/* A level whose KKT residual is above this is not called exact. */
#define EXACT 1e-8

/* What the descent works on, in units of `unit`, a power of two in which the largest bound is
 * about 1, so that tolerances fit any box. */
struct Descent {
    State state;
    BoundRows bound_rows;
    double unit;
    double *A;    /* (rows, n) without entries below the resolution, which decide nothing */
    double *goal; /* (rows) b */
    double *Zs;   /* (levels + 1, n, n) what was free before each level */
    int *frees;   /* (levels + 1) how many rows of each count */
    double *vs;   /* (levels + 1, n) the optimum of each level; v in the end is that of the last */
    double *speeds; /* (levels + 1, n, n) L of a damped level's speed, see cascade.h */
    int *helds;   /* (levels + 1) rows of damped levels before each level */
    double *damping; /* (levels + 1) of each level as it was solved */
    double *stills;  /* (levels + 1, n) where a damped level's speed counts from, times its rows */
    double *aim;     /* (rows) A v of the closed form's v, for damped levels inside bounds; b else */
    double *open;    /* (n) v of the closed form */
    double *offsets; /* (levels + 1, n) what the levels below changed in the closed form */
    int *doubts;     /* (levels + 1) 1 where a step before the last is not proved */
};

/* Numbers of scratch memory that solve_hierarchy() never exceeds, with a Solution and account(). */
size_t memory_for(int n, int m, int rows, int levels)
{
    const size_t unknowns = (size_t)n + 8, all = unknowns + (size_t)m + (size_t)rows + 8;
    const size_t levels_more = (size_t)levels + 8;
    return 64 * all * unknowns + 12 * all * all +
           levels_more * (4 * unknowns * unknowns + all) + 4096;
}

static int first_row(const Hierarchy *hierarchy, int k)
{
    return k > 1 ? (int)hierarchy->ends[k - 2] : 0;
}

static int rows_of(const Hierarchy *hierarchy, int k)
{
    return (int)hierarchy->ends[k - 1] - first_row(hierarchy, k);
}

/* Scale the problem; start in the box, as near to zero as may be. */
static Descent scaled(const Hierarchy *hierarchy, double *v, Arena *arena)
{
    const int n = hierarchy->n, N = n + hierarchy->m, levels = hierarchy->levels;
    const int rows = (int)hierarchy->ends[levels - 1];
    Descent made = {{n, N, 0, v, take(arena, n * n), take(arena, N * n), take(arena, N),
                     take(arena, N), take(arena, N), 0, take(arena, rows * n), take(arena, rows),
                     take(arena, rows), NULL, NULL},
                    {-1, take(arena, n * n), take(arena, N * n), take(arena, N)},
                    1.0, take(arena, rows * n), take(arena, rows), take(arena, (levels + 1) * n * n),
                    (int *)take(arena, levels + 1), take(arena, (levels + 1) * n),
                    take(arena, (levels + 1) * n * n), (int *)take(arena, levels + 1),
                    take(arena, levels + 1), take(arena, (levels + 1) * n), take(arena, rows),
                    take(arena, n), take(arena, (levels + 1) * n), (int *)take(arena, levels + 1)};
    State *state = &made.state;
    double largest = 0.0;
    made.damping[0] = 0.0;
    memcpy(made.damping + 1, hierarchy->damping, sizeof(double) * (size_t)levels);
    for (int i = 0; i < n; ++i) {
        const double low = fabs(hierarchy->lower[i]), up = fabs(hierarchy->upper[i]);
        if (low < INFINITY) largest = larger(largest, low);
        if (up < INFINITY) largest = larger(largest, up);
    }
    if (largest > 1e-100 && largest < 1e100) made.unit = exp2(rint(log2(largest)));
    memset(state->G, 0, sizeof(double) * (size_t)(n * n));
    memset(state->Z, 0, sizeof(double) * (size_t)(n * n));
    for (int i = 0; i < n; ++i) {
        double low = hierarchy->lower[i] / made.unit, up = hierarchy->upper[i] / made.unit;
        if (low > up) low = up = 0.5 * low + 0.5 * up;
        state->lower[i] = low, state->upper[i] = up;
        state->norms[i] = state->G[i * n + i] = 1.0;
        if (low < up) state->Z[state->free++ * n + i] = 1.0;
        if (hierarchy->max_rounds == 0)
            v[i] /= made.unit;
        else
            v[i] = smaller(larger(0.0, low), up);
    }
    for (int i = 0; i < hierarchy->m; ++i) {
        const double norm = norm_of(hierarchy->C + i * n, n), by = norm > 0.0 ? norm : 1.0;
        for (int j = 0; j < n; ++j) state->G[(n + i) * n + j] = hierarchy->C[i * n + j] / by;
        state->norms[n + i] = norm, state->lower[n + i] = -INFINITY;
        state->upper[n + i] = hierarchy->d[i] / made.unit / by;
    }
    for (int i = 0; i < rows; ++i) made.aim[i] = made.goal[i] = hierarchy->b[i] / made.unit;
    for (int k = 0; k <= levels; ++k) made.doubts[k] = 0;
    memset(made.stills, 0, sizeof(double) * (size_t)((levels + 1) * n));
    for (int i = 0; i < rows * n; ++i)
        made.A[i] = fabs(hierarchy->A[i]) < RESOLUTION ? 0.0 : hierarchy->A[i];
    return made;
}

/* What is known before level k. */
static void begin_level(Descent *descent, const State *state, int k)
{
    const int square = state->n * state->n;
    descent->frees[k] = state->free, descent->helds[k] = state->held;
    memcpy(descent->Zs + k * square, state->Z, sizeof(double) * (size_t)square);
    memset(descent->speeds + k * square, 0, sizeof(double) * (size_t)square);
}

/* And after it. */
static void end_level(Descent *descent, const State *state, int k)
{
    memcpy(descent->vs + k * state->n, state->v, sizeof(double) * (size_t)state->n);
}

static Level level_of(const Hierarchy *hierarchy, const Descent *descent, const double *b, int k)
{
    const int first = first_row(hierarchy, k);
    return (Level){rows_of(hierarchy, k), descent->A + first * hierarchy->n, b + first,
                   descent->damping[k], descent->damping[k], NULL, k == hierarchy->levels};
}

/* By how much v exceeds the hard rows, in the caller's unit. */
static double excess_of(const Descent *descent, const double *upper)
{
    const State *state = &descent->state;
    double total = 0.0;
    for (int i = state->n; i < state->N; ++i) {
        const double Gv = bounded(state, state->v, i);
        const double over = state->norms[i] * larger(Gv - upper[i], 0.0) * descent->unit;
        total += over * over;
    }
    return sqrt(total);
}

/* Damping of what cannot be reached: it grows with what is left, so that it begins at none. */
static double unreached_damping(double left)
{
    return UNREACHED_DAMPING * left / (left + UNREACHED);
}

/* How far A v is from b. */
static double missing(const Level *level, const double *v, int n)
{
    double total = 0.0;
    for (int i = 0; i < level->m; ++i) {
        const double part = level->b[i] - dot(level->A + i * n, v, n);
        total += part * part;
    }
    return sqrt(total);
}

/* How far v is from what the damped levels above level k ask for in `asked`, over their damping. */
static double unserved(const Hierarchy *hierarchy, const Descent *descent, const double *asked,
                       const double *v, int k)
{
    double total = 0.0;
    for (int j = hierarchy->guarded + 1; j < k; ++j) {
        if (!(descent->damping[j] > 0.0)) continue;
        const Level above = level_of(hierarchy, descent, asked, j);
        const double speed = missing(&above, v, hierarchy->n) / above.damping;
        total += speed * speed;
    }
    return sqrt(total) * descent->unit;
}

/* The wish of a strict level below damped ones, less where v does not serve these. */
static void give_way(const Hierarchy *hierarchy, Descent *descent, const double *v, int k)
{
    const int first = first_row(hierarchy, k), rows = rows_of(hierarchy, k);
    if (k <= hierarchy->guarded || descent->damping[k] > 0.0) return;
    const double share =
        1.0 / (1.0 + unserved(hierarchy, descent, descent->goal, v, k) / GIVES_WAY);
    for (int i = first; i < first + rows; ++i) descent->aim[i] = share * descent->goal[i];
}

/* Whether a level is guarded, and so damped where so much of it is left. */
static int unreached(const Hierarchy *hierarchy, const Level *level, int k, double left)
{
    return k <= hierarchy->guarded && level->damping == 0.0 && left > REACHED_TOL &&
           left < LARGEST;
}

/* All levels in closed form, as if there were no bounds. Returns 1 where v keeps them all;
 * otherwise v is where it leads, brought into the box. */
static int closed_form(const Hierarchy *hierarchy, Descent *descent, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = hierarchy->n, N = descent->state.N, square = n * n;
    double *start = take(arena, n), *before = take(arena, n), *none = take(arena, N);
    State open = descent->state;
    const Ways ways = {1, NULL, NULL, 0};
    int fits = 1, rounds = 0, doubt = 0;
    memcpy(start, open.v, sizeof(double) * (size_t)n);
    open.N = 0, open.free = n, open.Z = take(arena, square); /* no bounds */
    memset(open.Z, 0, sizeof(double) * (size_t)square);
    for (int i = 0; i < n; ++i) open.Z[i * n + i] = 1.0;
    for (int k = 0; k <= hierarchy->levels && fits; ++k) {
        begin_level(descent, &open, k);
        if (k > 0) {
            double *speed = descent->speeds + k * square, *still = descent->stills + k * n;
            memcpy(before, open.v, sizeof(double) * (size_t)n);
            give_way(hierarchy, descent, open.v, k);
            Level level = level_of(hierarchy, descent, descent->aim, k);
            Route route = descend(&open, &level, &ways, 1, none, speed, still, none, &rounds,
                                  &doubt, arena);
            const double left =
                k > hierarchy->guarded ? 0.0 : missing(&level, open.v, n) * descent->unit;
            if (route == CLOSED_FORM && unreached(hierarchy, &level, k, left)) {
                level.damping = descent->damping[k] = unreached_damping(left);
                open.free = descent->frees[k];
                memcpy(open.v, before, sizeof(double) * (size_t)n);
                memcpy(open.Z, descent->Zs + k * square, sizeof(double) * (size_t)square);
                route = descend(&open, &level, &ways, 1, none, speed, still, none, &rounds, &doubt,
                                arena);
                keep_exactly(&open, &level, descent->helds[k], arena);
            }
            fits = route == CLOSED_FORM || route == KEPT;
        }
        end_level(descent, &open, k);
    }
    for (int i = 0; i < n; ++i) fits = fits && fabs(open.v[i]) < LARGEST;
    memset(descent->offsets, 0, sizeof(double) * (size_t)((hierarchy->levels + 1) * n));
    memcpy(descent->open, fits ? open.v : start, sizeof(double) * (size_t)n);
    for (int k = 1; k <= hierarchy->levels && fits; ++k)
        for (int i = 0; i < n; ++i)
            descent->offsets[k * n + i] = descent->vs[k * n + i] - open.v[i];
    if (!fits) {
        memcpy(open.v, start, sizeof(double) * (size_t)n);
        arena->used = mark;
        return 0;
    }
    for (int i = 0; i < N; ++i) {
        const double Gv = bounded(&open, open.v, i), room = CLIPPED * larger(1.0, fabs(Gv));
        if (!(Gv <= open.upper[i] + room && Gv >= open.lower[i] - room)) fits = 0;
    }
    for (int i = 0; i < n; ++i)
        open.v[i] = smaller(larger(open.v[i], open.lower[i]), open.upper[i]);
    if (fits)
        descent->state.held = open.held;
    else /* inside the bounds, guarded levels are tried as they are */
        memcpy(descent->damping + 1, hierarchy->damping,
               sizeof(double) * (size_t)hierarchy->levels);
    for (int i = n; i < N && !fits; ++i) /* out of the hard rows is no good place to start */
        if (bounded(&open, open.v, i) > open.upper[i]) {
            memcpy(open.v, start, sizeof(double) * (size_t)n);
            break;
        }
    arena->used = mark;
    return fits;
}

/* Back to where level k began. */
static void go_back(Descent *descent, const double *before, int k)
{
    State *state = &descent->state;
    const int n = state->n;
    state->free = descent->frees[k], state->held = descent->helds[k];
    memcpy(state->v, before, sizeof(double) * (size_t)n);
    memcpy(state->Z, descent->Zs + k * n * n, sizeof(double) * (size_t)(n * n));
}

static int is_finite(const State *state)
{
    return are_finite(state->v, state->n) && are_finite(state->Z, state->free * state->n);
}

/* What the levels one by one work with. */
typedef struct {
    const Hierarchy *hierarchy;
    Descent *descent;
    Solution *solution;
    Proposer propose;
    void *backend;
    double *before;   /* (n) v as the level began */
    double *sets;     /* (SETS, N) active sets of the level, see hierarchy.h */
} Work;

static double *multipliers_of(const Work *work, int k)
{
    return work->solution->multipliers + k * work->descent->state.N;
}

/* The hard rows. */
static Route serve_rows(Work *work, const double *asked, int *rounds, Arena *arena)
{
    Descent *descent = work->descent;
    State *state = &descent->state;
    double *multipliers = multipliers_of(work, 0);
    const int most = work->hierarchy->max_rounds;
    const Route route = satisfy_rows(state, 0.0, most, descent->speeds, descent->stills,
                                     multipliers, rounds, arena);
    const double left = excess_of(descent, asked);
    if (!(work->hierarchy->guarded > 0 && left > REACHED_TOL && left < LARGEST)) return route;
    descent->damping[0] = unreached_damping(left);
    go_back(descent, work->before, 0);
    memcpy(state->upper, asked, sizeof(double) * (size_t)state->N);
    memset(multipliers, 0, sizeof(double) * (size_t)state->N);
    return satisfy_rows(state, descent->damping[0], most, descent->speeds, descent->stills,
                        multipliers, rounds, arena);
}

/* Level k in `steps`, with its active sets from `first` on, see descend(); a backend is asked where
 * the work has one, and `asks`. */
static Route serve(Work *work, const Level *level, int k, int steps, int first, int asks, int *rounds,
                   Arena *arena)
{
    Descent *descent = work->descent;
    const int square = descent->state.n * descent->state.n, N = descent->state.N;
    const Ways ways = {work->hierarchy->max_rounds, asks ? work->propose : NULL, work->backend, k};
    return descend(&descent->state, level, &ways, steps, work->sets + first * N,
                   descent->speeds + k * square, descent->stills + k * descent->state.n,
                   multipliers_of(work, k), rounds, &descent->doubts[k], arena);
}

/* A strict level; a guarded one that cannot be reached is damped. */
static Route serve_strict(Work *work, int k, int *rounds, Arena *arena)
{
    Descent *descent = work->descent;
    State *state = &descent->state;
    const int n = state->n, N = state->N;
    double *at = take(arena, n);
    for (int i = 0; i < n; ++i) at[i] = state->v[i] + descent->offsets[(k - 1) * n + i];
    give_way(work->hierarchy, descent, at, k);
    Level level = level_of(work->hierarchy, descent, descent->aim, k);
    const Route route = serve(work, &level, k, 1, 0, 1, rounds, arena);
    const double left = missing(&level, state->v, n) * descent->unit;
    if (route >= KEPT || !unreached(work->hierarchy, &level, k, left)) return route;
    level.damping = descent->damping[k] = unreached_damping(left);
    go_back(descent, work->before, k);
    memset(multipliers_of(work, k), 0, sizeof(double) * (size_t)N);
    const Route damped = serve(work, &level, k, 1, 1, 0, rounds, arena);
    keep_exactly(state, &level, descent->helds[k], arena);
    return damped;
}

/* How much of the closed form's v a damped level starts from: less, the farther out of the box. */
static double inside(const Descent *descent)
{
    const State *state = &descent->state;
    double total = 0.0;
    for (int i = 0; i < state->n; ++i) {
        const double v = descent->open[i], over = v - clipped(v, state->lower[i], state->upper[i]);
        total += over * over;
    }
    return 1.0 / (1.0 + sqrt(total) * descent->unit / FAR_OUT);
}

/* A damped level from the closed form's v, see cascade.h, with its active sets from `first` on. */
static Route approach_open(Work *work, Level *level, int k, int first, int *rounds, Arena *arena)
{
    const Descent *descent = work->descent;
    const int n = descent->state.n;
    double *from = take(arena, n);
    const double share = inside(descent);
    for (int i = 0; i < n; ++i) from[i] = share * descent->open[i];
    level->from = from;
    return serve(work, level, k, PROXIMAL, first, 1, rounds, arena);
}

/* Weight of what bounds keep from a damped level [rad/s]: zero up to KEPT_FROM, one at HELD_BACK
 * more. */
static double held_back(double by) { return larger(0.0, by - KEPT_FROM) / HELD_BACK; }

/* A damped level inside bounds; where they keep it from its aim, once more with more damping, and a
 * smaller aim where they keep the damped levels above from theirs. */
static Route serve_damped(Work *work, int k, int *rounds, Arena *arena)
{
    Descent *descent = work->descent;
    State *state = &descent->state;
    const int n = state->n;
    double *aim = descent->aim + first_row(work->hierarchy, k);
    Level level = level_of(work->hierarchy, descent, descent->aim, k);
    if (!(norm_of(aim, level.m) < LARGEST)) return KEPT;
    for (int i = 0; i < level.m; ++i) aim[i] = dot(level.A + i * n, descent->open, n);
    state->offset = descent->offsets + k * n;
    const Route route = approach_open(work, &level, k, 0, rounds, arena);
    const double left = missing(&level, state->v, n) * descent->unit / level.damping;
    if (!work->hierarchy->sluggish || route >= KEPT || !(left > KEPT_FROM)) return route;
    const double more = held_back(left);
    const double above = unserved(work->hierarchy, descent, descent->aim, work->before, k);
    level.speed *= sqrt(1.0 + more);
    for (int i = 0; i < level.m; ++i) aim[i] /= 1.0 + held_back(above) * more / (1.0 + more);
    go_back(descent, work->before, k);
    descent->doubts[k] = 0; /* of the steps that are taken back */
    memset(multipliers_of(work, k), 0, sizeof(double) * (size_t)state->N);
    return approach_open(work, &level, k, PROXIMAL, rounds, arena);
}

/* Level after level; 0 is the hard rows, which come after `after` others. Returns 0, or -1 where
 * a backend raised. */
static int one_by_one(const Hierarchy *hierarchy, int after, Descent *descent, double *sets,
                      Solution *solution, Proposer propose, void *backend, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = hierarchy->n, N = descent->state.N;
    State *state = &descent->state;
    double *asked = take(arena, N);
    Work work = {hierarchy, descent, solution, propose, backend, take(arena, n), NULL};
    memcpy(asked, state->upper, sizeof(double) * (size_t)N);
    for (int step = 0; step <= hierarchy->levels; ++step) {
        const int k = step < after ? step + 1 : (step == after ? 0 : step);
        const size_t inner = arena->used;
        double *info = solution->info + k * COLUMNS;
        int rounds = 0;
        Route route;
        for (int i = n; i < N && step <= after; ++i)
            state->upper[i] = step < after ? INFINITY : asked[i];
        begin_level(descent, state, k);
        memcpy(work.before, state->v, sizeof(double) * (size_t)n);
        work.sets = sets + k * SETS * N;
        if (k == 0) route = serve_rows(&work, asked, &rounds, arena);
        else if (descent->damping[k] > 0.0) route = serve_damped(&work, k, &rounds, arena);
        else route = serve_strict(&work, k, &rounds, arena);
        arena->used = inner;
        if (route == FAILED) return -1;
        if (!is_finite(state)) {
            route = KEPT;
            go_back(descent, work.before, k);
        }
        end_level(descent, state, k);
        info[ROUTE] = (double)route, info[ROUNDS] = (double)rounds;
    }
    arena->used = mark;
    return 0;
}

/* Rows (m, n) at v: A v - b; returns whether all are zero (or, for `under`, not above zero), to
 * `room` or rounding. */
static int residual_of(const double *A, const double *b, int m, const double *v, int n, int under,
                       double room, double *residual)
{
    int reached = 1;
    for (int i = 0; i < m; ++i) {
        double total = -b[i], terms = fabs(b[i]);
        for (int p = 0; p < n; ++p) {
            const double term = A[i * n + p] * v[p];
            total += term, terms += fabs(term);
        }
        residual[i] = under ? larger(total, 0.0) : total;
        if (!(fabs(residual[i]) <= larger(room, REACHED_TOL * larger(1.0, terms)))) reached = 0;
    }
    return reached;
}

/* v in the caller's unit, and inside the box as it was asked. */
static void finish(const Hierarchy *hierarchy, const Descent *descent, double *v)
{
    const State *state = &descent->state;
    const double unit = descent->unit;
    for (int i = 0; i < hierarchy->n; ++i) {
        v[i] = smaller(larger(v[i] * unit, state->lower[i] * unit), state->upper[i] * unit);
        if (hierarchy->lower[i] <= hierarchy->upper[i]) /* whatever became of it in between */
            v[i] = smaller(larger(v[i], hierarchy->lower[i]), hierarchy->upper[i]);
    }
}

/* Whether level k, or for 0 the hard rows, is reached; and its residual, or their excess. */
static void see_reached(const Hierarchy *hierarchy, Solution *solution, int k)
{
    const int n = hierarchy->n;
    double *reached = solution->info + k * COLUMNS + REACHED;
    if (k == 0) {
        *reached = residual_of(hierarchy->C, hierarchy->d, hierarchy->m, solution->v, n, 1, 0.0,
                               solution->violation);
        return;
    }
    const int first = first_row(hierarchy, k);
    *reached = residual_of(hierarchy->A + first * n, hierarchy->b + first, rows_of(hierarchy, k),
                           solution->v, n, 0, REACHED_SPEED * solution->descent->damping[k],
                           solution->residual + first);
}

/* The account of an answer: residuals, what is touched, and the proof, level by level, all in the
 * caller's unit. Once only. */
void account(const Hierarchy *hierarchy, Solution *solution, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = hierarchy->n, m = hierarchy->m, N = n + m;
    Descent *descent = solution->descent;
    const double unit = descent->unit, small = smaller(1.0, unit);
    State *state = &descent->state;
    double *goal = take(arena, m), *rows = take(arena, m * n), *v = solution->v;
    double over = 0.0, size = 0.0;
    for (int i = 0; i < N; ++i) {
        state->lower[i] *= unit, state->upper[i] *= unit;
        const double Gv = bounded(state, v, i), room = TOUCHING_TOL * larger(1.0, fabs(Gv));
        const double by = state->norms[i] > 0.0 ? state->norms[i] : 1.0;
        const double asked = i < n ? state->upper[i] : hierarchy->d[i - n] / by;
        size = larger(size, fabs(Gv));
        over = larger(over, larger(Gv - state->upper[i], state->lower[i] - Gv));
        solution->touching[i] = Gv - state->lower[i] <= room;
        solution->touching[N + i] = asked - Gv <= room;
    }
    over /= larger(small, size);
    Level exceeded = {0, rows, goal, descent->damping[0], descent->damping[0], NULL, 0};
    for (int i = 0; i < m; ++i) {
        if (!(solution->violation[i] > 0.0)) continue;
        memcpy(rows + exceeded.m * n, hierarchy->C + i * n, sizeof(double) * (size_t)n);
        goal[exceeded.m++] = hierarchy->d[i];
    }
    for (int i = 0; i < state->held; ++i) state->h[i] *= unit, state->shift[i] *= unit;
    for (int i = 0; i < (int)hierarchy->ends[hierarchy->levels - 1]; ++i) descent->aim[i] *= unit;
    for (int i = 0; i < (hierarchy->levels + 1) * n; ++i) descent->stills[i] *= unit;
    for (int k = 0; k <= hierarchy->levels; ++k) {
        double *info = solution->info + k * COLUMNS, *multipliers = solution->multipliers + k * N;
        double *at = descent->vs + k * n;
        const Level level = k == 0 ? exceeded : level_of(hierarchy, descent, descent->aim, k);
        for (int i = 0; i < N; ++i) multipliers[i] *= unit;
        for (int i = 0; i < n; ++i) at[i] *= unit;
        state->held = descent->helds[k];
        const int damped = level.damping > 0.0 || state->held > 0;
        double kkt = kkt_residual(state, &level, damped ? at : v, descent->speeds + k * n * n,
                                  descent->stills + k * n, multipliers, descent->Zs + k * n * n,
                                  descent->frees[k], small, arena);
        if (k > hierarchy->guarded) see_reached(hierarchy, solution, k);
        if (norm_of(level.A, level.m * n) == 0.0) kkt = 0.0; /* nothing to do, nothing to prove */
        info[KKT] = kkt = larger(kkt, over);
        const int proved = kkt <= EXACT && !descent->doubts[k];
        if (info[ROUTE] <= ACTIVE_SET && !proved) info[ROUTE] = UNVERIFIED;
        if (info[ROUTE] == UNVERIFIED && proved) info[ROUTE] = ACTIVE_SET;
        for (int i = n; i < N; ++i)
            if (state->norms[i] > 0.0) multipliers[i] /= state->norms[i];
    }
    arena->used = mark;
}

/* The optimum with the hard rows after `after` levels, and what its account is made of, which stays
 * in the arena. Returns 0, or -1 where a backend raised. */
static int solve_once(const Hierarchy *hierarchy, int after, double *sets, Solution *solution,
                      Proposer propose, void *backend, Arena *arena)
{
    const int N = hierarchy->n + hierarchy->m, count = hierarchy->levels + 1;
    Descent *descent = solution->descent;
    *descent = scaled(hierarchy, solution->v, arena);
    descent->state.bound_rows = &descent->bound_rows;
    memset(solution->multipliers, 0, sizeof(double) * (size_t)(count * N));
    memset(solution->info, 0, sizeof(double) * (size_t)(count * COLUMNS));
    if (hierarchy->max_rounds == 0) {
        for (int k = 0; k < count; ++k) {
            begin_level(descent, &descent->state, k);
            end_level(descent, &descent->state, k);
        }
    } else if (!closed_form(hierarchy, descent, arena) &&
               one_by_one(hierarchy, after, descent, sets, solution, propose, backend, arena)) {
        return -1;
    }
    finish(hierarchy, descent, solution->v);
    for (int k = 0; k <= hierarchy->guarded; ++k) see_reached(hierarchy, solution, k);
    return 0;
}

static int guarded_reached(const Hierarchy *hierarchy, const Solution *solution)
{
    for (int k = 1; k <= hierarchy->guarded; ++k)
        if (solution->info[k * COLUMNS + REACHED] == 0.0) return 0;
    return 1;
}

/* Whether a hard row is exceeded, or holds back a guarded level. */
static int rows_in_the_way(const Hierarchy *hierarchy, const Solution *solution)
{
    const int n = hierarchy->n, N = n + hierarchy->m;
    if (solution->info[REACHED] == 0.0) return 1;
    for (int k = 0; k <= hierarchy->guarded; ++k)
        for (int i = n; i < N; ++i)
            if (solution->multipliers[k * N + i] != 0.0) return 1;
    return 0;
}

/* The lexicographic optimum, and in the arena what account() needs. sets (levels + 1, SETS, N): the
 * active sets to try first, and those found. Returns 0, or -1 where the backend raised. */
int solve_hierarchy(const Hierarchy *hierarchy, double *sets, Solution *solution,
                    Proposer propose, void *backend, Arena *arena)
{
    const int guarded = hierarchy->guarded, afters[] = {0, guarded, 0};
    const size_t size = (sizeof(Descent) + sizeof(double) - 1) / sizeof(double);
    solution->descent = (Descent *)take(arena, (int)size);
    const size_t mark = arena->used;
    for (int turn = 0; turn < 3; ++turn) {
        arena->used = mark;
        if (solve_once(hierarchy, afters[turn], sets, solution, propose, backend, arena)) return -1;
        if (guarded_reached(hierarchy, solution)) return 0;
        if (turn == 0 && (hierarchy->max_rounds == 0 || !rows_in_the_way(hierarchy, solution)))
            return 0;
    }
    return 0;
}
