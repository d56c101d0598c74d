#include "cascade.h"

#include <math.h>
#include <string.h>

/* A unit row whose part in the free directions is below this cannot change any more. */
#define FIXED 1e-11

/* A unit row that is exceeded by less is kept, times its size where that is above one. */
#define CARRIED 1e-12

/* A hard row that is exceeded by less, times its size where that is above one, is not fixed: it
 * may be rounding. It stays an inequality. */
#define FROZEN 1e-9

/* Rounding in the gradient |H|^2 |v| of the heavy rows that hold damped levels, over EXACT
 * (hierarchy.c). */
#define HEAVY_NOISE 4e-6

/* Euclidean norm, roughly so where squares over- or underflow. */
double norm_of(const double *x, int count)
{
    double largest = 0.0;
    const double norm = sqrt(dot(x, x, count));
    if (norm > 1e-150 && norm < LARGEST) return norm;
    for (int i = 0; i < count; ++i) largest = larger(largest, fabs(x[i]));
    return largest;
}

/* A row in the free coordinates, times a factor: row Z (free). */
static void along(const State *state, const double *row, double by, double *found)
{
    const int n = state->n, free = state->free;
    for (int j = 0; j < free; ++j) found[j] = 0.0;
    for (int p = 0; p < n; ++p) {
        const double *Z = state->Z + p * n, part = row[p];
        for (int j = 0; j < free; ++j) found[j] += part * Z[j];
    }
    for (int j = 0; j < free; ++j) found[j] *= by;
}

/* Z <- Z Q[:, rank:]; Q (free, free). */
static void turn(State *state, const double *Q, int rank, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n, free = state->free;
    double *line = take(arena, free);
    for (int i = 0; i < n; ++i) {
        memcpy(line, state->Z + i * n, sizeof(double) * (size_t)free);
        for (int j = rank; j < free; ++j) {
            double total = 0.0;
            for (int p = 0; p < free; ++p) total += line[p] * Q[p * free + j];
            state->Z[i * n + j - rank] = total;
        }
    }
    state->free = free - rank;
    arena->used = mark;
}

/* Take the span of rows (count, n), of about unit norm, out of the free directions. */
void narrow(State *state, const double *rows, int count, double tol, Arena *arena)
{
    const size_t mark = arena->used;
    const int free = state->free;
    double *B = take(arena, count * free), *L = take(arena, count * free);
    double *Q = take(arena, free * free);
    int *order = (int *)take(arena, count);
    for (int i = 0; i < count; ++i) along(state, rows + i * state->n, 1.0, B + i * free);
    turn(state, Q, factor(B, count, free, tol, L, Q, order, arena), arena);
    arena->used = mark;
}

static void move(State *state, const double *y)
{
    for (int p = 0; p < state->n; ++p) state->v[p] += dot(state->Z + p * state->n, y, state->free);
}

/* What counts as dependent in rows that were divided by `weight`. */
static double resolution(double weight) { return larger(RESOLUTION / weight, ROUNDING); }

/* Rows of a damped level's speed: L Z^T (free, n), see cascade.h. */
static void speed_rows(const State *state, const Level *level, double *speed, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n, free = state->free, m = level->m, all = m + state->held;
    double *C = take(arena, all * free), *W = take(arena, all * free);
    double *S = take(arena, all * all), *L = take(arena, free * free);
    for (int i = 0; i < m; ++i)
        along(state, level->A + i * n, 1.0 / level->damping, C + i * free);
    for (int i = 0; i < state->held; ++i)
        along(state, state->H + i * n, EXCHANGE, C + (m + i) * free);
    for (int i = 0; i < all; ++i)
        for (int j = 0; j <= i; ++j)
            S[i * all + j] = dot(C + i * free, C + j * free, free) + (i == j ? 1.0 : 0.0);
    memcpy(W, C, sizeof(double) * (size_t)(all * free));
    cholesky(S, all);
    cholesky_solve(S, all, W, free); /* (I + C^T C)^-1 = I - C^T (I + C C^T)^-1 C */
    for (int i = 0; i < free; ++i)
        for (int j = 0; j < free; ++j) {
            double total = i == j ? 1.0 : 0.0;
            for (int p = 0; p < all; ++p) total -= C[p * free + i] * W[p * free + j];
            L[i * free + j] = level->damping * total;
        }
    for (int i = 0; i < free; ++i)
        for (int p = 0; p < n; ++p) speed[i * n + p] = dot(L + i * free, state->Z + p * n, free);
    arena->used = mark;
}

