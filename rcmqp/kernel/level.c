#include "level.h"

#include <math.h>
#include <string.h>

/* A bound counts as kept up to this, times the size of y where that is above one. */
#define FEASIBILITY_TOL 1e-12

/* Multipliers count as zero up to this many times what rounding of the residual makes of them. */
#define MULTIPLIER_TOL 8.0

/* A row whose product with a unit step is below this does not block the step. */
#define RATE_TOL 1e-12

/* A shorter step is no progress [unit of v]. */
#define STALL 1e-15

/* A bound that is met on a shorter step to the optimum on the working set does not join it: the
 * step is rounding. */
#define ARRIVED 1e-12

/* Of the rows that a step meets within this, the one met fastest counts (Harris's ratio test). */
#define OVERSHOOT 1e-13

/* A row this near to its bound takes part in the cone of feasible directions. */
#define TOUCHING 1e-12

/* A row joins a proposed working set if this much of it is new. */
#define INDEPENDENT 1e-8

/* A guess that exceeds a bound by more than CLOSE, relative to its size where that is above one, is
 * mended: it gets the bound exceeded most, at most MENDED times. If y keeps its bounds to
 * FEASIBILITY_TOL and no better, its last digits depend on the guess. */
#define CLOSE 1e-14
#define MENDED 3

/* Rows held at a bound. */
typedef struct {
    int count;
    int *rows;    /* (r) which */
    double *held; /* (k) 1 at upper, -1 at lower, 0 for the others */
} Working;

/* R y (k). */
static void products(const Problem *problem, const double *y, double *Ry)
{
    for (int i = 0; i < problem->k; ++i) Ry[i] = dot(problem->R + i * problem->r, y, problem->r);
}

/* Whether R y (k) keeps every bound to FEASIBILITY_TOL. */
static int within_bounds(const Problem *problem, const double *Ry)
{
    double size = 1.0, worst = 0.0;
    for (int i = 0; i < problem->k; ++i) {
        const double over = larger(Ry[i] - problem->upper[i], problem->lower[i] - Ry[i]);
        size = larger(size, fabs(Ry[i]));
        if (!(over < INFINITY)) return 0; /* NaN too */
        worst = larger(worst, over);
    }
    return worst <= FEASIBILITY_TOL * size;
}

/* Whether y keeps every bound to FEASIBILITY_TOL. */
int feasible(const Problem *problem, const double *y, Arena *arena)
{
    const size_t mark = arena->used;
    double *Ry = take(arena, problem->k);
    products(problem, y, Ry);
    arena->used = mark;
    return within_bounds(problem, Ry);
}

/* Share in [0, 1] of a step that is feasible; *row blocks it (or -1), on *side.
 *
 * A row does not block at the bound where it is held (k): 1 upper, -1 lower, 2 both, 0 none. */
static double longest(const Problem *problem, const double *y, const double *step,
                      const double *held, int *row, double *side)
{
    const int r = problem->r;
    const double least = RATE_TOL * sqrt(dot(step, step, r));
    double reach = INFINITY, share = 1.0, fastest = 0.0;
    *row = -1, *side = 0.0;
    for (int turn = 0; turn < 2; ++turn) {
        for (int i = 0; i < problem->k; ++i) {
            const double rate = dot(problem->R + i * r, step, r), speed = fabs(rate);
            if (!(speed > least) || held[i] * rate > 0.0 || held[i] > 1.0) continue;
            const double Ry = dot(problem->R + i * r, y, r);
            const double gap =
                larger(rate > 0.0 ? problem->upper[i] - Ry : Ry - problem->lower[i], 0.0);
            if (turn == 0) {
                reach = smaller(reach, (gap + OVERSHOOT) / speed);
            } else if (gap / speed <= reach && speed > fastest) {
                fastest = speed, share = gap / speed;
                *row = i, *side = rate > 0.0 ? 1.0 : -1.0;
            }
        }
    }
    if (*row >= 0 && share < 1.0) return share;
    *row = -1;
    return 1.0;
}

static void advance(double *y, double share, const double *step, int r)
{
    for (int j = 0; j < r; ++j) y[j] += share * step[j];
}