/* Rows of a damped level's steps inside bounds, whose square is Z (d^2 + L^2) Z^T, see cascade.h;
 * L = 0 where the speed's damping is the level's own, d. */
static void step_rows(const State *state, const Level *level, double *speed, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n, free = state->free;
    const double square = level->damping * level->damping;
    const double more = level->speed * level->speed - square;
    double *S = take(arena, free * free);
    if (more > 0.0) {
        Level held_back = *level;
        held_back.damping = sqrt(more);
        speed_rows(state, &held_back, speed, arena);
    }
    for (int i = 0; i < free; ++i)
        for (int j = 0; j <= i; ++j)
            S[i * free + j] = (i == j ? square : 0.0) +
                              (more > 0.0 ? dot(speed + i * n, speed + j * n, n) : 0.0);
    cholesky(S, free);
    for (int i = 0; i < free; ++i)
        for (int p = 0; p < n; ++p) {
            double total = 0.0;
            for (int j = i; j < free; ++j) total += S[j * free + i] * state->Z[p * n + j];
            speed[i * n + p] = total;
        }
    arena->used = mark;
}

/* One row a v = b, divided by `weight`, as row i of M and c; returns a v. */
static double add_row(const State *state, const double *a, double b, double weight, int i,
                      Problem *problem)
{
    const double by = 1.0 / weight;
    double av = 0.0, noise = fabs(b);
    for (int p = 0; p < state->n; ++p) {
        const double term = a[p] * state->v[p];
        av += term, noise += fabs(term);
    }
    problem->c[i] = by * (b - av), problem->noise[i] = EPS * by * noise;
    along(state, a, by, problem->M + i * state->free);
    return by * av;
}

/* What row i of the damped levels above is to be. */
static double held_to(const State *state, const Level *level, int i)
{
    return state->h[i] + (level->damping > 0.0 ? 0.0 : state->shift[i]);
}

/* A level in the free coordinates; rows (N) says which bound each row of R is. speed (n, n) and
 * still (n), what its rows are when the speed costs nothing, are filled in where the level is
 * damped. */
void make_problem(const State *state, const Level *level, Problem *problem, double *speed,
                  double *still, int *rows, Arena *arena)
{
    const int n = state->n, free = state->free, N = state->N, m = level->m;
    const int damped = level->damping > 0.0 ? free : 0, all = m + damped + state->held;
    double *M = take(arena, all * free), *c = take(arena, all), *noise = take(arena, all);
    double *R = take(arena, N * free), *lower = take(arena, N), *upper = take(arena, N);
    const double weight = norm_of(level->A, m * n);
    double total = 0.0;
    *problem = (Problem){all, free, 0, M, c, noise, R, lower, upper, weight, 0.0, 0.0};
    if (weight == 0.0) return;
    problem->tol = resolution(weight);
    for (int i = 0; i < m; ++i) {
        const double Av = add_row(state, level->A + i * n, level->b[i], weight, i, problem);
        total += Av * Av;
    }
    problem->scale = norm_of(level->b, m) / weight + sqrt(total);
    if (damped) {
        if (level->from == NULL) {
            speed_rows(state, level, speed, arena);
        } else {
            step_rows(state, level, speed, arena);
        }
        for (int i = 0; i < free; ++i) {
            still[i] = level->from == NULL ? 0.0 : dot(speed + i * n, level->from, n);
            add_row(state, speed + i * n, still[i], weight, m + i, problem);
        }
    }
    for (int i = 0; i < state->held; ++i)
        add_row(state, state->H + i * n, held_to(state, level, i), weight, m + damped + i, problem);
    for (int i = 0; i < N; ++i) {
        if (state->lower[i] == -INFINITY && state->upper[i] == INFINITY) continue;
        const double Gv = dot(state->G + i * n, state->v, n);
        double *row = R + problem->k * free;
        along(state, state->G + i * n, 1.0, row);
        if (!(dot(row, row, free) > FIXED * FIXED)) continue;
        lower[problem->k] = smaller(state->lower[i] - Gv, 0.0);
        upper[problem->k] = larger(state->upper[i] - Gv, 0.0);
        rows[problem->k++] = i;
    }
}

/* Later levels are held to what this damped one has reached. */
static void hold(State *state, const Level *level)
{
    const int n = state->n;
    const double by = EXCHANGE * level->damping;
    for (int i = 0; i < level->m; ++i, ++state->held) {
        double *row = state->H + state->held * n;
        for (int p = 0; p < n; ++p) row[p] = level->A[i * n + p] / by;
        state->h[state->held] = dot(row, state->v, n);
        state->shift[state->held] = state->offset == NULL ? 0.0 : dot(row, state->offset, n);
    }
}

static int overflows(const Problem *problem)
{
    return !(problem->weight < LARGEST && problem->scale < LARGEST);
}

/* From a point in the box, exceed the hard rows least; carry the excess in `upper`.
 *
 * min sum_i max(0, C_i v - d_i)^2 in the box. The rows V exceeded at the optimum are searched:
 * least squares of V's excess while the other rows are kept; then a row that ends below its bound
 * leaves V, and one whose multiplier says that exceeding it pays enters. The sum falls from round
 * to round, so that no V comes back. With damping, speed (n, n) is weighed against the sum. */
Route satisfy_rows(State *state, double damping, int max_rounds, double *speed,
                   double *still, double *multipliers, int *rounds, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n, N = state->N;
    double *A = take(arena, N * n), *b = take(arena, N), *upper = state->upper;
    double *over = take(arena, N), *relaxed = take(arena, N), *none = take(arena, N);
    double *lam = take(arena, N), *y = take(arena, n), strong = INFINITY;
    int *V = (int *)take(arena, N), *index = (int *)take(arena, N);
    Route route = CLOSED_FORM;
    memset(none, 0, sizeof(double) * (size_t)N);
    for (int i = 0; i < N; ++i) V[i] = 0;
    *rounds = 0;
    for (int round = 0;; ++round) {
        int same = round > 0, m = 0;
        for (int i = 0; i < N; ++i) {
            const double Gv = dot(state->G + i * n, state->v, n);
            over[i] = (Gv - upper[i]) / (CARRIED * larger(1.0, fabs(Gv)));
            relaxed[i] = upper[i];
            if (i < n || state->norms[i] == 0.0) continue;
            const int before = V[i];
            V[i] = before ? over[i] > -1.0 : round == 0 && over[i] > 1.0;
            if (fabs(multipliers[i]) > strong) V[i] = 1;
            if (V[i] != before) same = 0;
            if (!V[i]) continue;
            for (int p = 0; p < n; ++p) A[m * n + p] = state->G[i * n + p] * state->norms[i];
            b[m++] = upper[i] * state->norms[i];
            relaxed[i] = INFINITY;
        }
        if (m == 0) {
            memset(multipliers, 0, sizeof(double) * (size_t)N);
            break;
        }
        if (same) { /* what decides the optimum stays */
            int count = 0;
            for (int i = 0; i < N; ++i) {
                if (!(V[i] && over[i] * CARRIED > FROZEN) &&
                    !(i < n && fabs(multipliers[i]) > strong))
                    continue;
                memcpy(A + count++ * n, state->G + i * n, sizeof(double) * (size_t)n);
            }
            narrow(state, A, count, RESOLUTION, arena);
            break;
        }
        if (round == max_rounds) {
            route = UNVERIFIED;
            break;
        }
        const size_t inner = arena->used;
        Problem problem;
        State open = *state;
        open.upper = relaxed;
        const Level rows = {m, A, b, damping, damping, NULL, 0};
        make_problem(&open, &rows, &problem, speed, still, index, arena);
        if (overflows(&problem)) {
            route = KEPT;
            break;
        }
        const int used = solve_level(&problem, max_rounds, none, y, lam, arena);
        const double square = problem.weight * problem.weight;
        move(state, y);
        *rounds += used > 0 ? used : -used;
        route = used > 0 ? ACTIVE_SET : UNVERIFIED;
        strong = STRONG * problem.scale * square;
        memset(multipliers, 0, sizeof(double) * (size_t)N);
        for (int i = 0; i < problem.k; ++i) multipliers[index[i]] = lam[i] * square;
        arena->used = inner;
    }
    for (int i = n; i < N; ++i)
        upper[i] = larger(upper[i], dot(state->G + i * n, state->v, n));
    arena->used = mark;
    return route;
}