/* Room for the factors of a level's working sets. */
Face make_face(const Problem *problem, Arena *arena)
{
    const int m = problem->m, r = problem->r;
    return (Face){-1, (int *)take(arena, r), (int *)take(arena, r), take(arena, r * r),
                  take(arena, r * r), take(arena, m * r), make_least_squares(m, r, arena)};
}

/* The factors of the working set, unless they are here. */
static void turn_to(Face *face, const Problem *problem, const Working *working, Arena *arena)
{
    const size_t mark = arena->used;
    const int m = problem->m, r = problem->r, count = working->count, n_free = r - count;
    int same = face->count == count;
    for (int a = 0; a < count && same; ++a) same = face->rows[a] == working->rows[a];
    if (same) return;
    double *rows = take(arena, count * r);
    face->count = count;
    memcpy(face->rows, working->rows, sizeof(int) * (size_t)count);
    for (int a = 0; a < count; ++a)
        memcpy(rows + a * r, problem->R + face->rows[a] * r, sizeof(double) * (size_t)r);
    factor(rows, count, r, 0.0, face->L, face->Q, face->order, arena);
    for (int i = 0; i < m; ++i) {
        double *row = face->MN + i * n_free;
        memset(row, 0, sizeof(double) * (size_t)n_free);
        for (int j = 0; j < r; ++j)
            add_to(row, problem->M[i * r + j], face->Q + j * r + count, n_free);
    }
    factor_least_squares(&face->by, face->MN, m, n_free, problem->tol, 0);
    arena->used = mark;
}

/* Whether a proposal (k) holds the rows of the face, and no others. */
static int proposes(const Face *face, const double *proposed, int k)
{
    int count = 0;
    for (int i = 0; i < k; ++i) count += proposed[i] != 0.0;
    for (int a = 0; a < face->count; ++a)
        if (proposed[face->rows[a]] == 0.0) return 0;
    return face->count == count;
}

/* The bound that R y (k) exceeds most, if by more than CLOSE, of rows that are independent of those
 * held, and its side; or -1. */
static int exceeded(const Problem *problem, const Face *face, const double *Ry, double *side)
{
    const int r = problem->r;
    double most = 0.0;
    int row = -1;
    for (int i = 0; i < problem->k; ++i) {
        const double *R = problem->R + i * r;
        const double above = Ry[i] - problem->upper[i], below = problem->lower[i] - Ry[i];
        if (!(larger(above, below) > larger(most, CLOSE * larger(1.0, fabs(Ry[i]))))) continue;
        double left = 0.0;
        for (int b = face->count; b < r; ++b) {
            double part = 0.0;
            for (int j = 0; j < r; ++j) part += R[j] * face->Q[j * r + b];
            left += part * part;
        }
        if (!(left > INDEPENDENT)) continue;
        most = larger(above, below), row = i, *side = above > below ? 1.0 : -1.0;
    }
    return row;
}

/* Hold an independent part of the proposal. */
static void start_with(const Problem *problem, const double *proposed, const Face *face,
                       Working *working, Arena *arena)
{
    const size_t mark = arena->used;
    const int r = problem->r, k = problem->k;
    if (proposes(face, proposed, k)) {
        working->count = face->count;
        memcpy(working->rows, face->rows, sizeof(int) * (size_t)face->count);
        memcpy(working->held, proposed, sizeof(double) * (size_t)k);
        return;
    }
    double *rows = take(arena, k * r), *beta = take(arena, r);
    int *order = (int *)take(arena, k), *index = (int *)take(arena, k), count = 0;
    for (int i = 0; i < k; ++i) {
        if (proposed[i] == 0.0) continue;
        memcpy(rows + count * r, problem->R + i * r, sizeof(double) * (size_t)r);
        index[count++] = i;
    }
    working->count = reduce(rows, count, r, INDEPENDENT, beta, order);
    for (int a = 0; a < working->count; ++a) {
        const int i = index[order[a]];
        working->rows[a] = i, working->held[i] = proposed[i];
    }
    arena->used = mark;
}

/* Multipliers (k) that prove y optimal, or a step along which every bound at y lets go.
 *
 * The gradient g is projected onto the cone of feasible directions at y. Returns the norm of the
 * projection; the step is the projection, as long as |M y - c| falls; the working set is made of
 * the bounds that hold the gradient back. */
static double cone_step(const Problem *problem, const double *y, const double *g, Working *working,
                        double *multipliers, double *step, double *near, Arena *arena)
{
    const size_t mark = arena->used;
    const int r = problem->r, k = problem->k;
    double *rows = take(arena, 2 * k * r), *lam = take(arena, 2 * k), *sides = take(arena, 2 * k);
    int *index = (int *)take(arena, 2 * k), count = 0;
    for (int i = 0; i < k; ++i) {
        const double Ry = dot(problem->R + i * r, y, r), reach = TOUCHING * larger(1.0, fabs(Ry));
        near[i] = multipliers[i] = working->held[i] = 0.0;
        for (double side = 1.0; side >= -1.0; side -= 2.0) {
            if (!((side > 0.0 ? problem->upper[i] - Ry : Ry - problem->lower[i]) <= reach))
                continue;
            for (int j = 0; j < r; ++j) rows[count * r + j] = side * problem->R[i * r + j];
            near[i] = near[i] == 0.0 ? side : 2.0, index[count] = i, sides[count++] = side;
        }
    }
    double *by = take(arena, count * r);
    memcpy(by, rows, sizeof(double) * (size_t)(count * r));
    for (int j = 0; j < r; ++j) step[j] = -g[j];
    const double norm = nnls(by, count, r, step, lam, arena);
    working->count = 0;
    for (int a = 0; a < count; ++a) {
        advance(step, -lam[a], rows + a * r, r);
        if (!(lam[a] > 0.0) || working->count == r) continue;
        multipliers[index[a]] = sides[a] * lam[a];
        working->held[index[a]] = sides[a];
        working->rows[working->count++] = index[a];
    }
    double bend = 0.0;
    for (int i = 0; i < problem->m; ++i) {
        const double part = dot(problem->M + i * r, step, r);
        bend += part * part;
    }
    if (bend > 0.0)
        for (int j = 0; j < r; ++j) step[j] *= norm * norm / bend;
    arena->used = mark;
    return norm;
}

/* Whether M y = c to rounding, so that no bound is in the way. */
static int reached(const Problem *problem, const double *y)
{
    const int r = problem->r;
    for (int i = 0; i < problem->m; ++i) {
        const double *row = problem->M + i * r;
        double left = -problem->c[i], noise = problem->noise[i];
        for (int j = 0; j < r; ++j) {
            const double part = row[j] * y[j];
            left += part, noise += EPS * fabs(part);
        }
        if (!(fabs(left) <= MULTIPLIER_TOL * noise)) return 0;
    }
    return 1;
}

/* The optimum y (r), feasible, and the multipliers (k) of M^T (M y - c) + R^T multipliers = 0,
 * positive at upper bounds; set (k) is a guess at the working set, and then the last one: 1 at
 * upper, -1 at lower bounds, 0.
 *
 * A row whose multiplier is rounding is let go, too, unless all is reached, but once only: light rows
 * of M may be lost in the rounding of heavy ones.
 *
 * Returns the rounds it took, 1 if the guess was right at once; negative where they ran out. */