/* Take a strict level's rows out of what is free, and `count` bounds that are active at every
 * optimum of it. */
static void keep(State *state, const Level *level, double weight, const int *bounds, int count,
                 Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n, m = level->m;
    double *kept = take(arena, (m + count) * n);
    for (int i = 0; i < m * n; ++i) kept[i] = level->A[i] / weight;
    for (int i = 0; i < count; ++i)
        memcpy(kept + (m + i) * n, state->G + bounds[i] * n, sizeof(double) * (size_t)n);
    narrow(state, kept, m + count, resolution(weight), arena);
    arena->used = mark;
}

/* Hold later levels to what a damped one has just reached exactly, as they are by a strict one;
 * `held` rows were there before it. */
void keep_exactly(State *state, const Level *level, int held, Arena *arena)
{
    const double weight = norm_of(level->A, level->m * state->n);
    state->held = held;
    if (weight == 0.0 || !(weight < LARGEST)) return;
    keep(state, level, weight, NULL, 0, arena);
}

/* One level: move to its optimum, and keep A v from now on, exactly or as a damped level does.
 *
 * Where a bound is in the way, `ask` is set and the proposed active set is not right at once,
 * nothing is done and the answer is BLOCKED. */
Route descend(State *state, const Level *level, int max_rounds, const double *proposed, int ask,
              double *speed, double *still, double *multipliers, int *rounds, Arena *arena)
{
    const size_t mark = arena->used;
    const int free = state->free, m = level->m;
    const int all = m + state->held + (level->damping > 0.0 ? free : 0);
    double *y = take(arena, free), *Q = take(arena, free * free);
    int *index = (int *)take(arena, state->N), range;
    Route route = CLOSED_FORM;
    Problem problem;
    *rounds = 0;
    if (free == 0 || m == 0) return CLOSED_FORM;
    make_problem(state, level, &problem, speed, still, index, arena);
    const int k = problem.k;
    if (problem.weight == 0.0) goto done;
    if (overflows(&problem)) {
        route = KEPT;
        goto done;
    }
    const int strict = !(level->damping > 0.0) && !level->last, alone = state->held == 0;
    const int rank = pseudo_solve(problem.M, all, free, problem.c, problem.tol, y,
                                  strict && alone ? Q : NULL, NULL, &range, arena);
    if (rank >= 0 && feasible(&problem, y)) {
        move(state, y);
        if (level->damping > 0.0)
            hold(state, level);
        else if (strict && alone)
            turn(state, Q, rank, arena);
        else if (strict)
            keep(state, level, problem.weight, NULL, 0, arena);
        goto done;
    }
    double *guess = take(arena, k), *lam = take(arena, k);
    int *strong = (int *)take(arena, k), count = 0;
    int guessed = 0;
    for (int i = 0; i < k; ++i) {
        guess[i] = proposed[index[i]], lam[i] = 0.0;
        if (guess[i] != 0.0) guessed = 1;
    }
    if (ask && !guessed) {
        route = BLOCKED;
        goto done;
    }
    *rounds = solve_level(&problem, ask ? 1 : max_rounds, guess, y, lam, arena);
    if (ask && *rounds != 1) {
        *rounds = 0, route = BLOCKED;
        goto done;
    }
    if (*rounds < 0) { /* a guess so bad that it cost digits: start without */
        memset(guess, 0, sizeof(double) * (size_t)k);
        *rounds = solve_level(&problem, max_rounds, guess, y, lam, arena);
    }
    route = *rounds == 1 ? POLISHED : ACTIVE_SET;
    if (*rounds < 0) {
        route = UNVERIFIED, *rounds = -*rounds;
        if (!feasible(&problem, y)) goto done;
    }
    move(state, y);
    for (int i = 0; i < k; ++i) {
        multipliers[index[i]] = lam[i] * problem.weight * problem.weight;
        if (fabs(lam[i]) > STRONG * problem.scale) strong[count++] = index[i];
    }
    if (level->damping > 0.0)
        hold(state, level);
    else if (strict)
        keep(state, level, problem.weight, strong, count, arena);
done:
    arena->used = mark;
    return route;
}