int solve_level(const Problem *problem, int max_rounds, double *set, Face *face, double *y,
                double *multipliers, Arena *arena)
{
    const size_t mark = arena->used;
    const int m = problem->m, r = problem->r, k = problem->k;
    const double *M = problem->M, *c = problem->c;
    Working working = {0, (int *)take(arena, r), take(arena, k)};
    double *held = working.held, *near = take(arena, k), *left = take(arena, m);
    double *step = take(arena, r), *w = take(arena, r), *g = take(arena, r), *Ry = take(arena, k);
    int *tried = (int *)take(arena, k);
    const double *L = face->L, *Q = face->Q;
    const int *order = face->order;
    int stalls = 0, status = -max_rounds, guessed = 1, checked = 0; /* that y keeps its bounds */
    memset(held, 0, sizeof(double) * (size_t)k);
    memset(tried, 0, sizeof(int) * (size_t)k);
    memset(y, 0, sizeof(double) * (size_t)r);
    memset(multipliers, 0, sizeof(double) * (size_t)k); /* rounds may run out first */
    start_with(problem, set, face, &working, arena);
    for (int turn = 0; turn < max_rounds; ++turn) {
        /* the step to the optimum on the working set */
        const int count = working.count, n_free = r - count;
        int row;
        double side;
        checked = 0;
        turn_to(face, problem, &working, arena);
        for (int a = 0; a < count; ++a) { /* back onto the bounds, where steps have drifted off */
            const int i = working.rows[order[a]];
            const double bound = held[i] > 0.0 ? problem->upper[i] : problem->lower[i];
            w[a] = bound - dot(problem->R + i * r, y, r);
            w[a] = (w[a] - dot(L + a * r, w, a)) / L[a * r + a];
        }
        for (int j = 0; j < r; ++j) y[j] += dot(Q + j * r, w, count);
        for (int i = 0; i < m; ++i) left[i] = c[i] - dot(M + i * r, y, r);
        least_squares(&face->by, left, w);
        for (int j = 0; j < r; ++j) step[j] = dot(Q + j * r + count, w, n_free);
        if (guessed && count > 0) {
            advance(y, 1.0, step, r);
            products(problem, y, Ry);
            row = guessed++ <= MENDED && count < r ? exceeded(problem, face, Ry, &side) : -1;
            if (row >= 0) {
                working.rows[working.count++] = row, held[row] = side;
                continue;
            }
            if (within_bounds(problem, Ry)) {
                guessed = 0, checked = 1;
                memset(step, 0, sizeof(double) * (size_t)r);
            } else { /* start from the way to it, without a working set */
                guessed = 0;
                memset(held, 0, sizeof(double) * (size_t)k);
                memcpy(step, y, sizeof(double) * (size_t)r);
                memset(y, 0, sizeof(double) * (size_t)r);
                advance(y, longest(problem, y, step, held, &row, &side), step, r);
                working.count = 0;
                continue;
            }
        }
        const double size = sqrt(dot(step, step, r));
        double share = 1.0;
        row = -1;
        if (size > 0.0) {
            share = longest(problem, y, step, held, &row, &side);
            advance(y, share, step, r);
        }
        if (!(size > ARRIVED)) row = -1;
        stalls = share * size > STALL ? 0 : stalls + 1;
        if (row >= 0 && count < r) {
            working.rows[working.count++] = row;
            held[row] = side;
            continue;
        }
        /* multipliers; the residual has no part in MN's range, so what is there is rounding, and
         * goes: or the heavy rows' rounding would drown the light ones' residual */
        double tol = 0.0;
        for (int i = 0; i < m; ++i) left[i] = dot(M + i * r, y, r) - c[i];
        outside_range(&face->by, left);
        for (int j = 0; j < r; ++j) {
            double rounding = 0.0;
            g[j] = 0.0;
            for (int i = 0; i < m; ++i) {
                g[j] += M[i * r + j] * left[i];
                rounding += fabs(M[i * r + j]) * (problem->noise[i] + EPS * fabs(left[i]));
            }
            tol += rounding * rounding;
        }
        tol = MULTIPLIER_TOL * sqrt(tol);
        memset(multipliers, 0, sizeof(double) * (size_t)k);
        double worst = -tol;
        int at = -1, doubtful = -1;
        for (int a = count - 1; a >= 0; --a) {
            double total = 0.0;
            for (int j = 0; j < r; ++j) total -= Q[j * r + a] * g[j];
            for (int b = a + 1; b < count; ++b) total -= L[b * r + a] * w[b];
            w[a] = total / L[a * r + a];
            const int i = working.rows[order[a]];
            if (w[a] * held[i] > 0.0) multipliers[i] = w[a];
            if (w[a] * held[i] < worst) worst = w[a] * held[i], at = order[a];
            if (w[a] * held[i] <= tol && !tried[i]) doubtful = order[a];
        }
        if (at < 0 && doubtful >= 0 && !reached(problem, y))
            at = doubtful, tried[working.rows[at]] = 1;
        if (at < 0) {
            status = turn + 1;
            break;
        }
        if (stalls <= r) {
            held[working.rows[at]] = 0.0;
            --working.count;
            for (int a = at; a < working.count; ++a) working.rows[a] = working.rows[a + 1];
            continue;
        }
        stalls = 0;
        if (cone_step(problem, y, g, &working, multipliers, step, near, arena) <= tol) {
            status = turn + 1;
            break;
        }
        advance(y, longest(problem, y, step, near, &row, &side), step, r);
    }
    memcpy(set, held, sizeof(double) * (size_t)k);
    arena->used = mark;
    return status > 0 && !checked && !feasible(problem, y, arena) ? -status : status;
}