/* Add rows^T (rows v - b), rows (count, n), to the gradient; returns the size of its terms. */
static double add_gradient(const double *rows, const double *b, int count, const double *v, int n,
                           double *gradient)
{
    double square = 0.0, goal = 0.0;
    for (int i = 0; i < count; ++i) {
        const double wanted = b == NULL ? 0.0 : b[i];
        const double residual = dot(rows + i * n, v, n) - wanted;
        for (int p = 0; p < n; ++p) gradient[p] += rows[i * n + p] * residual;
        square += residual * residual, goal += wanted * wanted;
    }
    return norm_of(rows, count * n) * sqrt(larger(square, goal));
}

/* Residual of a level's optimality conditions at v, from the problem's own numbers.
 *
 * The larger of: gradient plus G^T multipliers along Z (n, n), its first `free` columns, what was
 * free before the level, and multiplier times slack at the bound of the multiplier's sign, over
 * `small`; both over the size of the gradient's terms, or `small`. The state's held rows are those
 * of the level; speed (free, n) and still (free) its rows of the speed, where it is damped. */
double kkt_residual(const State *state, const Level *level, const double *v, const double *speed,
                    const double *still, const double *multipliers, const double *Z, int free, double small,
                    Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n;
    double *gradient = take(arena, n), worst = 0.0;
    memset(gradient, 0, sizeof(double) * (size_t)n);
    double scale = add_gradient(level->A, level->b, level->m, v, n, gradient);
    if (level->damping > 0.0) scale += add_gradient(speed, still, free, v, n, gradient);
    double *held = take(arena, state->held);
    for (int i = 0; i < state->held; ++i) held[i] = held_to(state, level, i);
    const double weight = norm_of(state->H, state->held * n);
    add_gradient(state->H, held, state->held, v, n, gradient);
    scale = larger(scale, small) + HEAVY_NOISE * weight * weight * norm_of(v, n);
    for (int i = 0; i < state->N; ++i) {
        const double lam = multipliers[i];
        if (lam == 0.0) continue;
        const double Gv = dot(state->G + i * n, v, n);
        for (int p = 0; p < n; ++p) gradient[p] += state->G[i * n + p] * lam;
        const double slack = lam > 0.0 ? state->upper[i] - Gv : Gv - state->lower[i];
        worst = larger(worst, fabs(lam * slack) / small);
    }
    for (int j = 0; j < free; ++j) {
        double part = 0.0;
        for (int p = 0; p < n; ++p) part += Z[p * n + j] * gradient[p];
        if (!(fabs(part) <= worst)) worst = fabs(part);
    }
    arena->used = mark;
    worst /= scale;
    return worst < INFINITY ? worst : INFINITY;
}
